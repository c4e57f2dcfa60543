/* Whether @name@ gives the outputs that insenv has computed from the same inputs, to the bit.
 *
 * It reads the inputs and outputs of samples.h and, if it is given a file name, those of a whole run; it prints what differs.
 * With MEASURED the target gives `instructions()`, which counts them, and what each step takes is printed too.
 */
#include "samples.h"

#include <stdio.h>
#include <string.h>

#define N_INPUT (sizeof(@name@_inputs) / sizeof(double))
#define N_OUTPUT (sizeof(@name@_outputs) / sizeof(double))

static @name@ filter;
static @name@_outputs outputs;
static unsigned long compared, differing;

#ifdef MEASURED
extern unsigned long instructions(void);

/* Of each step, and of a whole sample at the end; what the counting itself takes is left out. */
static unsigned long calls[N_STEP + 1], most[N_STEP + 1], begun, sum;
static double total[N_STEP + 1];
static const char *const names_of_steps[N_STEP + 1] = STEP_NAMES;

static void count(int step, unsigned long taken) {
  calls[step] += 1;
  total[step] += (double)taken;
  if (taken > most[step]) most[step] = taken;
}

void step_done(int step) {
  const unsigned long taken = instructions() - begun;
  count(step, taken);
  sum += taken;
  begun = instructions();
}
#endif

/* Compare the outputs with those expected; after: number of samples before. */
static int judge(const double *wanted, unsigned long after) {
  double values[N_OUTPUT];
  const int status = @name@_output(&filter, &outputs);
  if (status != @NAME@_OK) {
    printf("output: status %d, value %d, after %lu samples\n", status, filter.wrong, after);
    return 0;
  }
  (void)memcpy(values, &outputs, sizeof values);
  for (size_t i = 0; i < N_OUTPUT; ++i) {
    compared += 1;
    if (memcmp(&values[i], &wanted[i], sizeof values[i]) != 0) {
      if (differing == 0)
        printf("value %lu after %lu samples: %.17g, expected %.17g\n", (unsigned long)i, after, values[i], wanted[i]);
      differing += 1;
    }
  }
  return 1;
}

static int take(const double *given, unsigned long before) {
  @name@_inputs inputs;
  int status;
  (void)memcpy(&inputs, given, sizeof inputs);
#ifdef MEASURED
  sum = 0;
  begun = instructions();
#endif
  status = @name@_sample(&filter, &inputs);
#ifdef MEASURED
  count(N_STEP, sum + instructions() - begun);
#endif
  if (status != @NAME@_OK) printf("sample %lu: status %d, value %d\n", before, status, filter.wrong);
  return status == @NAME@_OK;
}

static int start(void) {
  const int status = @name@_init(&filter, &@name@_defaults);
  compared = differing = 0;
  if (status != @NAME@_OK) printf("init: status %d, value %d\n", status, filter.wrong);
  return status == @NAME@_OK && judge(outputs_at_start, 0);
}

static int tell(const char *what, unsigned long taken) {
  printf("%s: %lu samples, %lu numbers compared, %lu differ\n", what, taken, compared, differing);
  return differing == 0;
}

/* The samples of samples.h. */
static int check_samples(void) {
  unsigned long k;
  if (!start()) return 0;
  for (k = 0; k < SAMPLES; ++k) {
    if (!take(first_inputs[k], k)) return 0;
    if ((k + 1) % EVERY == 0 && !judge(first_outputs[(k + 1) / EVERY - 1], k + 1)) return 0;
  }
  return tell("samples.h", k);
}

/* The samples of a file: the inputs of RUN_EVERY samples, then the outputs, and so on. */
static int check_run(const char *name) {
  static double row[N_INPUT], last[N_OUTPUT];
  unsigned long k = 0;
  size_t bytes = 0;
  int good = 1;
  FILE *run;
  if (!start()) return 0;
  run = fopen(name, "rb");
  if (run == NULL) {
    printf("%s: cannot be read\n", name);
    return 0;
  }
  while (good && (bytes = fread(row, 1, sizeof row, run)) == sizeof row) {
    good = take(row, k);
    k += 1;
    if (good && k % RUN_EVERY == 0) good = fread(last, sizeof last, 1, run) == 1 && judge(last, k);
  }
  (void)fclose(run);
  return tell(name, k) && good && k > 0 && k % RUN_EVERY == 0 && bytes == 0;
}

int main(int count_of_names, char **names) {
  int same = check_samples();
  if (same && count_of_names > 1) same = check_run(names[1]);
#ifdef MEASURED
  for (int step = 0; step <= N_STEP; ++step)
    if (calls[step] > 0)
      printf("%s: %lu calls, mean %.0f, most %lu instructions\n", names_of_steps[step], calls[step],
             total[step] / (double)calls[step], most[step]);
#endif
  printf(same ? "same bits\n" : "NOT the same bits\n");
  return !same;
}
