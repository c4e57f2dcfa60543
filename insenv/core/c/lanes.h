/* One "number" of the generated code is LANES doubles, one per row of a batch (vector extension of GCC and Clang).
 *
 * Generated code uses the operations below and + - * /.  They are exactly rounded, so that a lane and a double give bit-identical
 * results.  Comparisons give 1.0 and 0.0, as in CasADi.
 */
#include <math.h>
#include <stdint.h>
#ifdef __AVX__
#include <immintrin.h>
#endif

/* As many as fill one vector register: with more, registers spill and models run slower. */
#ifndef LANES
#ifdef __AVX512F__
#define LANES 8
#else
#define LANES 4
#endif
#endif

#define LANES_OF(type) type __attribute__((vector_size(LANES * sizeof(double)), aligned(sizeof(double))))
typedef LANES_OF(double) real;
typedef LANES_OF(int64_t) mask_t; /* all bits of a lane set, or none */
typedef LANES_OF(uint64_t) word;  /* 32-bit numbers for the noise, each in the low half of a lane */

#define LANE_INLINE static inline __attribute__((always_inline))

LANE_INLINE real constant(double number) { return number - (real){0}; }

LANE_INLINE real truth(mask_t mask) { return (real)(mask & (mask_t)constant(1.0)); }
LANE_INLINE mask_t is_true(real a) { return (mask_t)(a != (real){0}); }

LANE_INLINE real less(real a, real b) { return truth((mask_t)(a < b)); }
LANE_INLINE real less_or_equal(real a, real b) { return truth((mask_t)(a <= b)); }
LANE_INLINE real equal(real a, real b) { return truth((mask_t)(a == b)); }
LANE_INLINE real not_equal(real a, real b) { return truth((mask_t)(a != b)); }
LANE_INLINE real negation(real a) { return truth(~is_true(a)); }
LANE_INLINE real both(real a, real b) { return truth(is_true(a) & is_true(b)); }
LANE_INLINE real either(real a, real b) { return truth(is_true(a) | is_true(b)); }

/* c ? a : 0 */
LANE_INLINE real select0(real c, real a) { return (real)(is_true(c) & (mask_t)a); }

LANE_INLINE real square(real a) { return a * a; }
LANE_INLINE real absolute(real a) { return (real)((mask_t)a & INT64_MAX); }
/* The compiler does not recognize these as one instruction for a whole register. */
#if defined(__AVX512F__) && LANES % 8 == 0
#define IN_PARTS 8
typedef __m512d part_t;
typedef __m512i part_word;
#define PART_ROOT(a) _mm512_sqrt_pd(a)
#define PART_WHOLE(a) _mm512_roundscale_pd(a, _MM_FROUND_TO_NEG_INF | _MM_FROUND_NO_EXC)
#define PART_PRODUCT(a, b) _mm512_mul_epu32(a, _mm512_set1_epi64(b))
#elif defined(__AVX2__) && LANES % 4 == 0
#define IN_PARTS 4
typedef __m256d part_t;
typedef __m256i part_word;
#define PART_ROOT(a) _mm256_sqrt_pd(a)
#define PART_WHOLE(a) _mm256_floor_pd(a)
#define PART_PRODUCT(a, b) _mm256_mul_epu32(a, _mm256_set1_epi64x(b))
#endif
#ifdef IN_PARTS
#define EACH_PART(type, part, r, a, expression)                                                 \
  for (int i = 0; i < LANES / IN_PARTS; ++i) {                                                  \
    type part;                                                                                  \
    __builtin_memcpy(&part, (const char *)&a + sizeof part * (unsigned)i, sizeof part);         \
    part = expression;                                                                          \
    __builtin_memcpy((char *)&r + sizeof part * (unsigned)i, &part, sizeof part);               \
  }
#endif
LANE_INLINE real root(real a) {
  real r;
#ifdef IN_PARTS
  EACH_PART(part_t, part, r, a, PART_ROOT(part))
#else
  for (int i = 0; i < LANES; ++i) r[i] = __builtin_sqrt(a[i]);
#endif
  return r;
}
LANE_INLINE real whole(real a) {
  real r;
#ifdef IN_PARTS
  EACH_PART(part_t, part, r, a, PART_WHOLE(part))
#else
  for (int i = 0; i < LANES; ++i) r[i] = __builtin_floor(a[i]);
#endif
  return r;
}

/* Worth little time of the compiler: ONCE runs at each start of a row, SELDOM on few of the samples.  The level changes no
 * result: no option that allows other rounding depends on it. */
#if defined(__GNUC__) && !defined(__clang__)
#define SELDOM __attribute__((optimize("O1")))
#else
#define SELDOM
#endif
#define ONCE SELDOM

#define ONE constant(1.0)
/* A vector of 64 bytes that lies across two cache lines takes longer to store and load. */
#define ON_A_LINE __attribute__((aligned(64)))
#define LANE(number, i) ((number)[i])
#if defined(__AVX512F__) && LANES == 8
LANE_INLINE unsigned set_lanes(real mask) { return _mm512_cmp_pd_mask((__m512d)mask, _mm512_setzero_pd(), _CMP_NEQ_UQ); }
LANE_INLINE int any(real mask) { return set_lanes(mask) != 0; }
LANE_INLINE int all(real mask) { return set_lanes(mask) == 0xFF; }
#else
LANE_INLINE int any(real mask) {
  int found = 0;
  for (int i = 0; i < LANES; ++i) found |= mask[i] != 0;
  return found;
}
LANE_INLINE int all(real mask) {
  int found = 1;
  for (int i = 0; i < LANES; ++i) found &= mask[i] != 0;
  return found;
}
#endif
LANE_INLINE real blend(real mask, real a, real b) {
  mask_t m = is_true(mask);
  return (real)((m & (mask_t)a) | (~m & (mask_t)b));
}

LANE_INLINE word alike(uint32_t number) { return (word){0} + number; }
LANE_INLINE word product(word a, uint32_t b) {
  word r;
#ifdef IN_PARTS
  EACH_PART(part_word, part, r, a, PART_PRODUCT(part, b))
#else
  for (int i = 0; i < LANES; ++i) r[i] = (uint64_t)(uint32_t)a[i] * b;
#endif
  return r;
}
/* low and high half of a whole number in [0, 2^53]: 2^52 + a number below 2^32 has that number as its low bits */
LANE_INLINE void halves(real number, word half[2]) {
  real high = whole(number * 0x1p-32);
  half[0] = (word)(number - high * 0x1p32 + 0x1p52);
  half[1] = (word)(high + 0x1p52) & 0xFFFFFFFFu;
}
LANE_INLINE real uniform(word a) {
  real number = (real)((a & 0xFFFFFFFFu) | 0x4330000000000000u) - 0x1p52;
  return (number + 0.5) * 0x1p-32;
}
