/* A host for FMUs of insenv in C99: no Python, and no library except the C runtime.
 *
 *   cc -std=c99 -O2 host.c -o host -ldl -lm          (Linux, macOS; on Windows: without -ldl)
 *   unzip -d qakf qakf.fmu
 *   ./host qakf input.csv 0.005 output.csv
 *
 * The first line of input.csv holds the names: "time", then one column for each element of each input to be set.  Row k is set
 * before step k, from t(0) + k step to t(0) + (k + 1) step; output.csv holds the outputs at the end of each step.  For an FMU
 * without inputs (a plant) the column "time" is enough.  A fifth argument N makes N runs with a reset in between; the processor
 * time per step of each run is printed.  Works with FMI 2.0 and 3.0.
 */
#define _POSIX_C_SOURCE 200809L
#include <stdarg.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "description.h"

#ifdef _WIN32
#include <windows.h>
#define LOAD(path) ((void *)LoadLibraryA(path))
#define SYMBOL(library, name) ((void *)GetProcAddress((HMODULE)(library), name))
#define ENDING ".dll"
static const char *const PLATFORMS[] = {"x86_64-windows", "win64", NULL};
#else
#include <dlfcn.h>
#define LOAD(path) dlopen(path, RTLD_NOW | RTLD_LOCAL)
#define SYMBOL(library, name) dlsym(library, name)
#if defined(__APPLE__)
#define ENDING ".dylib"
#if defined(__aarch64__)
static const char *const PLATFORMS[] = {"aarch64-darwin", "darwin64", NULL};
#else
static const char *const PLATFORMS[] = {"x86_64-darwin", "darwin64", NULL};
#endif
#else
#define ENDING ".so"
#if defined(__aarch64__)
static const char *const PLATFORMS[] = {"aarch64-linux", "linuxaarch64", NULL};
#else
static const char *const PLATFORMS[] = {"x86_64-linux", "linux64", NULL};
#endif
#endif
#endif

/* The declarations of FMI 2.0 and 3.0 that are used here. */
typedef void *Instance;
typedef struct {
  void (*logger)(void *, const char *, int, const char *, const char *, ...);
  void *(*allocate)(size_t, size_t);
  void (*release)(void *);
  void (*step_finished)(void *, int);
  void *environment;
} Callbacks2;
typedef Instance (*Instantiate2)(const char *, int, const char *, const char *, const Callbacks2 *, int, int);
typedef int (*Setup2)(Instance, int, double, double, int, double);
typedef int (*Values2)(Instance, const uint32_t *, size_t, double *);
typedef int (*Booleans2)(Instance, const uint32_t *, size_t, int *);
typedef int (*DoStep2)(Instance, double, double, int);
typedef void (*Logger3)(void *, int, const char *, const char *);
typedef Instance (*Instantiate3)(const char *, const char *, const char *, bool, bool, bool, bool, const uint32_t *, size_t, void *,
                                 Logger3, void *);
typedef int (*Enter3)(Instance, bool, double, double, bool, double);
typedef int (*Values3)(Instance, const uint32_t *, size_t, double *, size_t);
typedef int (*Booleans3)(Instance, const uint32_t *, size_t, bool *, size_t);
typedef int (*DoStep3)(Instance, double, double, bool, bool *, bool *, bool *, double *);
typedef int (*Simple)(Instance);
typedef void (*Release)(Instance);

static void fail(const char *what, const char *more) {
  fprintf(stderr, "host: %s%s\n", what, more);
  exit(1);
}

static void check(int status, const char *doing) {
  if (status > 1) fail(doing, ": the FMU reports an error");
}

static void logged2(void *environment, const char *instance, int status, const char *category, const char *message, ...) {
  va_list values;
  (void)environment, (void)instance;
  fprintf(stderr, "host: FMU says (status %d, %s): ", status, category ? category : "");
  va_start(values, message);
  vfprintf(stderr, message, values);
  va_end(values);
  fputc('\n', stderr);
}

static void logged3(void *environment, int status, const char *category, const char *message) {
  (void)environment;
  logged2(NULL, NULL, status, category, "%s", message);
}

/* The binary of an FMU, its functions and one instance. */
typedef struct {
  int version;
  void *library;
  Instance instance;
  Setup2 setup2;
  Enter3 enter3;
  Values2 set2, get2;
  Values3 set3, get3;
  Booleans2 set_booleans2, get_booleans2;
  Booleans3 set_booleans3, get_booleans3;
  DoStep2 do_step2;
  DoStep3 do_step3;
  Simple enter2, leave, reset, terminate;
  Release release;
} Fmu;

static void load(Fmu *fmu, const char *folder, const Description *d) {
  char path[4096];
  fmu->version = d->version;
  for (int i = 0; PLATFORMS[i] && !fmu->library; i++) {
    snprintf(path, sizeof path, "%s/binaries/%s/%s" ENDING, folder, PLATFORMS[i], d->identifier);
    fmu->library = LOAD(path);
  }
  if (!fmu->library) fail("cannot load ", path);
}

/* Store the address of a function in the function pointer at `place`: C has no conversion from void * to it. */
static void resolve(const Fmu *fmu, const char *name, void *place) {
  char full[64];
  snprintf(full, sizeof full, "fmi%d%s", fmu->version, name);
  void *found = SYMBOL(fmu->library, full);
  if (!found) fail("the binary has no function ", full);
  memcpy(place, &found, sizeof found);
}

static void instantiate(Fmu *fmu, const Description *d) {
  static const Callbacks2 callbacks = {logged2, calloc, free, NULL, NULL};
  if (fmu->version == 2) {
    Instantiate2 create;
    resolve(fmu, "Instantiate", &create);
    resolve(fmu, "SetupExperiment", &fmu->setup2);
    resolve(fmu, "EnterInitializationMode", &fmu->enter2);
    resolve(fmu, "SetReal", &fmu->set2);
    resolve(fmu, "GetReal", &fmu->get2);
    resolve(fmu, "SetBoolean", &fmu->set_booleans2);
    resolve(fmu, "GetBoolean", &fmu->get_booleans2);
    resolve(fmu, "DoStep", &fmu->do_step2);
    fmu->instance = create("host", 1, d->token, "", &callbacks, 0, 0);
  } else {
    Instantiate3 create;
    resolve(fmu, "InstantiateCoSimulation", &create);
    resolve(fmu, "EnterInitializationMode", &fmu->enter3);
    resolve(fmu, "SetFloat64", &fmu->set3);
    resolve(fmu, "GetFloat64", &fmu->get3);
    resolve(fmu, "SetBoolean", &fmu->set_booleans3);
    resolve(fmu, "GetBoolean", &fmu->get_booleans3);
    resolve(fmu, "DoStep", &fmu->do_step3);
    fmu->instance = create("host", d->token, "", false, false, false, false, NULL, 0, NULL, logged3, NULL);
  }
  resolve(fmu, "ExitInitializationMode", &fmu->leave);
  resolve(fmu, "Reset", &fmu->reset);
  resolve(fmu, "Terminate", &fmu->terminate);
  resolve(fmu, "FreeInstance", &fmu->release);
  if (!fmu->instance) fail("no instance of ", d->identifier);
}

static void initialize(const Fmu *fmu, double start) {
  if (fmu->version == 2) {
    check(fmu->setup2(fmu->instance, 0, 0.0, start, 0, 0.0), "setup");
    check(fmu->enter2(fmu->instance), "initialization");
  } else
    check(fmu->enter3(fmu->instance, false, 0.0, start, false, 0.0), "initialization");
  check(fmu->leave(fmu->instance), "initialization");
}

/* Variables that are set or read together: numbers, then Booleans (scalars), whose values are kept as 0 or 1. */
typedef struct {
  uint32_t *references;
  size_t count, elements, booleans; /* all variables, all elements, and those of them that are Booleans */
} Group;

static void set(const Fmu *fmu, const Group *group, const double *values) {
  const size_t count = group->count - group->booleans, elements = group->elements - group->booleans;
  const uint32_t *booleans = group->references + count;
  if (count && fmu->version == 2) check(fmu->set2(fmu->instance, group->references, count, (double *)values), "inputs");
  if (count && fmu->version == 3) check(fmu->set3(fmu->instance, group->references, count, (double *)values, elements), "inputs");
  for (size_t i = 0; i < group->booleans; i++) {
    const bool value = values[elements + i] != 0;
    int as2 = value;
    bool as3 = value;
    if (fmu->version == 2) check(fmu->set_booleans2(fmu->instance, booleans + i, 1, &as2), "inputs");
    else check(fmu->set_booleans3(fmu->instance, booleans + i, 1, &as3, 1), "inputs");
  }
}

static void get(const Fmu *fmu, const Group *group, double *values) {
  const size_t count = group->count - group->booleans, elements = group->elements - group->booleans;
  const uint32_t *booleans = group->references + count;
  if (count && fmu->version == 2) check(fmu->get2(fmu->instance, group->references, count, values), "outputs");
  if (count && fmu->version == 3) check(fmu->get3(fmu->instance, group->references, count, values, elements), "outputs");
  for (size_t i = 0; i < group->booleans; i++) {
    int as2 = 0;
    bool as3 = false;
    if (fmu->version == 2) check(fmu->get_booleans2(fmu->instance, booleans + i, 1, &as2), "outputs");
    else check(fmu->get_booleans3(fmu->instance, booleans + i, 1, &as3, 1), "outputs");
    values[elements + i] = as2 || as3;
  }
}

/* One step: set the inputs, advance, read the outputs. */
static void advance(const Fmu *fmu, double now, double step, const Group *inputs, double *in, const Group *outputs, double *out) {
  bool event, terminate, early;
  double last;
  set(fmu, inputs, in);
  if (fmu->version == 2) check(fmu->do_step2(fmu->instance, now, step, 1), "step");
  else check(fmu->do_step3(fmu->instance, now, step, true, &event, &terminate, &early, &last), "step");
  get(fmu, outputs, out);
}

/* A CSV file in memory: names of its columns, and numbers by rows. */
typedef struct {
  char **names;
  double *values;
  size_t rows, columns;
} Table;

static Table read_csv(const char *path) {
  Table table = {NULL, NULL, 0, 0};
  char *text = read_file(path), *at = text;
  if (!text) fail("cannot read ", path);
  for (bool more = true; more;) { /* names; those that contain a comma are quoted */
    bool quoted = *at == '"';
    char *begin = at += quoted, *end;
    while (*at && *at != '\n' && (quoted ? *at != '"' : *at != ',')) at++;
    end = at;
    if (quoted && *at == '"') at++;
    if (end > begin && end[-1] == '\r') end--;
    more = *at == ',';
    if (*at) at++;
    *end = 0;
    table.names = realloc(table.names, (table.columns + 1) * sizeof *table.names);
    table.names[table.columns++] = begin;
  }
  for (size_t filled = 0, room = 0; *at;) {
    char *end;
    double value = strtod(at, &end);
    if (end == at) break;
    if (filled == room) table.values = realloc(table.values, (room = 2 * room + 4096) * sizeof *table.values);
    table.values[filled++] = value;
    at = end + strspn(end, ",\r\n");
    table.rows = filled / table.columns;
  }
  if (*at) fail("not a number: ", at);
  return table; /* the names point into `text`, which is not freed */
}

/* For each element of the variables: the column with its name, or -1. */
static long *columns_of(const Variable *variables, size_t count, size_t elements, const Table *table) {
  long *found = malloc((elements + 1) * sizeof *found);
  size_t k = 0;
  for (size_t i = 0; i < count; i++)
    for (size_t e = 0; e < variables[i].size; e++, k++) {
      char name[NAME + 64];
      element_name(&variables[i], e, name, sizeof name);
      found[k] = -1;
      for (size_t c = 0; c < table->columns; c++)
        if (!strcmp(name, table->names[c])) found[k] = (long)c;
    }
  return found;
}

static void write_csv(const char *path, const Description *d, size_t rows, double start, double step, const double *results) {
  FILE *output = fopen(path, "w");
  if (!output) fail("cannot write ", path);
  fputs("time", output);
  for (size_t i = 0; i < d->output_count; i++)
    for (size_t e = 0; e < d->outputs[i].size; e++) {
      char name[NAME + 64];
      element_name(&d->outputs[i], e, name, sizeof name);
      fprintf(output, strchr(name, ',') ? ",\"%s\"" : ",%s", name);
    }
  for (size_t r = 0; r < rows; r++) {
    fprintf(output, "\n%.17g", start + (double)(r + 1) * step);
    for (size_t e = 0; e < d->output_elements; e++) fprintf(output, ",%.17g", results[r * d->output_elements + e]);
  }
  fputc('\n', output);
  if (fclose(output)) fail("cannot write ", path);
}

int main(int argc, char **argv) {
  if (argc < 5) fail("host FMU_FOLDER INPUT.csv STEP OUTPUT.csv [RUNS]", "");
  const double step = strtod(argv[3], NULL);
  const int runs = argc > 5 ? atoi(argv[5]) : 1;
  char path[4096];
  snprintf(path, sizeof path, "%s/modelDescription.xml", argv[1]);
  char *xml = read_file(path);
  if (!xml) fail("cannot read ", path);
  const Description d = describe(xml);
  if (d.version != 2 && d.version != 3) fail("neither FMI 2 nor FMI 3: ", path);
  const Table input = read_csv(argv[2]);

  /* only the inputs that have columns are set; the others keep their start values */
  long *column = columns_of(d.inputs, d.input_count, d.input_elements, &input);
  Group inputs = {malloc((d.input_count + 1) * sizeof(uint32_t)), 0, 0, 0};
  Group outputs = {malloc((d.output_count + 1) * sizeof(uint32_t)), d.output_count, d.output_elements, d.boolean_outputs};
  for (size_t i = 0, k = 0; i < d.input_count; k += d.inputs[i++].size) {
    if (column[k] < 0) continue;
    inputs.references[inputs.count++] = d.inputs[i].reference;
    inputs.booleans += (size_t)d.inputs[i].is_boolean;
    for (size_t e = 0; e < d.inputs[i].size; e++) {
      if (column[k + e] < 0) fail("not all elements have a column: ", d.inputs[i].name);
      column[inputs.elements++] = column[k + e];
    }
  }
  for (size_t i = 0; i < d.output_count; i++) outputs.references[i] = d.outputs[i].reference;

  double *rows = malloc((input.rows * inputs.elements + 1) * sizeof *rows), start = 0.0;
  double *results = malloc((input.rows * outputs.elements + 1) * sizeof *results);
  for (size_t r = 0; r < input.rows; r++)
    for (size_t e = 0; e < inputs.elements; e++) rows[r * inputs.elements + e] = input.values[r * input.columns + (size_t)column[e]];
  for (size_t c = 0; c < input.columns; c++)
    if (!strcmp(input.names[c], "time") && input.rows) start = input.values[c];

  Fmu fmu;
  memset(&fmu, 0, sizeof fmu);
  load(&fmu, argv[1], &d);
  instantiate(&fmu, &d);
  for (int run = 0; run < runs; run++) {
    if (run) check(fmu.reset(fmu.instance), "reset");
    initialize(&fmu, start);
    const clock_t begin = clock();
    for (size_t r = 0; r < input.rows; r++)
      advance(&fmu, start + (double)r * step, step, &inputs, rows + r * inputs.elements, &outputs, results + r * outputs.elements);
    const double seconds = (double)(clock() - begin) / CLOCKS_PER_SEC;
    fprintf(stderr, "%zu steps, %.4f us a step\n", input.rows, input.rows ? seconds / (double)input.rows * 1e6 : 0.0);
  }
  check(fmu.terminate(fmu.instance), "end");
  fmu.release(fmu.instance);
  write_csv(argv[4], &d, input.rows, start, step, results);
  return 0;
}
