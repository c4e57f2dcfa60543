/* @heading@
 *
 * @name@_init sets a filter to its start, @name@_sample takes one inertial sample with what arrived during it, and
 * @name@_output gives the estimate after the last sample.  The struct @name@ is all that they need: nothing is allocated,
 * nothing is printed, no other memory is kept.  A filter may be used by one thread at a time; a copy of the struct is a complete
 * snapshot.  @same@ in hardware.
 *
 * SI units and radians; a pure number has the unit 1.  Frames: n north, east, down; b forward, right, down (the axes of the
 * inertial unit); e Earth-centred, Earth-fixed.  q_nb takes components in b to components in n; scalar first.
 */
#ifndef @NAME@_H
#define @NAME@_H

#ifdef __cplusplus
extern "C" {
#endif

/* A call that does not return OK has changed nothing but the member `wrong` of the filter: the place of the first wrong value
 * among the doubles of the struct that was given. */
typedef enum {
  @NAME@_OK = 0,
  @NAME@_NOT_FINITE = 1,   /* NaN or infinity */
  @NAME@_OUT_OF_RANGE = 2, /* outside its bounds, which @name@.c lists */
  @NAME@_NOT_WHOLE = 3,    /* a flag or a count that is no whole number */
  @NAME@_WRONG_DT = 4,     /* dt is outside @NAME@_DT_MIN to @NAME@_DT_MAX */
  @NAME@_DIVERGED = 5,     /* an output is not a finite number */
  @NAME@_NOT_EXACT = 6     /* the machine rounds otherwise: fused operations, subnormal numbers flushed, another rounding mode */
} @name@_status;

/* Length of a sample that is accepted, s. */
#ifndef @NAME@_DT_MIN
#define @NAME@_DT_MIN @dt_min@
#endif
#ifndef @NAME@_DT_MAX
#define @NAME@_DT_MAX @dt_max@
#endif

typedef struct {
@parameters@
} @name@_parameters;

/* The flag X_valid says whether the inputs X_... are used; those that are not used may hold any value. */
typedef struct {
@inputs@
} @name@_inputs;

typedef struct {
@outputs@
} @name@_outputs;

/* A filter.  Its members, but for `wrong`, are its own. */
typedef struct {
  int wrong;
  double p[@n_parameters@]; /* parameters */
  double x[@n_state@]; /* state */
  double u[@n_inputs@]; /* inputs */
  double y[@n_results@]; /* results of a step */
  double w[@n_work@]; /* workspace */@single@
} @name@;

/* @values_from@ */
extern const @name@_parameters @name@_defaults;

/* Set the filter to the start that the parameters define.  NOT_FINITE, OUT_OF_RANGE, NOT_WHOLE: a parameter; NOT_EXACT. */
@name@_status @name@_init(@name@ *f, const @name@_parameters *parameters);

/* Take one sample.  NOT_FINITE, OUT_OF_RANGE, NOT_WHOLE, WRONG_DT: an input; the sample does not count then. */
@name@_status @name@_sample(@name@ *f, const @name@_inputs *inputs);

/* The estimate after the last sample, or at the start.  It uses the filter's workspace.  DIVERGED: start the filter again. */
@name@_status @name@_output(@name@ *f, @name@_outputs *outputs);

#ifdef __cplusplus
}
#endif
#endif
