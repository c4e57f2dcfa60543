/* An instance of a sampled model: the part that FMI 2.0 and FMI 3.0 share.
 *
 * One plain struct, `State`, holds everything that a simulation changes: saving copies it, serializing writes its bytes.  Its
 * array `v` holds all variables, in the order of config.h:
 *
 *     time | parameters | inputs | outputs        (FIRST_PARAMETER, FIRST_INPUT, FIRST_OUTPUT, N_VALUE)
 *
 * config.h, which insenv writes from the model's tables, defines the sizes, ROWS (the variables: name, unit, place, size,
 * bounds), START (start values), KIND (kind of each place) and how long a communication step may be.  equations.h holds the
 * generated functions.  A function that refuses a call logs the reason and returns 0; a refused call changes nothing.
 */
#include <float.h>
#include <math.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* No fused multiply-add in any build of these sources, so that results are bit-identical to those of insenv. */
#if defined(__clang__)
#pragma STDC FP_CONTRACT OFF
#elif defined(_MSC_VER)
#pragma fp_contract(off)
#elif defined(__GNUC__)
#pragma GCC optimize("fp-contract=off")
#endif

/* equations.h also defines entry points for runs of many samples, which are not called here; all equations have the same arguments */
#if defined(__GNUC__)
#pragma GCC diagnostic ignored "-Wunused-function"
#pragma GCC diagnostic ignored "-Wunused-parameter"
#endif

#include "config.h"
#include "equations.h"

/* Kinds of the places of `v`; a TUNABLE parameter may be set between steps too. */
enum { NONE, TIME, CONSTANT, PARAMETER, INPUT, OUTPUT, TUNABLE };

/* Modes of the instance, one bit each, so that a function can name all modes in which it may be called. */
enum { INSTANTIATED = 1, INITIALIZATION = 2, STEPPING = 4, TERMINATED = 8, FAILED = 16 };

#define SAID 512 /* longest message */

#if defined(SAMPLE_NUMBER)
/* What the inputs say about the samples, so that each counts once whatever the importer does between the rows of a log. */
typedef struct {
  int64_t steps;       /* steps made */
  int64_t is_dt_given; /* the importer has set dt */
  int64_t since_old;   /* steps since an increment that repeats or interpolates began */
  int64_t spacing;     /* steps from one such increment to the next */
  int64_t even;        /* how often in succession that spacing was met */
  int64_t was_old;     /* the last increment repeats or interpolates */
  double number;       /* the last sample_number; NOT_GIVEN */
  double seconds, dt;  /* sums of the steps and of dt */
  double last[2][6];   /* the increments of the last two steps */
} Samples;
#endif

typedef struct {
  int32_t mode;
  int32_t stop_defined;
  int64_t samples;    /* samples since the start */
  int64_t stale;      /* the outputs do not belong to the state */
  double start_time;  /* s */
  double stop_time;   /* s */
#if defined(SAMPLE_NUMBER)
  Samples fed;
#endif
  double v[N_VALUE];
  double x[N_STATE + 1];
} State;

typedef struct Instance Instance;
struct Instance {
  State now;
  int events_logged;  /* debug logging is on */
  char *name;
  void *environment;
  void *logger;
  void (*say)(Instance *, int level, const char *message);
};

/* Levels of messages; an EVENT is logged only if the importer asks for it. */
enum { EVENT, ERROR, WARNING };

/* A saved state.  Its mark tells it from other memory when the importer passes it back. */
typedef struct {
  char mark[sizeof TOKEN];
  State state;
} Saved;

#define SERIAL_HEAD "insenv-state-1 "
typedef struct {
  char head[sizeof SERIAL_HEAD];
  char token[sizeof TOKEN];
} SerialMark;
#define SERIAL_SIZE (sizeof(SerialMark) + sizeof(State) + sizeof(uint64_t))

#if defined(__GNUC__)
__attribute__((format(printf, 3, 4)))
#endif
static void say(Instance *it, int level, const char *format, ...) {
  char message[SAID];
  va_list values;
  if (level == EVENT && !it->events_logged) return;
  va_start(values, format);
  vsnprintf(message, sizeof message, format, values);
  va_end(values);
  it->say(it, level, message);
}

#define REFUSE(...) return say(it, ERROR, __VA_ARGS__), 0

static int is_finite(double value) { return value - value == 0; }

static const char *mode_name(int mode) {
  switch (mode) {
    case INSTANTIATED: return "instantiated";
    case INITIALIZATION: return "initialization mode";
    case STEPPING: return "step mode";
    case TERMINATED: return "terminated";
    default: return "failed";
  }
}

/* Whether a function may be called in the present mode. */
static int allowed(Instance *it, int modes, const char *function) {
  if (it->now.mode & modes) return 1;
  REFUSE("%s: not allowed in this state (%s)", function, mode_name(it->now.mode));
}

static double *parameters(State *s) { return s->v + FIRST_PARAMETER; }
static double *inputs(State *s) { return s->v + FIRST_INPUT; }
static double *outputs_of(State *s) { return s->v + FIRST_OUTPUT; }

/* The row that a place belongs to. */
static const Row *row_of(size_t place) {
  size_t low = 0, high = N_ROW;
  while (high - low > 1) {
    size_t middle = (low + high) / 2;
    if (ROWS[middle].place <= place) low = middle; else high = middle;
  }
  return &ROWS[low];
}

/* Whether a place holds a Boolean, stored as 0 or 1. */
static int is_flag(size_t place) { return FLAG[place]; }

/* Log that `value` is not allowed at `place`. */
static void say_bad_value(Instance *it, const char *function, size_t place, double value) {
  const Row *row = row_of(place);
  char element[24] = "";
  if (row->size > 1) snprintf(element, sizeof element, " (element %lu)", (unsigned long)(place - row->place + 1));
  say(it, ERROR, "%s: %s%s = %.15g %s: allowed is a %s number from %g to %g", function, row->name, element, value, row->unit,
      row->whole ? "whole" : "finite", row->lower, row->upper);
}

static int out_of_bounds(const Row *row, double value) {
  return !is_finite(value) || value < row->lower || value > row->upper || (row->whole && value != floor(value));
}

/* Compute the start state and its outputs again if parameters have changed. */
static int refresh(Instance *it) {
  State *s = &it->now;
  double lost = 0;
  if (!s->stale) return 1;
  insenv_start(1, parameters(s), s->x);
  insenv_output(1, parameters(s), s->x, outputs_of(s));
  s->stale = 0;
  for (int i = 0; i < N_OUTPUT; ++i) lost += outputs_of(s)[i] - outputs_of(s)[i];
  if (lost != 0) REFUSE("the start values give outputs that are no finite numbers: check the parameters");
  return 1;
}

static void to_start(Instance *it) {
  State *s = &it->now;
  memset(s, 0, sizeof *s);
  s->mode = INSTANTIATED;
  s->stale = 1;
  memcpy(s->v, START, sizeof s->v);
#if defined(SAMPLE_NUMBER)
  s->fed.number = NOT_GIVEN;
#endif
}

static Instance *new_instance(const char *name) {
  Instance *it = (Instance *)calloc(1, sizeof *it);
  if (it == NULL) return NULL;
  it->name = (char *)malloc(strlen(name) + 1);
  if (it->name == NULL) {
    free(it);
    return NULL;
  }
  strcpy(it->name, name);
  to_start(it);
  return it;
}

static void free_instance(Instance *it) {
  if (it == NULL) return;
  free(it->name);
  free(it);
}

/* Whether the variable at `place` may be set in the present mode. */
static int settable(Instance *it, size_t place, const char *function) {
  int modes = 0;
  if (KIND[place] == PARAMETER) modes = INSTANTIATED | INITIALIZATION;
  if (KIND[place] == INPUT || KIND[place] == TUNABLE) modes = INSTANTIATED | INITIALIZATION | STEPPING;
  if (it->now.mode & modes) return 1;
  REFUSE("%s: %s cannot be set%s%s", function, row_of(place)->name, modes ? " in this state: " : "",
         modes ? mode_name(it->now.mode) : "");
}

/* Check `size` values for the places that begin at `place`; an input that a flag can switch off is checked by the step. */
static int check_values(Instance *it, const char *function, size_t place, size_t size, const double *values) {
  for (size_t i = 0; i < size; ++i) {
    int bad = KIND[place] == INPUT ? !is_finite(values[i]) && row_of(place)->flag < 0 : out_of_bounds(row_of(place + i), values[i]);
    if (bad) return say_bad_value(it, function, place + i, values[i]), 0;
  }
  return 1;
}

static void put_values(Instance *it, size_t place, size_t size, const double *values) {
  memcpy(it->now.v + place, values, size * sizeof *values);
#if defined(SAMPLE_NUMBER)
  if (place == DT) it->now.fed.is_dt_given = 1;
#endif
  if (KIND[place] != INPUT && it->now.mode != STEPPING) it->now.stale = 1;
}

static int set_times(Instance *it, const char *function, double start_time, int stop_defined, double stop_time) {
  State *s = &it->now;
  if (!is_finite(start_time)) REFUSE("%s: startTime = %g: allowed is a finite number", function, start_time);
  if (stop_defined && !(stop_time > start_time))
    REFUSE("%s: stopTime = %g: allowed is a time after startTime = %g", function, stop_time, start_time);
  s->start_time = s->v[0] = start_time;
  s->stop_defined = stop_defined != 0;
  s->stop_time = stop_defined ? stop_time : 0;
  return 1;
}

static int enter_initialization(Instance *it) {
  it->now.mode = INITIALIZATION;
  say(it, EVENT, "initialization mode");
  return 1;
}

static int exit_initialization(Instance *it) {
  if (!refresh(it)) return 0;
  it->now.mode = STEPPING;
  say(it, EVENT, "step mode");
  return 1;
}

/* Whether the input of this row is used: an input that belongs to a flag is not while the flag is 0. */
static int is_used(const State *s, const Row *row) {
  for (int flag = row->flag; flag >= 0; flag = row_of((size_t)flag)->flag)
    if (s->v[flag] == 0) return 0;
  return 1;
}

/* Whether the inputs are the increments over the whole communication step, of any length. */
static int is_one_increment(const State *s) {
#if defined(DT)
  return s->v[STEP_IS_ONE_INCREMENT] != 0;
#else
  return (void)s, 0;
#endif
}

#if ONE_SAMPLE_A_STEP
#if defined(DT)
#define OTHERWISE ", or set parameters.step_is_one_increment if the inputs are the increments over the whole step"
#else
#define OTHERWISE ""
#endif

/* Check that a step is one sample, or one increment. */
static int check_length(Instance *it, const char *function, double step, double rounding, double *samples) {
  *samples = 1;
#if defined(DT)
  if (is_one_increment(&it->now)) {
    const Row *dt = row_of(DT);
    if (!is_finite(step) || step < dt->lower || step > dt->upper)
      REFUSE("%s: the communication step is %.15g s: allowed is %g to %g s", function, step, dt->lower, dt->upper);
    return 1;
  }
#endif
  if (!is_finite(step) || fabs(step - SAMPLE_INTERVAL) > rounding)
    REFUSE("%s: the communication step is %.15g s: allowed is one sample interval, %.15g s.  Set the importer's step to it (FMPy: "
           "output_interval=%.15g)" OTHERWISE,
           function, step, (double)SAMPLE_INTERVAL, (double)SAMPLE_INTERVAL);
  return 1;
}
#else
/* Check that a step is a whole number of samples. */
static int check_length(Instance *it, const char *function, double step, double rounding, double *samples) {
  *samples = floor(step / SAMPLE_INTERVAL + 0.5);
  if (!is_finite(step) || *samples < 1 || fabs(step - *samples * SAMPLE_INTERVAL) > rounding)
    REFUSE("%s: the communication step is %.15g s: allowed is a whole number of sample intervals of %.15g s", function, step,
           (double)SAMPLE_INTERVAL);
  if (*samples > MAX_SAMPLES)
    REFUSE("%s: the communication step is %g s: allowed is up to %g sample intervals", function, step, (double)MAX_SAMPLES);
  return 1;
}
#endif

/* Copy the inputs to u and check them: an unused one may have any value, and one that is not finite is then left out. */
static int take_inputs(Instance *it, const char *function, double step, double *u) {
  const State *s = &it->now;
  memcpy(u, inputs(&it->now), N_INPUT * sizeof *u);
#if defined(DT)
  if (is_one_increment(s)) u[DT - FIRST_INPUT] = step;
#endif
  for (size_t r = FIRST_INPUT_ROW; r < FIRST_INPUT_ROW + N_INPUT_ROW; ++r) {
    const Row *row = &ROWS[r];
    int used = is_used(s, row);
    for (size_t i = row->place; i < row->place + row->size; ++i) {
      double *value = &u[i - FIRST_INPUT];
      if (used && out_of_bounds(row, *value)) return say_bad_value(it, function, i, *value), 0;
      if (!used && !is_finite(*value)) *value = START[i];
    }
  }
#if defined(DT)
  if (u[DT - FIRST_INPUT] < 0.5 * step || u[DT - FIRST_INPUT] > 2 * step)
    REFUSE("%s: dt = %g s in a step of %.15g s: allowed is half to twice the step", function, u[DT - FIRST_INPUT], step);
#endif
  return 1;
}

#if defined(SAMPLE_NUMBER)
#define NOT_GIVEN_TEXT                                                                                                         \
  "sample_number and dt are not set: this FMU takes the inputs of each step as one sample of %.15g s and cannot see whether "  \
  "the importer interpolates between rows; set sample_number (0, 1, 2, ... by row of the log)"
#define ENOUGH 50      /* intervals of the same length that no noise gives by chance */
#define FARTHEST 200   /* steps, the longest interval between two rows that is looked for */
#define COLLINEAR 1e-4 /* of the change: an importer's weights between two rows have the rounding error of the time */

/* Whether the increments `now` repeat those of the last step, or lie on a straight line with those of the last two. */
static int is_old(const Samples *fed, const double *now) {
  int repeats = 1, interpolates = fed->steps > 1;
  for (int i = 0; i < 6; ++i) {
    double one = fed->last[0][i], two = fed->last[1][i];
    double rounding = 4 * DBL_EPSILON * (fabs(now[i]) + 2 * fabs(one) + fabs(two));
    if (now[i] != one) repeats = 0;
    if (fabs(now[i] - 2 * one + two) > COLLINEAR * fabs(now[i] - two) + rounding) interpolates = 0;
  }
  return fed->steps > 0 && (repeats || interpolates);
}

/* Whether no sample has come yet: a master that steps all parts and then transfers gives zeros in the first step, which an
 * estimator would take for free fall.  No inertial unit near the Earth measures zeros; a numbered sample is one whatever it holds. */
static int is_before_first(const State *s, const double *u) {
  const double *angle = u + DELTA_ANGLE - FIRST_INPUT, *velocity = u + DELTA_VELOCITY - FIRST_INPUT;
  int zeros = 1;
  for (int i = 0; i < 3; ++i) zeros = zeros && angle[i] == 0 && velocity[i] == 0;
  return zeros && s->fed.steps == 0 && s->v[SAMPLE_NUMBER] == NOT_GIVEN;
}

/* Refuse inputs of which the importer repeats, omits or interpolates samples; else put the sums after the step in `next`.
 *
 * sample_number proves the contrary.  Without it, a slower log shows in increments that repeat or interpolate at even intervals,
 * and, if dt is set, in the sum of dt. */
static int check_samples(Instance *it, const char *function, double step, const double *u, Samples *next) {
  const double number = it->now.v[SAMPLE_NUMBER];
  double now[6];
  *next = it->now.fed;
  memcpy(now, u + DELTA_ANGLE - FIRST_INPUT, 3 * sizeof *now);
  memcpy(now + 3, u + DELTA_VELOCITY - FIRST_INPUT, 3 * sizeof *now);
  if (number != NOT_GIVEN) {
    if (number < 0 || fabs(number - floor(number + 0.5)) > 0.01)
      REFUSE("%s: sample_number = %.9g: allowed is a whole number from 0.  The inputs lie between two samples: set them at the times "
             "at which the importer steps, or export the FMU with the log's sample_interval", function, number);
    if (next->number != NOT_GIVEN && fabs(number - next->number - 1) > 0.02)
      REFUSE("%s: sample_number = %.9g follows %.9g: allowed is one sample a step, in order.  Export the FMU with the log's "
             "sample_interval, and fill gaps first", function, number, next->number);
    next->number = number;
  } else if (is_old(next, now)) {
    ++next->since_old;
    if (!next->was_old) { /* an interval between such increments ends */
      int64_t difference = next->since_old - next->spacing;
      next->even = difference >= -1 && difference <= 1 && next->since_old > 1 && next->since_old <= FARTHEST ? next->even + 1 : 0;
      if (next->even == 0) next->spacing = next->since_old;
      next->since_old = 0;
    }
    next->was_old = 1;
    if (next->even >= ENOUGH)
      REFUSE("%s: delta_angle and delta_velocity repeat or interpolate earlier increments at even intervals, so that samples count "
             "more than once: allowed is one sample of %.15g s a step.  Export the FMU with the log's sample_interval, or, if every "
             "step has a sample of its own, set sample_number (0, 1, 2, ...)",
             function, (double)SAMPLE_INTERVAL);
  } else {
    ++next->since_old;
    next->was_old = 0;
  }
  next->seconds += step;
  next->dt += u[DT - FIRST_INPUT];
  if (fabs(next->dt - next->seconds) > 0.1 * next->seconds + 3 * step)
    REFUSE("%s: dt adds up to %.6g s over %.6g s of steps: allowed is a log whose samples are as long as the steps within a tenth, "
           "because each would otherwise count more than once, or not at all.  Export the FMU with the log's sample_interval",
           function, next->dt, next->seconds);
  memcpy(next->last[1], next->last[0], sizeof now);
  memcpy(next->last[0], now, sizeof now);
  ++next->steps;
  return 1;
}
#endif

/* Make a communication step. */
static int do_step(Instance *it, const char *function, double point, double step) {
  State *s = &it->now;
  double u[N_INPUT + 1], samples, lost = 0, nothing = 1e-6 * SAMPLE_INTERVAL;
  int64_t advances;
  /* a step that an importer computes as a difference of two times has their rounding error */
  double rounding = nothing + 4 * DBL_EPSILON * fabs(point);

  if (!is_finite(point) || fabs(point - s->v[0]) > 0.25 * SAMPLE_INTERVAL)
    REFUSE("%s: the communication point is %.15g s: the instance stands at %.15g s", function, point, s->v[0]);
  if (step > 0 && step < nothing) return 1; /* what is left to the stop time of an importer that sums up steps */
  if (!check_length(it, function, step, rounding, &samples)) return 0;
  advances = (int64_t)samples;
  if (s->stop_defined && point + step > s->stop_time + 0.5 * SAMPLE_INTERVAL)
    REFUSE("%s: a step of %g s from %g s passes the stop time, %g s", function, step, point, s->stop_time);
  if (!take_inputs(it, function, step, u)) return 0;
#if defined(SAMPLE_NUMBER)
  if (is_before_first(s, u)) {
    advances = 0;
    say(it, EVENT, "no sample yet: the increments are zero");
  } else {
    Samples next;
    if (!check_samples(it, function, step, u, &next)) return 0;
    if (next.steps == 1 && next.number == NOT_GIVEN && !next.is_dt_given && !is_one_increment(s))
      say(it, WARNING, NOT_GIVEN_TEXT, (double)SAMPLE_INTERVAL);
    s->fed = next;
  }
#endif

  for (int64_t k = 0; k < advances; ++k) advance(parameters(s), s->x, u);
#if defined(DT)
  s->v[DT] = u[DT - FIRST_INPUT];
#endif
  s->samples += (int64_t)samples;
  s->v[0] = is_one_increment(s) ? point + step : s->start_time + (double)s->samples * SAMPLE_INTERVAL;
  insenv_output(1, parameters(s), s->x, outputs_of(s));
  for (int i = 0; i < N_OUTPUT; ++i) lost += outputs_of(s)[i] - outputs_of(s)[i];
  if (lost != 0) {
    s->mode = FAILED;
    REFUSE("%s: diverged at %g s: the outputs are no longer finite numbers", function, s->v[0]);
  }
  return 1;
}

/* --- saved states -------------------------------------------------------------------------------------------------------- */

static int is_ours(const Saved *saved) { return saved != NULL && memcmp(saved->mark, TOKEN, sizeof TOKEN) == 0; }

/* Save into *place, which is NULL or an earlier saved state. */
static int save(Instance *it, const char *function, void **place) {
  Saved *saved;
  if (place == NULL) REFUSE("%s: nowhere to put the state: the address is NULL", function);
  saved = (Saved *)*place;
  if (saved == NULL) saved = (Saved *)calloc(1, sizeof *saved);
  else if (!is_ours(saved)) REFUSE("%s: *FMUState is neither NULL nor a state of this FMU", function);
  if (saved == NULL) REFUSE("%s: out of memory", function);
  memcpy(saved->mark, TOKEN, sizeof TOKEN);
  saved->state = it->now;
  *place = saved;
  return 1;
}

static int restore(Instance *it, const char *function, const void *place) {
  if (!is_ours((const Saved *)place)) REFUSE("%s: not a state of this FMU", function);
  it->now = ((const Saved *)place)->state;
  return 1;
}

static int free_saved(Instance *it, const char *function, void **place) {
  if (place == NULL || *place == NULL) return 1;
  if (!is_ours((const Saved *)*place)) REFUSE("%s: not a state of this FMU", function);
  memset(((Saved *)*place)->mark, 0, sizeof TOKEN);
  free(*place);
  *place = NULL;
  return 1;
}

/* FNV-1a, 64 bits: G. Fowler, L. C. Noll, K.-P. Vo. */
static uint64_t digest(const unsigned char *bytes, size_t size) {
  uint64_t sum = UINT64_C(14695981039346656037);
  for (size_t i = 0; i < size; ++i) sum = (sum ^ bytes[i]) * UINT64_C(1099511628211);
  return sum;
}

static int serialize(Instance *it, const char *function, const void *place, unsigned char *bytes, size_t size) {
  SerialMark mark = {SERIAL_HEAD, TOKEN};
  uint64_t sum;
  if (!is_ours((const Saved *)place)) REFUSE("%s: not a state of this FMU", function);
  if (bytes == NULL || size != SERIAL_SIZE)
    REFUSE("%s: %lu bytes%s: allowed is a buffer of %lu", function, (unsigned long)size, bytes ? "" : " at NULL",
           (unsigned long)SERIAL_SIZE);
  memcpy(bytes, &mark, sizeof mark);
  memcpy(bytes + sizeof mark, &((const Saved *)place)->state, sizeof(State));
  sum = digest(bytes, sizeof mark + sizeof(State));
  memcpy(bytes + sizeof mark + sizeof(State), &sum, sizeof sum);
  return 1;
}

static int deserialize(Instance *it, const char *function, const unsigned char *bytes, size_t size, void **place) {
  SerialMark mark = {SERIAL_HEAD, TOKEN};
  State state;
  uint64_t sum;
  Saved *saved;
  if (bytes == NULL || place == NULL) REFUSE("%s: an address is NULL", function);
  if (size != SERIAL_SIZE || memcmp(bytes, &mark, sizeof mark) != 0)
    REFUSE("%s: not a serialized state of this FMU", function);
  memcpy(&sum, bytes + size - sizeof sum, sizeof sum);
  memcpy(&state, bytes + sizeof mark, sizeof state);
  if (sum != digest(bytes, size - sizeof sum) || state.mode < INSTANTIATED || state.mode > FAILED || (state.mode & (state.mode - 1)))
    REFUSE("%s: the serialized state is damaged", function);
  saved = (Saved *)*place;
  if (saved == NULL) saved = (Saved *)calloc(1, sizeof *saved);
  else if (!is_ours(saved)) REFUSE("%s: *FMUState is neither NULL nor a state of this FMU", function);
  if (saved == NULL) REFUSE("%s: out of memory", function);
  memcpy(saved->mark, TOKEN, sizeof TOKEN);
  saved->state = state;
  *place = saved;
  return 1;
}
