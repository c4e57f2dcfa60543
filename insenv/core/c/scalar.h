/* Scalar form of what lanes.hpp gives for a vector of rows: one "number" is one double. */
#include <math.h>

#define LANES 1
typedef double real;

static inline real select0(real c, real a) { return c != 0 ? a : 0; }
#define ONE 1.0
#define LANE(number, i) (number)
static inline int any(real mask) { return mask != 0; }
static inline int all(real mask) { return mask != 0; }
static inline real blend(real mask, real a, real b) { return mask != 0 ? a : b; }
