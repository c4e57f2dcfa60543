/* Steps the FMUs of a system in the order of the data; insenv/fmu/stepping.py fills the tables and compiles this file.
 *
 * In each step each part takes its connected inputs from the outputs of the parts before it, steps, and gives its outputs.
 */
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#define EXPORT __attribute__((visibility("default")))

/* In the order of KINDS in insenv/fmu/stepping.py. */
enum { F64, F32, I8, U8, I16, U16, I32, U32, I64, U64, BOOL };
static const size_t SIZE[] = {8, 4, 1, 1, 2, 2, 4, 4, 8, 8, sizeof(bool)};

/* Copy `count` values, in step k from k `stride` bytes behind `from`.
 *
 * Values of different kinds are converted, which loses nothing in the pairs that stepping.py allows. */
typedef struct {
  char *to;
  const char *from;
  int64_t stride, count;
  int32_t to_kind, from_kind;
} Move;

/* A function that sets or gets a group of variables. */
typedef struct {
  void (*function)(void);
  const uint32_t *references;
  void *values;
  int64_t count, elements;
} Group;

typedef struct {
  void *instance;
  void (*do_step)(void);
  bool *event, *terminate, *early; /* of FMI 3 */
  double *last;
  const Move *moves;
  const Group *setters, *getters;
  int64_t n_move, n_setter, n_getter;
  int32_t version;
} Part;

typedef int (*Values2)(void *, const uint32_t *, size_t, void *);
typedef int (*Values3)(void *, const uint32_t *, size_t, void *, size_t);
typedef int (*DoStep2)(void *, double, double, int);
typedef int (*DoStep3)(void *, double, double, bool, bool *, bool *, bool *, double *);

/* What ended a run early: the part, what it was doing, and the status of the call. */
enum { SETTING, STEPPING, READING };
typedef struct {
  int64_t part;
  int32_t doing, status;
} Stop;

static double load(const char *from, int32_t kind) {
#define CASE(K, type) case K: { type value; memcpy(&value, from, sizeof value); return (double)value; }
  switch (kind) {
    CASE(F64, double) CASE(F32, float) CASE(I8, int8_t) CASE(U8, uint8_t) CASE(I16, int16_t) CASE(U16, uint16_t)
    CASE(I32, int32_t) CASE(U32, uint32_t) CASE(I64, int64_t) CASE(U64, uint64_t) CASE(BOOL, bool)
  }
#undef CASE
  return 0;
}

static void store(char *to, int32_t kind, double number) {
#define CASE(K, type) case K: { type value = (type)number; memcpy(to, &value, sizeof value); return; }
  switch (kind) {
    CASE(F64, double) CASE(F32, float) CASE(I8, int8_t) CASE(U8, uint8_t) CASE(I16, int16_t) CASE(U16, uint16_t)
    CASE(I32, int32_t) CASE(U32, uint32_t) CASE(I64, int64_t) CASE(U64, uint64_t) CASE(BOOL, bool)
  }
#undef CASE
}

static void move(const Move *m, char *to, int64_t k) {
  const char *from = m->from + (ptrdiff_t)(k * m->stride);
  if (m->to_kind == m->from_kind) {
    memcpy(to, from, (size_t)m->count * SIZE[m->to_kind]);
    return;
  }
  for (int64_t i = 0; i < m->count; i++)
    store(to + (size_t)i * SIZE[m->to_kind], m->to_kind, load(from + (size_t)i * SIZE[m->from_kind], m->from_kind));
}

/* Call each group's function; the status of the first that fails, else 0. */
static int call(const Part *part, const Group *groups, int64_t count) {
  for (int64_t i = 0; i < count; i++) {
    const Group *g = &groups[i];
    int status = part->version == 2
      ? ((Values2)g->function)(part->instance, g->references, (size_t)g->count, g->values)
      : ((Values3)g->function)(part->instance, g->references, (size_t)g->count, g->values, (size_t)g->elements);
    if (status > 1) return status;
  }
  return 0;
}

/* Steps `first` to `first + steps - 1`, of `step` seconds from time `start`; the number of steps that were completed.
 *
 * After every `every` steps the outputs are recorded in the next row of `rows`, each of `row_size` bytes.  A failed call fills
 * `stop`, and so does a part that ends the simulation, after the step in which it does. */
EXPORT int64_t insenv_master(const Part *parts, int64_t n_part, const Move *records, int64_t n_record, char *rows, int64_t row_size,
                             int64_t first, int64_t steps, double start, double step, int64_t every, Stop *stop) {
  for (int64_t k = first; k < first + steps; k++) {
    const double time = start + (double)k * step;
    int ended = 0;
    for (int64_t i = 0; i < n_part; i++) {
      const Part *p = &parts[i];
      for (int64_t m = 0; m < p->n_move; m++) move(&p->moves[m], p->moves[m].to, k);
      int doing = SETTING, status = call(p, p->setters, p->n_setter);
      if (status <= 1) {
        doing = STEPPING;
        status = p->version == 2
          ? ((DoStep2)p->do_step)(p->instance, time, step, 1)
          : ((DoStep3)p->do_step)(p->instance, time, step, true, p->event, p->terminate, p->early, p->last);
      }
      if (status <= 1) {
        doing = READING;
        status = call(p, p->getters, p->n_getter);
      }
      if (status > 1) {
        *stop = (Stop){i, doing, status};
        return k - first;
      }
      if (!ended && p->version == 3 && *p->terminate) {
        ended = 1;
        *stop = (Stop){i, STEPPING, 0};
      }
    }
    if ((k + 1) % every == 0)
      for (int64_t m = 0; m < n_record; m++) move(&records[m], rows + (k / every) * row_size + (ptrdiff_t)records[m].to, 0);
    if (ended) return k + 1 - first;
  }
  return steps;
}
