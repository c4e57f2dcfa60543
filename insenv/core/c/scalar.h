/* The scalar counterpart of lanes.h: one "number" is one double. */
#include <math.h>
#include <stdint.h>

#define LANES 1
typedef double real;
typedef uint64_t word; /* a 32-bit number for the noise, in the low half */

static inline real constant(double number) { return number; }
static inline real less(real a, real b) { return a < b; }
static inline real less_or_equal(real a, real b) { return a <= b; }
static inline real equal(real a, real b) { return a == b; }
static inline real not_equal(real a, real b) { return a != b; }
static inline real negation(real a) { return a == 0; }
static inline real both(real a, real b) { return a != 0 && b != 0; }
static inline real either(real a, real b) { return a != 0 || b != 0; }
static inline real absolute(real a) { return fabs(a); }
static inline real root(real a) { return sqrt(a); }
static inline real whole(real a) { return floor(a); }
static inline real square(real a) { return a * a; }
static inline real select0(real c, real a) { return c != 0 ? a : 0; }

/* Not worth optimizing: ONCE runs once per run.  Worth little time of the compiler: SELDOM runs on few of the samples.  The
 * levels change no result: no option that allows other rounding depends on them. */
#if defined(__clang__)
#define ONCE __attribute__((optnone, noinline))
#define SELDOM
#elif defined(__GNUC__)
#define ONCE __attribute__((optimize("O0")))
#define SELDOM __attribute__((optimize("O1")))
#else
#define ONCE
#define SELDOM
#endif

#define ONE 1.0
#define ON_A_LINE
#define LANE(number, i) (number)
static inline int any(real mask) { return mask != 0; }
static inline int all(real mask) { return mask != 0; }
static inline real blend(real mask, real a, real b) { return mask != 0 ? a : b; }

static inline word alike(uint32_t number) { return number; }
static inline word product(word a, uint32_t b) { return (word)(uint32_t)a * b; }
/* low and high half of a whole number in [0, 2^53] */
static inline void halves(real number, word half[2]) { half[0] = (uint32_t)(word)number, half[1] = (word)number >> 32; }
static inline real uniform(word a) { return ((double)(uint32_t)a + 0.5) * 0x1p-32; }
