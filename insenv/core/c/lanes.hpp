/* Lanes: one "number" of the generated code is LANES doubles, one per row of a batch.
 *
 * The operators below are those that generated code uses and that are exactly rounded, so a lane computes what a double computes,
 * to the bit.  Comparisons give 1.0 and 0.0, as CasADi's do.
 */
#include <math.h>
#ifdef __AVX__
#include <immintrin.h>
#endif

/* As many as fill one vector register: more would spill, and measure slower. */
#ifndef LANES
#ifdef __AVX512F__
#define LANES 8
#else
#define LANES 4
#endif
#endif

typedef double lanes_t __attribute__((vector_size(LANES * sizeof(double)), aligned(sizeof(double))));
typedef long long mask_t __attribute__((vector_size(LANES * sizeof(double)), aligned(sizeof(double))));

struct real {
  lanes_t v;
  real() = default;
  real(lanes_t lanes) : v(lanes) {}
  real(double number) : v(number - lanes_t{}) {}
};

#define LANE_INLINE static inline __attribute__((always_inline))

LANE_INLINE real operator+(real a, real b) { return a.v + b.v; }
LANE_INLINE real operator-(real a, real b) { return a.v - b.v; }
LANE_INLINE real operator*(real a, real b) { return a.v * b.v; }
LANE_INLINE real operator/(real a, real b) { return a.v / b.v; }
LANE_INLINE real operator-(real a) { return -a.v; }

/* all bits set where true -> 1.0, else 0.0 */
LANE_INLINE real truth(mask_t mask) { return (lanes_t)(mask & (mask_t)real(1.0).v); }

LANE_INLINE real operator<(real a, real b) { return truth((mask_t)(a.v < b.v)); }
LANE_INLINE real operator<=(real a, real b) { return truth((mask_t)(a.v <= b.v)); }
LANE_INLINE real operator==(real a, real b) { return truth((mask_t)(a.v == b.v)); }
LANE_INLINE real operator!=(real a, real b) { return truth((mask_t)(a.v != b.v)); }
LANE_INLINE real operator!(real a) { return truth((mask_t)(a.v == lanes_t{})); }
LANE_INLINE real operator&&(real a, real b) { return truth((mask_t)(a.v != lanes_t{}) & (mask_t)(b.v != lanes_t{})); }
LANE_INLINE real operator||(real a, real b) { return truth((mask_t)(a.v != lanes_t{}) | (mask_t)(b.v != lanes_t{})); }

/* c ? a : 0 */
LANE_INLINE real select0(real c, real a) { return (lanes_t)((mask_t)(c.v != lanes_t{}) & (mask_t)a.v); }

LANE_INLINE real fabs(real a) {
  lanes_t r;
  for (int i = 0; i < LANES; ++i) r[i] = __builtin_fabs(a.v[i]);
  return r;
}
LANE_INLINE real sqrt(real a) {
  lanes_t r;
  for (int i = 0; i < LANES; ++i) r[i] = __builtin_sqrt(a.v[i]);
  return r;
}
/* the compiler does not see that floor is one instruction for four lanes */
LANE_INLINE real floor(real a) {
  lanes_t r;
#if defined(__AVX__) && LANES % 4 == 0
  for (int i = 0; i < LANES / 4; ++i) {
    __m256d part;
    __builtin_memcpy(&part, (const double *)&a.v + 4 * i, sizeof part);
    part = _mm256_floor_pd(part);
    __builtin_memcpy((double *)&r + 4 * i, &part, sizeof part);
  }
#else
  for (int i = 0; i < LANES; ++i) r[i] = __builtin_floor(a.v[i]);
#endif
  return r;
}

#define ONE real(1.0)
#define LANE(number, i) ((number).v[i])
LANE_INLINE int any(real mask) {
  int found = 0;
  for (int i = 0; i < LANES; ++i) found |= mask.v[i] != 0;
  return found;
}
LANE_INLINE int all(real mask) {
  int found = 1;
  for (int i = 0; i < LANES; ++i) found &= mask.v[i] != 0;
  return found;
}
LANE_INLINE real blend(real mask, real a, real b) {
  mask_t m = (mask_t)(mask.v != lanes_t{});
  return (lanes_t)((m & (mask_t)a.v) | (~m & (mask_t)b.v));
}
