/* The driver: noise, steps and sampling loop of a model, for one row (real = double) or a block of LANES rows.
 *
 * The same text serves both.  The generated code above it defines
 *   N_PARAMETER, N_STATE, N_INPUT, N_OUTPUT, N_UNIFORMS (the largest number that a function takes), SEED_PLACE (in p), STEP_PLACE (in x),
 *   and START_UNIFORMS.  The generator replaces the line STEPS below by two functions:
 *   `advance(p, x, u)`, which runs the steps in order, each if its condition is not zero, and `run_step(k, p, x, u)`, which runs one.
 */
#include <string.h>

/* Philox 4x32-10: Salmon, Moraes, Dror, Shaw, "Parallel random numbers: as easy as 1, 2, 3", SC11 (2011).  A number of 32 bits
 * is stored in the low half of a `word`; the high half is arbitrary.
 */
static inline void philox(word key0, word key1, word number[4]) {
#pragma GCC unroll 10
  for (int round = 0; round < 10; ++round) {
    word product0 = product(number[0], 0xD2511F53u), product1 = product(number[2], 0xCD9E8D57u);
    number[0] = (product1 >> 32) ^ number[1] ^ key0;
    number[2] = (product0 >> 32) ^ number[3] ^ key1;
    number[1] = product1;
    number[3] = product0;
    key0 += 0x9E3779B9u;
    key1 += 0xBB67AE85u;
  }
}

/* `count` uniforms in (0, 1), a pure function of (seed, step, stream): bit-identical to insenv/core/noise.py. */
static inline void uniforms(real seed, real step, uint32_t stream, int count, real *r) {
  word key[2], counter[2];
  halves(seed, key), halves(step, counter);
#pragma GCC unroll 2
  for (int block = 0; 4 * block < count; ++block) {
    word number[4] = {counter[0], counter[1], alike(stream), alike((uint32_t)block)};
    philox(key[0], key[1], number);
    for (int j = 0; j < 4 && 4 * block + j < count; ++j) r[4 * block + j] = uniform(number[j]);
  }
}

/* Run step number k, which writes its results directly into the state. */
#define RUN_STEP(k, function, count)                                                   \
  do {                                                                                 \
    real r[(count) + 1];                                                               \
    if (count) uniforms(p[SEED_PLACE], x[STEP_PLACE], (uint32_t)(k), (count), r);      \
    else r[0] = constant(0.0);                                                         \
    function(p, x, u, r);                                                              \
  } while (0)

/* Run step number k where `mask` is not zero.  The function returns only the rows it changes; `lay` copies them into the state. */
#define RUN_STEP_WHERE(k, function, lay, count, mask)                                  \
  do {                                                                                 \
    ON_A_LINE real r[(count) + 1], changed[N_STATE + 1];                               \
    if (count) uniforms(p[SEED_PLACE], x[STEP_PLACE], (uint32_t)(k), (count), r);      \
    else r[0] = constant(0.0);                                                         \
    function(p, x, u, r, changed);                                                     \
    lay(x, changed, mask);                                                             \
  } while (0)

/* Elements [start, stop) of the state from the next ones of `changed`. */
#define LAY(start, stop, from)                                                         \
  if (whole)                                                                           \
    memcpy(x + (start), changed + (from), ((stop) - (start)) * sizeof(real));          \
  else                                                                                 \
    for (int i = (start); i < (stop); ++i) x[i] = blend(mask, changed[i - (start) + (from)], x[i]);

STEPS

/* Callers pass inputs and outputs as rows, not as blocks: the last block may have fewer than LANES rows. */

/* One input vector of a block: from `valid` rows of u that lie u_row apart. */
static inline const real *gather(const double *u, int64_t u_row, int valid, real *space) {
#if LANES == 1
  return u;
#else
  for (int i = 0; i < N_INPUT; ++i) {
    real value;
#pragma GCC unroll 8
    for (int lane = 0; lane < LANES; ++lane) value[lane] = u[(lane < valid ? lane : valid - 1) * u_row + i];
    space[i] = value;
  }
  return space;
#endif
}

static inline void scatter(const real *values, int64_t count, double *y, int64_t y_row, int valid) {
  for (int64_t i = 0; i < count; ++i)
    for (int lane = 0; lane < valid; ++lane) y[lane * y_row + i] = LANE(values[i], lane);
}

#define FOR_EACH_BLOCK                                                                          \
  for (int64_t row = 0, valid; valid = rows - row < LANES ? rows - row : LANES, row < rows;     \
       row += LANES, p += N_PARAMETER, x += N_STATE)

/* Advance each row n times, from its state in x, which is updated.  Inputs move by u_stride elements per advance (0: constant) and
 * by u_row from row to row.  After every `every`-th advance (0: never) the outputs are written to y, y_row elements per row. */
EXPORT void insenv_run(int64_t rows, const real *p, real *x, const double *u, int64_t u_stride, int64_t u_row, double *y,
                       int64_t y_row, int64_t every, int64_t n) {
  FOR_EACH_BLOCK {
    real space[N_INPUT + 1], shown[N_OUTPUT + 1];
    const double *given = u + row * u_row;
    double *at = y + row * y_row;
    const real *input = gather(given, u_row, valid, space);
    for (int64_t k = 1; k <= n; ++k) {
      advance(p, x, input);
      if (every && k % every == 0) output(p, x, shown), scatter(shown, N_OUTPUT, at, y_row, valid), at += N_OUTPUT;
      if (u_stride && k < n) input = gather(given += u_stride, u_row, valid, space);
    }
  }
}

/* One cycle of each row with constant inputs: step number k regardless of its condition (none if negative), then n advances.  Each
 * row of y (y_row long) receives the spans [spans[2j], spans[2j + 1]) of the state after each advance, then the outputs. */
EXPORT void insenv_cycle(int64_t rows, int64_t k, const real *p, real *x, const double *u, int64_t u_row, const int64_t *spans,
                         int64_t count, int64_t n, double *y, int64_t y_row) {
  FOR_EACH_BLOCK {
    real space[N_INPUT + 1], shown[N_OUTPUT + 1];
    const real *input = gather(u + row * u_row, u_row, valid, space);
    double *at = y + row * y_row;
    if (k >= 0) run_step((int)k, p, x, input);
    for (int64_t i = 0; i < n; ++i) {
      advance(p, x, input);
      for (int64_t j = 0; j < 2 * count; j += 2) {
        scatter(x + spans[j], spans[j + 1] - spans[j], at, y_row, valid);
        at += spans[j + 1] - spans[j];
      }
    }
    output(p, x, shown);
    scatter(shown, N_OUTPUT, at, y_row, valid);
  }
}

/* Set the states to their start. */
EXPORT void insenv_start(int64_t blocks, const real *p, real *x) {
  for (int64_t block = 0; block < blocks; ++block, p += N_PARAMETER, x += N_STATE) {
    real r[N_UNIFORMS + 1];
    if (START_UNIFORMS) uniforms(p[SEED_PLACE], constant(0.0), 0xFFFFFFFFu, START_UNIFORMS, r);
    else r[0] = constant(0.0);
    start(p, r, x);
  }
}

/* Compute the outputs of the states. */
EXPORT void insenv_output(int64_t blocks, const real *p, const real *x, real *y) {
  for (int64_t block = 0; block < blocks; ++block, p += N_PARAMETER, x += N_STATE, y += N_OUTPUT) output(p, x, y);
}

/* Calls on one instance that are cheap from an interpreter: `at` = {p, x, u, y} holds the addresses. */
EXPORT void insenv_advance_at(void *const at[4]) { advance((const real *)at[0], (real *)at[1], (const real *)at[2]); }
EXPORT void insenv_output_at(void *const at[4]) { output((const real *)at[0], (const real *)at[1], (real *)at[3]); }
EXPORT void insenv_step_at(void *const at[4], int k) {
  run_step(k, (const real *)at[0], (real *)at[1], (const real *)at[2]);
}

EXPORT void insenv_cycle_at(void *const at[5], int64_t k, int64_t count, int64_t n) {
  insenv_cycle(1, k, (const real *)at[0], (real *)at[1], (const double *)at[2], 0, (const int64_t *)at[3], count, n,
               (double *)at[4], 0);
}

EXPORT int insenv_lanes(void) { return LANES; }
