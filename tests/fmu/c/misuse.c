/* Every wrong call to an FMU, compiled with its sources and the sanitizers (test_host.py), must give an error and a message and
 * change nothing.  FMI is 2 or 3.  Prints one line for each check that failed; exit status 0 if none did.
 *
 *     misuse modelDescription.xml STEP
 */
#include <math.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "description.h"

enum { STEPS = 400, HALF = 150 };

static int messages, failures, checks;
static char last_message[512];

#if FMI == 2
#include "fmi2Functions.h"
typedef fmi2Component Instance;
typedef fmi2FMUstate Saved;
#define F(name) fmi2##name

static void logger(fmi2ComponentEnvironment e, fmi2String i, fmi2Status s, fmi2String c, fmi2String format, ...) {
  va_list values;
  (void)e, (void)i, (void)s, (void)c;
  messages++;
  va_start(values, format);
  vsnprintf(last_message, sizeof last_message, format, values);
  va_end(values);
}
static const fmi2CallbackFunctions callbacks = {logger, calloc, free, NULL, NULL};
static Instance make(const char *name, const char *token) {
  return fmi2Instantiate(name, fmi2CoSimulation, token, "", &callbacks, fmi2False, fmi2False);
}
static int enter(Instance c) { return fmi2SetupExperiment(c, 0, 0.0, 0.0, 0, 0.0) | fmi2EnterInitializationMode(c); }
static int set(Instance c, const uint32_t *r, size_t n, const double *v, size_t nv) { return (void)nv, fmi2SetReal(c, r, n, v); }
static int get(Instance c, const uint32_t *r, size_t n, double *v, size_t nv) { return (void)nv, fmi2GetReal(c, r, n, v); }
static int step_to(Instance c, double t, double h) { return fmi2DoStep(c, t, h, fmi2True); }
static int save(Instance c, Saved *s) { return fmi2GetFMUstate(c, s); }
static int restore(Instance c, Saved s) { return fmi2SetFMUstate(c, s); }
static int drop(Instance c, Saved *s) { return fmi2FreeFMUstate(c, s); }
static int size_of(Instance c, Saved s, size_t *n) { return fmi2SerializedFMUstateSize(c, s, n); }
static int write_state(Instance c, Saved s, char *b, size_t n) { return fmi2SerializeFMUstate(c, s, b, n); }
static int read_state(Instance c, const char *b, size_t n, Saved *s) { return fmi2DeSerializeFMUstate(c, b, n, s); }
#else
#include "fmi3Functions.h"
typedef fmi3Instance Instance;
typedef fmi3FMUState Saved;
#define F(name) fmi3##name

static void logger(fmi3InstanceEnvironment e, fmi3Status s, fmi3String c, fmi3String message) {
  (void)e, (void)s, (void)c;
  messages++;
  snprintf(last_message, sizeof last_message, "%s", message);
}
static Instance make(const char *name, const char *token) {
  return fmi3InstantiateCoSimulation(name, token, "", false, false, false, false, NULL, 0, NULL, logger, NULL);
}
static int enter(Instance c) { return fmi3EnterInitializationMode(c, false, 0.0, 0.0, false, 0.0); }
static int set(Instance c, const uint32_t *r, size_t n, const double *v, size_t nv) { return fmi3SetFloat64(c, r, n, v, nv); }
static int get(Instance c, const uint32_t *r, size_t n, double *v, size_t nv) { return fmi3GetFloat64(c, r, n, v, nv); }
static int step_to(Instance c, double t, double h) {
  bool event, terminate, early;
  double last;
  return fmi3DoStep(c, t, h, true, &event, &terminate, &early, &last);
}
static int save(Instance c, Saved *s) { return fmi3GetFMUState(c, s); }
static int restore(Instance c, Saved s) { return fmi3SetFMUState(c, s); }
static int drop(Instance c, Saved *s) { return fmi3FreeFMUState(c, s); }
static int size_of(Instance c, Saved s, size_t *n) { return fmi3SerializedFMUStateSize(c, s, n); }
static int write_state(Instance c, Saved s, char *b, size_t n) { return fmi3SerializeFMUState(c, s, (fmi3Byte *)b, n); }
static int read_state(Instance c, const char *b, size_t n, Saved *s) {
  return fmi3DeserializeFMUState(c, (const fmi3Byte *)b, n, s);
}
#endif

static Description d;
static double step, *results;
static uint32_t *in_references, *out_references;
static size_t numbers_in, numbers_out, elements_out; /* without the Booleans */

static void expect(int holds, const char *what) {
  checks++;
  if (!holds) failures++, printf("FAILED: %s (last message: %s)\n", what, last_message);
}

/* A call that must be refused with a reason. */
#define REFUSED(call, what)                                                                  \
  do {                                                                                       \
    const int before = messages, status = (int)(call);                                       \
    expect(status >= 2 && status <= 4 && messages > before, what ": must be an error told"); \
  } while (0)

/* A call without an instance: an error without a message. */
#define NO_INSTANCE(call, what) expect((int)(call) >= 2, what " without an instance: must be an error")

static void good(int status, const char *what) { expect(status == 0, what); }

static void begin(Instance c) {
  good(enter(c), "enter initialization");
  good((int)F(ExitInitializationMode)(c), "exit initialization");
}

static Instance started(const char *name) {
  Instance c = make(name, d.token);
  expect(c != NULL, "instantiate");
  begin(c);
  return c;
}

/* Increments of a small rotation and vibration; the other inputs keep their start values. */
static void feed(Instance c, int k) {
  for (size_t i = 0; i < numbers_in; i++) {
    const bool angle = !strncmp(d.inputs[i].name, "delta_angle", 11), velocity = !strncmp(d.inputs[i].name, "delta_velocity", 14);
    double values[3];
    if ((!angle && !velocity) || d.inputs[i].is_boolean) continue;
    for (size_t e = 0; e < d.inputs[i].size; e++) {
      const char *place = strchr(d.inputs[i].name, '[');
      const int axis = place ? atoi(place + 1) - 1 : (int)e;
      const double wave = sin(0.03 * k + axis);
      values[e] = angle ? 1e-4 * wave : (0.02 * wave + (axis == 2 ? -9.8 : 0.0)) * step;
    }
    good(set(c, &in_references[i], 1, values, d.inputs[i].size), "set an input");
  }
}

static void advance(Instance c, int from, int to, double *out) {
  for (int k = from; k < to; k++) {
    feed(c, k);
    good(step_to(c, k * step, step), "step");
    good(get(c, out_references, numbers_out, out + (size_t)k * elements_out, elements_out), "outputs");
  }
}

static int same(const double *a, const double *b, int from, int to) {
  const size_t n = elements_out;
  return !memcmp(a + (size_t)from * n, b + (size_t)from * n, (size_t)(to - from) * n * sizeof *a);
}

static void instances_refused(void) {
  int before = messages;
  expect(make(NULL, d.token) == NULL, "instantiate without a name");
  expect(make("", d.token) == NULL, "instantiate with an empty name");
  expect(make("x", NULL) == NULL, "instantiate without a token");
  expect(make("x", "{not the token}") == NULL, "instantiate with a wrong token");
  expect(messages >= before + 4, "a refused instance is told of");
#if FMI == 2
  expect(fmi2Instantiate("x", fmi2ModelExchange, d.token, "", &callbacks, 0, 0) == NULL, "instantiate for Model Exchange");
  expect(fmi2Instantiate("x", fmi2CoSimulation, d.token, NULL, NULL, 0, 0) == NULL, "instantiate without callbacks");
#else
  expect(fmi3InstantiateModelExchange("x", d.token, "", 0, 0, NULL, logger) == NULL, "instantiate for Model Exchange");
  expect(fmi3InstantiateScheduledExecution("x", d.token, "", 0, 0, NULL, logger, NULL, NULL, NULL) == NULL,
         "instantiate for Scheduled Execution");
  Instance quiet = fmi3InstantiateCoSimulation("x", d.token, NULL, 0, 0, 0, 0, NULL, 0, NULL, NULL, NULL);
  expect(quiet != NULL, "instantiate without a logger");
  expect(step_to(quiet, 0.0, step) >= 2, "a step too early, with nobody to tell");
  fmi3FreeInstance(quiet);
#endif
  F(FreeInstance)(NULL);
}

static void without_instance(void) {
  double value = 0.0;
  uint32_t reference = out_references[0];
  Saved saved = NULL;
  size_t size = 0;
  char byte = 0;
  NO_INSTANCE(enter(NULL), "enter initialization");
  NO_INSTANCE(F(ExitInitializationMode)(NULL), "exit initialization");
  NO_INSTANCE(F(Terminate)(NULL), "terminate");
  NO_INSTANCE(F(Reset)(NULL), "reset");
  NO_INSTANCE(set(NULL, &reference, 1, &value, 1), "set");
  NO_INSTANCE(get(NULL, &reference, 1, &value, 1), "get");
  NO_INSTANCE(step_to(NULL, 0.0, step), "step");
  NO_INSTANCE(save(NULL, &saved), "get state");
  NO_INSTANCE(restore(NULL, saved), "set state");
  NO_INSTANCE(drop(NULL, &saved), "free state");
  NO_INSTANCE(size_of(NULL, saved, &size), "size of state");
  NO_INSTANCE(write_state(NULL, saved, &byte, 1), "serialize");
  NO_INSTANCE(read_state(NULL, &byte, 1, &saved), "deserialize");
  NO_INSTANCE(F(SetDebugLogging)(NULL, 1, 0, NULL), "debug logging");
}

static void wrong_order(void) {
  double value = 0.0;
  Instance c = make("order", d.token);
  REFUSED(step_to(c, 0.0, step), "a step before the initialization");
  REFUSED(F(ExitInitializationMode)(c), "leaving an initialization never entered");
  REFUSED(F(Terminate)(c), "the end before the beginning");
  good(enter(c), "enter initialization");
  REFUSED(enter(c), "entering twice");
  REFUSED(step_to(c, 0.0, step), "a step during the initialization");
  good((int)F(ExitInitializationMode)(c), "exit initialization");
  REFUSED(F(ExitInitializationMode)(c), "leaving twice");
  REFUSED(enter(c), "entering while stepping");
  advance(c, 0, 1, results);
  good((int)F(Terminate)(c), "terminate");
  REFUSED(step_to(c, step, step), "a step after the end");
  REFUSED(set(c, numbers_in ? in_references : out_references, 1, &value, 1), "setting after the end");
  REFUSED(F(Terminate)(c), "ending twice");
  good((int)F(Reset)(c), "reset");
  REFUSED(step_to(c, 0.0, step), "a step after a reset");
  F(FreeInstance)(c);
}

static void wrong_steps(Instance c, double now) {
  const double wrong[] = {0.0, -step, 1.5 * step, 0.1 * step, 2e-6 * step, NAN, INFINITY, -INFINITY, 1e300};
  const double times[] = {now + step, now - step, NAN, INFINITY, -1e300};
  good(step_to(c, now, 1e-9 * step), "the rest of a sum of steps, which changes nothing");
  for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++) REFUSED(step_to(c, now, wrong[i]), "a wrong step");
  for (size_t i = 0; i < sizeof times / sizeof *times; i++) REFUSED(step_to(c, times[i], step), "a wrong time");
}

/* Whether a Boolean can switch the input off; only a step whose Boolean is true then refuses its value. */
static bool can_be_off(const char *name) { return !strncmp(name, "gnss_", 5) || !strncmp(name, "command_", 8); }

static void wrong_values(Instance c) {
  static double values[4096];
  const double bad[] = {NAN, INFINITY, -INFINITY};
  const uint32_t unknown[] = {UINT32_MAX, 1u << 20};
  for (size_t i = 0; i < 2; i++) {
    REFUSED(get(c, &unknown[i], 1, values, 1), "an unknown variable read");
    REFUSED(set(c, &unknown[i], 1, values, 1), "an unknown variable set");
  }
  REFUSED(set(c, out_references, 1, values, d.outputs[0].size), "an output set");
  REFUSED(get(c, NULL, 1, values, 1), "references at NULL");
  REFUSED(get(c, out_references, 1, NULL, d.outputs[0].size), "values at NULL");
  good(get(c, NULL, 0, NULL, 0), "nothing read");
  good(set(c, NULL, 0, NULL, 0), "nothing set");
  for (size_t i = 0; i < numbers_in; i++) {
    const size_t n = d.inputs[i].size;
    for (size_t b = 0; b < 3; b++) {
      for (size_t e = 0; e < n; e++) values[e] = 0.0;
      values[n - 1] = bad[b];
      if (!can_be_off(d.inputs[i].name))
        REFUSED(set(c, &in_references[i], 1, values, n), "an input that is no finite number");
    }
    REFUSED(set(c, &in_references[i], 1, NULL, n), "an input at NULL");
    REFUSED(set(c, NULL, 1, values, n), "references at NULL");
  }
#if FMI == 3
  REFUSED(get(c, out_references, 1, values, d.outputs[0].size + 1), "more values than the variable has");
  REFUSED(get(c, out_references, 1, values, SIZE_MAX), "far more values than the variable has");
#endif
}

static void wrong_states(Instance c) {
  Saved saved = NULL, other = NULL;
  size_t size = 0;
  good(save(c, &saved), "get state");
  good(save(c, &saved), "get state into the one handed out before");
  good(size_of(c, saved, &size), "size of state");
  char *bytes = malloc(size), *broken = malloc(size + 1);
  good(write_state(c, saved, bytes, size), "serialize");
  REFUSED(save(c, NULL), "a state to NULL");
  REFUSED(restore(c, NULL), "a state from NULL");
  REFUSED(size_of(c, NULL, &size), "the size of no state");
  REFUSED(size_of(c, saved, NULL), "a size to NULL");
  REFUSED(write_state(c, saved, bytes, size - 1), "serialize into too little");
  REFUSED(write_state(c, saved, NULL, size), "serialize to NULL");
  REFUSED(write_state(c, NULL, bytes, size), "serialize no state");
  REFUSED(read_state(c, NULL, size, &other), "deserialize from NULL");
  REFUSED(read_state(c, bytes, size, NULL), "deserialize to NULL");
  REFUSED(read_state(c, bytes, 0, &other), "deserialize nothing");
  REFUSED(read_state(c, bytes, size - 1, &other), "deserialize what is cut off");
  memcpy(broken, bytes, size);
  REFUSED(read_state(c, broken, size + 1, &other), "deserialize what is too long");
  uint32_t random = 12345;
  for (int trial = 0; trial < 200; trial++) { /* all parts, and at times the first and last byte */
    memcpy(broken, bytes, size);
    random = random * 1664525u + 1013904223u;
    broken[trial == 0 ? 0 : trial == 1 ? size - 1 : random % size] ^= (char)(1 + (random >> 28));
    REFUSED(read_state(c, broken, size, &other), "deserialize what is damaged");
  }
  expect(other == NULL, "no state comes from what is refused");
  good(drop(c, &other), "free no state");
  good(drop(c, NULL), "free nothing");
  good(drop(c, &saved), "free state");
  expect(saved == NULL, "a freed state is forgotten");
  free(bytes), free(broken);
}

int main(int argc, char **argv) {
  char *xml = argc < 3 ? NULL : read_file(argv[1]);
  if (!xml) return 2;
  d = describe(xml);
  step = atof(argv[2]);
  numbers_in = d.input_count - d.boolean_inputs;
  numbers_out = d.output_count - d.boolean_outputs;
  elements_out = d.output_elements - d.boolean_outputs;
  in_references = malloc((numbers_in + 1) * sizeof *in_references);
  out_references = malloc((numbers_out + 1) * sizeof *out_references);
  for (size_t i = 0; i < numbers_in; i++) in_references[i] = d.inputs[i].reference;
  for (size_t i = 0; i < numbers_out; i++) out_references[i] = d.outputs[i].reference;
  results = calloc((size_t)STEPS * elements_out, sizeof *results);
  double *again = calloc((size_t)STEPS * elements_out, sizeof *again);

  instances_refused();
  without_instance();
  wrong_order();

  /* two instances in turn, one with all wrong calls in between */
  Instance a = started("a"), b = started("b");
  for (int k = 0; k < STEPS; k++) {
    advance(a, k, k + 1, results);
    advance(b, k, k + 1, again);
    if (k % 50 == 0) wrong_steps(b, (k + 1) * step), wrong_values(b);
    if (k == HALF) wrong_states(b);
  }
  expect(same(results, again, 0, STEPS), "refused calls change nothing");
  Saved end = NULL;
  good(save(a, &end), "get state");
  good((int)F(Reset)(a), "reset");
  begin(a);
  memset(again, 0, (size_t)STEPS * elements_out * sizeof *again);
  advance(a, 0, STEPS, again);
  expect(same(results, again, 0, STEPS), "a reset instance begins anew");
  good(restore(a, end), "set state");
  good(drop(a, &end), "free state");
  good((int)F(Terminate)(b), "terminate");
  F(FreeInstance)(a), F(FreeInstance)(b);
  free(again), free(results), free(in_references), free(out_references);
  free(xml), free(d.inputs), free(d.outputs);
  printf("%d checks, %d failed\n", checks, failures);
  return failures != 0;
}
