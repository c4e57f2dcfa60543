/* @heading@  See @name@.h. */

/* No multiplication and addition in one rounding: with them most numbers differ from those of insenv. */
#if defined(__clang__)
#pragma STDC FP_CONTRACT OFF
#elif defined(__GNUC__)
#pragma GCC optimize("fp-contract=off", "no-math-errno")
#elif defined(_MSC_VER)
#pragma fp_contract(off)
#elif !defined(@NAME@_NO_CONTRACTION)
#error "compile without contraction of floating-point expressions, then define @NAME@_NO_CONTRACTION"
#endif

#include "@name@.h"

#include <float.h>
#include <math.h>
#include <string.h>

#if defined(__FAST_MATH__)
#error "-ffast-math changes the results: leave it out"
#endif
/* 0 and 1: double as itself.  ISO/IEC TS 18661-3 adds 16 and 32, of which it is the same, and 64, float as double. */
#if defined(FLT_EVAL_METHOD) && (FLT_EVAL_METHOD != 0) && (FLT_EVAL_METHOD != 1) && (FLT_EVAL_METHOD != 16) \
    && (FLT_EVAL_METHOD != 32) && (FLT_EVAL_METHOD != 64)
#error "double is evaluated with more digits: choose arithmetic in double (on x86: -msse2 -mfpmath=sse)"
#endif
#if (DBL_MANT_DIG != 53) || (DBL_MAX_EXP != 1024)
#error "double is not IEEE 754 binary64"
#endif

/* Each of these functions keeps its local variables to itself, so that the stack holds those of one. */
#if defined(__GNUC__) || defined(__clang__)
#define APART __attribute__((noinline))
#else
#define APART
#endif

/* Called after a step has run; the numbers of the steps stand in `advance`. */
#ifdef @NAME@_STEP_DONE
#define STEP_DONE(step) @NAME@_STEP_DONE(step)
#else
#define STEP_DONE(step) ((void)0)
#endif

/* The structs of the interface are copied to and from arrays: they have no padding. */
typedef char @name@_parameters_are_doubles[(sizeof(@name@_parameters) == (@n_parameters@u * sizeof(double))) ? 1 : -1];
typedef char @name@_inputs_are_doubles[(sizeof(@name@_inputs) == (@n_inputs@u * sizeof(double))) ? 1 : -1];
typedef char @name@_outputs_are_doubles[(sizeof(@name@_outputs) == (@n_outputs@u * sizeof(double))) ? 1 : -1];

const @name@_parameters @name@_defaults = {
@defaults@
};

/* flag: number of the row that says whether this one is used, or -1.  start: stands for an unused value that is not finite. */
typedef struct {
  int place;
  int size;
  int flag;
  int whole;
  double lower;
  double upper;
  double start;
} @name@_row;

#define N_PARAMETER_ROWS (sizeof(parameter_rows) / sizeof(parameter_rows[0]))
static const @name@_row parameter_rows[] = {
@parameter_rows@
};

#define N_INPUT_ROWS (sizeof(input_rows) / sizeof(input_rows[0]))
static const @name@_row input_rows[] = {
@input_rows@
};

@functions@
static int is_finite(double value) { return (value - value) == 0.0; }

static @name@_status judged(const @name@_row *row, double value) {
  if (is_finite(value) == 0) { return @NAME@_NOT_FINITE; }
  if ((value < row->lower) || (value > row->upper)) { return @NAME@_OUT_OF_RANGE; }
  if ((row->whole != 0) && (value != floor(value))) { return @NAME@_NOT_WHOLE; }
  return @NAME@_OK;
}

/* Whether the values of a row are used: its flag is set, and so is the flag of that flag. */
static int is_used(const @name@_row *rows, const @name@_row *row, const double *values) {
  int flag = row->flag;
  while (flag >= 0) {
    if (values[rows[flag].place] == 0.0) { return 0; }
    flag = rows[flag].flag;
  }
  return 1;
}

/* Check the values of `count` rows.  *wrong: place of the first one that is not allowed. */
static @name@_status checked(const @name@_row *rows, size_t count, double *values, int *wrong) {
  for (size_t k = 0; k < count; ++k) {
    const int used = is_used(rows, &rows[k], values);
    for (int i = rows[k].place; i < (rows[k].place + rows[k].size); ++i) {
      const @name@_status status = (used != 0) ? judged(&rows[k], values[i]) : @NAME@_OK;
      if (status != @NAME@_OK) {
        *wrong = i;
        return status;
      }
      if ((used == 0) && (is_finite(values[i]) == 0)) {
        values[i] = rows[k].start;
      }
    }
  }
  return @NAME@_OK;
}

/* Whether this machine, as compiled, rounds after each operation, to nearest, and keeps subnormal numbers. */
static int is_exact(void) {
  volatile double above = 1.0 + DBL_EPSILON;
  volatile double below = 1.0 - DBL_EPSILON;
  volatile double one = 1.0;
  volatile double tiny = DBL_MIN;
  volatile double half = 0.5;
  volatile double contracted;
  volatile double subnormal;
  volatile double down;
  volatile double up;
  contracted = (above * below) - one;
  subnormal = tiny * half;
  down = one + (0.5 * half * DBL_EPSILON);
  up = one + (1.5 * half * DBL_EPSILON);
  return ((contracted == 0.0) && (subnormal != 0.0) && (down == 1.0) && (up > 1.0)) ? 1 : 0;
}

@name@_status @name@_init(@name@ *f, const @name@_parameters *parameters) {
  @name@_status status;
  if (is_exact() == 0) { return @NAME@_NOT_EXACT; }
  (void)memcpy(f->y, parameters, sizeof *parameters);
  status = checked(parameter_rows, N_PARAMETER_ROWS, f->y, &f->wrong);
  if (status != @NAME@_OK) { return status; }
  (void)memcpy(f->p, f->y, sizeof f->p);
  @start@;
  return @NAME@_OK;
}

@name@_status @name@_sample(@name@ *f, const @name@_inputs *inputs) {
  @name@_status status;
  (void)memcpy(f->u, inputs, sizeof f->u);
  status = checked(input_rows, N_INPUT_ROWS, f->u, &f->wrong);
  if (status != @NAME@_OK) { return status; }
@check_dt@@steps@
  return @NAME@_OK;
}

@name@_status @name@_output(@name@ *f, @name@_outputs *outputs) {
  @output@;
  for (int i = 0; i < @n_outputs@; ++i) {
    if (is_finite(f->y[i]) == 0) {
      f->wrong = i;
      return @NAME@_DIVERGED;
    }
  }
  (void)memcpy(outputs, f->y, sizeof *outputs);
  return @NAME@_OK;
}
