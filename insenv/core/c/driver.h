/* The driver: noise, schedule and sampling loop of a model, for one row (C, real = double) or a block of LANES rows (C++).
 *
 * Written once for both; `generated code` above has defined
 *   N_PARAMETER, N_STATE, N_OUTPUT, N_UNIFORMS (the largest number that a function takes), SEED_PLACE (in p), STEP_PLACE (in x),
 *   and START_UNIFORMS.  The line SCHEDULE below is where the generator puts the model's schedule as functions:
 *   `advance(p, x, u)`, the steps in order, each if its condition is not zero, and `run_step(k, p, x, u)`, one of them.
 */
#include <stdint.h>
#include <string.h>

/* Philox 4x32-10: Salmon, Moraes, Dror, Shaw, "Parallel random numbers: as easy as 1, 2, 3", SC11 (2011). */
static void philox(const uint32_t key[2][LANES], uint32_t word[4][LANES]) {
  uint32_t key0[LANES], key1[LANES];
  for (int i = 0; i < LANES; ++i) key0[i] = key[0][i], key1[i] = key[1][i];
  for (int round = 0; round < 10; ++round) {
    for (int i = 0; i < LANES; ++i) {
      uint64_t product0 = (uint64_t)0xD2511F53u * word[0][i];
      uint64_t product1 = (uint64_t)0xCD9E8D57u * word[2][i];
      word[0][i] = (uint32_t)(product1 >> 32) ^ word[1][i] ^ key0[i];
      word[2][i] = (uint32_t)(product0 >> 32) ^ word[3][i] ^ key1[i];
      word[1][i] = (uint32_t)product1;
      word[3][i] = (uint32_t)product0;
      key0[i] += 0x9E3779B9u;
      key1[i] += 0xBB67AE85u;
    }
  }
}

/* `count` uniforms in (0, 1), a pure function of (seed, step, stream): see insenv/core/noise.py, which this equals to the bit. */
static void uniforms(real seed, real step, uint32_t stream, int count, real *r) {
  uint32_t key[2][LANES], low[LANES], high[LANES], word[4][LANES];
  for (int i = 0; i < LANES; ++i) {
    uint64_t s = (uint64_t)LANE(seed, i), k = (uint64_t)LANE(step, i);
    key[0][i] = (uint32_t)s, key[1][i] = (uint32_t)(s >> 32);
    low[i] = (uint32_t)k, high[i] = (uint32_t)(k >> 32);
  }
  for (int block = 0; 4 * block < count; ++block) {
    for (int i = 0; i < LANES; ++i)
      word[0][i] = low[i], word[1][i] = high[i], word[2][i] = stream, word[3][i] = (uint32_t)block;
    philox(key, word);
    for (int j = 0; j < 4 && 4 * block + j < count; ++j)
      for (int i = 0; i < LANES; ++i) LANE(r[4 * block + j], i) = ((double)word[j][i] + 0.5) * 0x1p-32;
  }
}

/* Run step number k where `mask` is not zero.  The function gives only what it changes; `lay` puts that into the state. */
#define RUN_STEP(k, function, lay, count, mask)                                        \
  do {                                                                                 \
    real r[(count) + 1], changed[N_STATE + 1];                                         \
    if (count) uniforms(p[SEED_PLACE], x[STEP_PLACE], (uint32_t)(k), (count), r);      \
    const real *arg[4] = {p, x, u, r};                                                 \
    real *res[1] = {changed};                                                          \
    function(arg, res, 0, 0, 0);                                                       \
    lay(x, changed, mask);                                                             \
  } while (0)

/* Elements [start, stop) of the state from the next ones of `changed`. */
#define LAY(start, stop, from)                                                         \
  if (whole)                                                                           \
    memcpy(x + (start), changed + (from), ((stop) - (start)) * sizeof(real));          \
  else                                                                                 \
    for (int i = (start); i < (stop); ++i) x[i] = blend(mask, changed[i - (start) + (from)], x[i]);

SCHEDULE

static void outputs(const real *p, const real *x, real *y) {
  const real *arg[2] = {p, x};
  real *res[1] = {y};
  output(arg, res, 0, 0, 0);
}

/* n advances of each of `blocks` blocks from its state x, left in x.  A block's inputs move by u_stride elements an advance (0: held)
 * and by u_block from block to block.  Every `every` advances (0: never) the outputs are written to y, one vector after the
 * other, block after block. */
EXPORT void insenv_run(int64_t blocks, const real *p, real *x, const real *u, int64_t u_stride, int64_t u_block, real *y,
                       int64_t every, int64_t n) {
  for (int64_t block = 0; block < blocks; ++block, p += N_PARAMETER, x += N_STATE, u += u_block) {
    const real *input = u;
    for (int64_t k = 1; k <= n; ++k, input += u_stride) {
      advance(p, x, input);
      if (every && k % every == 0) outputs(p, x, y), y += N_OUTPUT;
    }
  }
}

/* A round of each block, its input held: step number k whatever its condition (none if negative), then n advances.  To each row
 * of y (LANES of a block, each `width` long) go, after each advance, the spans [spans[2j], spans[2j + 1]) of the state, and at
 * last the outputs. */
EXPORT void insenv_round(int64_t blocks, int64_t k, const real *p, real *x, const real *u, int64_t u_block, const int64_t *spans,
                         int64_t count, int64_t n, int64_t width, double *y) {
  for (int64_t block = 0; block < blocks; ++block, p += N_PARAMETER, x += N_STATE, u += u_block, y += LANES * width) {
    real told[N_OUTPUT + 1];
    double *at = y;
    if (k >= 0) run_step((int)k, p, x, u);
    for (int64_t i = 0; i < n; ++i) {
      advance(p, x, u);
      for (int64_t j = 0; j < 2 * count; j += 2)
        for (int64_t from = spans[j]; from < spans[j + 1]; ++from, ++at)
          for (int lane = 0; lane < LANES; ++lane) at[lane * width] = LANE(x[from], lane);
    }
    outputs(p, x, told);
    for (int64_t i = 0; i < N_OUTPUT; ++i, ++at)
      for (int lane = 0; lane < LANES; ++lane) at[lane * width] = LANE(told[i], lane);
  }
}

/* The states at the start. */
EXPORT void insenv_start(int64_t blocks, const real *p, real *x) {
  for (int64_t block = 0; block < blocks; ++block, p += N_PARAMETER, x += N_STATE) {
    real r[N_UNIFORMS + 1];
    if (START_UNIFORMS) uniforms(p[SEED_PLACE], 0.0, 0xFFFFFFFFu, START_UNIFORMS, r);
    const real *arg[2] = {p, r};
    real *res[1] = {x};
    start(arg, res, 0, 0, 0);
  }
}

/* The outputs of the states. */
EXPORT void insenv_output(int64_t blocks, const real *p, const real *x, real *y) {
  for (int64_t block = 0; block < blocks; ++block, p += N_PARAMETER, x += N_STATE, y += N_OUTPUT) outputs(p, x, y);
}

/* Prepared calls on one instance, cheap to make from an interpreter: the addresses stand in `at` = {p, x, u, y}. */
EXPORT void insenv_advance_at(void *const at[4]) { advance((const real *)at[0], (real *)at[1], (const real *)at[2]); }
EXPORT void insenv_output_at(void *const at[4]) { outputs((const real *)at[0], (const real *)at[1], (real *)at[3]); }
EXPORT void insenv_step_at(void *const at[4], int k) {
  run_step(k, (const real *)at[0], (real *)at[1], (const real *)at[2]);
}

EXPORT void insenv_round_at(void *const at[5], int64_t k, int64_t count, int64_t n) {
  insenv_round(1, k, (const real *)at[0], (real *)at[1], (const real *)at[2], 0, (const int64_t *)at[3], count, n, 0,
               (double *)at[4]);
}

EXPORT int insenv_lanes(void) { return LANES; }
