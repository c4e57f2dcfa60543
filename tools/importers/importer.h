/* Runs an FMU in an importer's library: arguments FMU FOLDER PLAN OUTPUT.  fmil.c and fmi4c.c implement the functions below.
 *
 * PLAN is text: the number of steps, the step in s, the number of inputs and of outputs; of each its name and number of
 * elements; then the values of the inputs for each step.  OUTPUT gets the outputs after each step as binary doubles.
 */
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { MOST = 4096 };
typedef struct {
  uint32_t reference;
  int is_boolean;
} Found;

void open_fmu(const char *path, const char *folder);
Found find(const char *name, int elements); /* fails if the importer's description has another number of elements */
int set_numbers(uint32_t reference, const double *values, size_t count);
int set_boolean(uint32_t reference, int value);
int get_numbers(uint32_t reference, double *values, size_t count);
int get_boolean(uint32_t reference, int *value);
int do_step(double time, double step);
void close_fmu(void);

static void need(int good, const char *what) {
  if (!good) fprintf(stderr, "importer: %s failed\n", what), exit(1);
}

typedef struct {
  Found found;
  size_t elements;
} Port;

static void read_ports(FILE *plan, Port *ports, size_t count) {
  char name[256];
  for (size_t i = 0; i < count; i++) {
    need(fscanf(plan, "%255s %zu", name, &ports[i].elements) == 2, "reading the names");
    ports[i].found = find(name, (int)ports[i].elements);
  }
}

int main(int argc, char **argv) {
  static Port inputs[MOST], outputs[MOST];
  static double values[MOST];
  size_t steps, n_in, n_out;
  double step;
  need(argc == 5, "FMU FOLDER PLAN OUTPUT");
  FILE *plan = fopen(argv[3], "r"), *written = fopen(argv[4], "wb");
  need(plan && written, "opening the files");
  open_fmu(argv[1], argv[2]);
  need(fscanf(plan, "%zu %lf %zu %zu", &steps, &step, &n_in, &n_out) == 4 && n_in <= MOST && n_out <= MOST, "reading the plan");
  read_ports(plan, inputs, n_in);
  read_ports(plan, outputs, n_out);
  for (size_t k = 0; k < steps; k++) {
    for (size_t i = 0; i < n_in; i++) {
      const Port *p = &inputs[i];
      for (size_t e = 0; e < p->elements; e++) need(fscanf(plan, "%lf", &values[e]) == 1, "reading the inputs");
      need((p->found.is_boolean ? set_boolean(p->found.reference, values[0] != 0)
                                : set_numbers(p->found.reference, values, p->elements)) == 0, "setting an input");
    }
    need(do_step((double)k * step, step) == 0, "the step");
    for (size_t i = 0; i < n_out; i++) {
      const Port *p = &outputs[i];
      int flag = 0;
      need((p->found.is_boolean ? get_boolean(p->found.reference, &flag)
                                : get_numbers(p->found.reference, values, p->elements)) == 0, "reading an output");
      if (p->found.is_boolean) values[0] = flag;
      need(fwrite(values, sizeof *values, p->elements, written) == p->elements, "writing");
    }
  }
  close_fmu();
  return fclose(written);
}
