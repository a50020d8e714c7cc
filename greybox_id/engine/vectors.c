#include <math.h>
#include <stddef.h>
#include <string.h>

#if defined __AVX512F__ && !defined NARROW
#define W 8
#define EACH(k) {at[0][k], at[1][k], at[2][k], at[3][k], at[4][k], at[5][k], at[6][k], at[7][k]}
#define MVEC(arguments, name) _ZGVeN8##arguments##_##name
#elif defined __AVX2__
#define W 4
#define EACH(k) {at[0][k], at[1][k], at[2][k], at[3][k]}
#define MVEC(arguments, name) _ZGVdN4##arguments##_##name
#else
#define W 2
#define EACH(k) {at[0][k], at[1][k]}
#define MVEC(arguments, name) _ZGVbN2##arguments##_##name
#endif
#if defined __x86_64__ && defined __GLIBC__
#define LIBMVEC (__GLIBC__ * 100 + __GLIBC_MINOR__)
#else
#define LIBMVEC 0
#endif
#define NOINLINE __attribute__((noinline))
#define COLD __attribute__((cold))
#ifndef INLINE
#define INLINE inline __attribute__((always_inline))
#endif
#define LANES for (int l = 0; l < W; l++)

typedef double v __attribute__((vector_size(8 * W)));
typedef double u __attribute__((vector_size(8 * W), aligned(8)));
typedef long long m __attribute__((vector_size(8 * W)));

static INLINE v splat(double x) { return x - (v){0}; }
static INLINE v where(m k, v a) { return (v)(k & (m)a); }
static INLINE v choose(m k, v a, v b) { return (v)((k & (m)a) | (~k & (m)b)); }
#if defined __FP_FAST_FMA || defined __FMA__ || defined __ARM_FEATURE_FMA
#define FUSED 1
#if W == 8
static INLINE v fused(v a, v b, v c) { return __builtin_ia32_vfmaddpd512_mask(a, b, c, -1, 4); }
#elif W == 4
static INLINE v fused(v a, v b, v c) { return __builtin_ia32_vfmaddpd256(a, b, c); }
#else
static INLINE v fused(v a, v b, v c) { LANES c[l] = __builtin_fma(a[l], b[l], c[l]); return c; }
#endif
#else
#define FUSED 0
static INLINE v fused(v a, v b, v c) { return a * b + c; }
#endif

/* whether any lane is not zero; NaN is not zero */
static INLINE int any_set(v a)
{
#if W == 8
    return __builtin_ia32_cmppd512_mask(a, splat(0), 4, -1, 4);
#elif W == 4
    return __builtin_ia32_movmskpd256((v)(a != splat(0)));
#else
    int any = 0;
    LANES any |= a[l] != 0;
    return any;
#endif
}

/* as in C and CasADi: if one is NaN, the other one */
static INLINE v v_fmin(v a, v b) { return choose(a < b, a, choose(b == b, b, a)); }
static INLINE v v_fmax(v a, v b) { return choose(a > b, a, choose(b == b, b, a)); }
static INLINE v v_sign(v a) { return choose(a < splat(0), splat(-1), choose(a > splat(0), splat(1), a)); }
static INLINE v v_fabs(v a) { return (v)((m)a & ~(m)splat(-0.0)); }
static INLINE v v_copysign(v a, v b) { return (v)(((m)a & ~(m)splat(-0.0)) | ((m)b & (m)splat(-0.0))); }
static INLINE v v_sqrt(v a) { LANES a[l] = __builtin_sqrt(a[l]); return a; }
static INLINE v v_floor(v a) { LANES a[l] = __builtin_floor(a[l]); return a; }
static INLINE v v_ceil(v a) { LANES a[l] = __builtin_ceil(a[l]); return a; }

#define LANEWISE(name) static NOINLINE v v_##name(v a) { LANES a[l] = name(a[l]); return a; }
#define LANEWISE2(name) static NOINLINE v v_##name(v a, v b) { LANES a[l] = name(a[l], b[l]); return a; }
#define LIBRARY(name) v MVEC(v, name)(v); static inline v v_##name(v a) { return MVEC(v, name)(a); }
#define LIBRARY2(name) v MVEC(vv, name)(v, v); static inline v v_##name(v a, v b) { return MVEC(vv, name)(a, b); }
#if LIBMVEC >= 222
LIBRARY(log) LIBRARY2(pow)
#else
LANEWISE(log) LANEWISE2(pow)
#endif
#if LIBMVEC >= 235
LIBRARY(tan) LIBRARY(asin) LIBRARY(acos) LIBRARY(sinh) LIBRARY(cosh) LIBRARY(asinh)
LIBRARY(acosh) LIBRARY(atanh) LIBRARY(expm1) LIBRARY(log1p) LIBRARY(erf) LIBRARY2(hypot)
#else
LANEWISE(tan) LANEWISE(asin) LANEWISE(acos) LANEWISE(sinh) LANEWISE(cosh) LANEWISE(asinh)
LANEWISE(acosh) LANEWISE(atanh) LANEWISE(expm1) LANEWISE(log1p) LANEWISE(erf) LANEWISE2(hypot)
#endif
LANEWISE2(fmod) LANEWISE2(remainder)

/* `functions.c` defines these for processors with fused multiply-add */
#if !FUSED
#if LIBMVEC >= 222
LIBRARY(sin) LIBRARY(cos)
v MVEC(v, exp)(v);
/* on underflow libmvec would call it for each lane: a lag of zero decays at once */
static INLINE v v_exp(v a)
{
    const m gone = a < splat(-746);
    return choose(gone, splat(0), MVEC(v, exp)(choose(gone, splat(0), a)));
}
#else
LANEWISE(sin) LANEWISE(cos) LANEWISE(exp)
#endif
#if LIBMVEC >= 235
LIBRARY(atan) LIBRARY(tanh) LIBRARY2(atan2)
#else
LANEWISE(atan) LANEWISE(tanh) LANEWISE2(atan2)
#endif
#endif

/* transpose W numbers of W lanes: pairs of vectors exchange halves */
#if defined __GNUC__ && !defined __clang__
#define TRANSPOSES 1
#define EXCHANGE(distance, LOW, HIGH) \
    _Pragma("GCC unroll 8") \
    for (int i = 0; i < W; i++) \
        if (!(i & distance)) { \
            const v a = x[i], b = x[i + distance]; \
            x[i] = __builtin_shuffle(a, b, (m)LOW); \
            x[i + distance] = __builtin_shuffle(a, b, (m)HIGH); \
        }
#define SET(...) {__VA_ARGS__}
static inline __attribute__((always_inline)) void transpose(v *x)
{
#if W == 8
    EXCHANGE(1, SET(0, 8, 2, 10, 4, 12, 6, 14), SET(1, 9, 3, 11, 5, 13, 7, 15))
    EXCHANGE(2, SET(0, 1, 8, 9, 4, 5, 12, 13), SET(2, 3, 10, 11, 6, 7, 14, 15))
    EXCHANGE(4, SET(0, 1, 2, 3, 8, 9, 10, 11), SET(4, 5, 6, 7, 12, 13, 14, 15))
#elif W == 4
    EXCHANGE(1, SET(0, 4, 2, 6), SET(1, 5, 3, 7))
    EXCHANGE(2, SET(0, 1, 4, 5), SET(2, 3, 6, 7))
#else
    EXCHANGE(1, SET(0, 2), SET(1, 3))
#endif
}
#else
#define TRANSPOSES 0
static void transpose(v *x) {}
#endif

/* move n numbers per lane between rows of memory and vectors; lanes beyond the last repeat it and are not stored */
static inline void gather(v *to, ptrdiff_t n, const double *from, ptrdiff_t stride, const ptrdiff_t *row)
{
    if (TRANSPOSES && n >= W) {
        for (ptrdiff_t k = 0; k < n; k += W) {
            const ptrdiff_t own = k + W <= n ? k : n - W;
            v x[W];
            LANES x[l] = *(const u *)(from + row[l] * stride + own);
            transpose(x);
            LANES to[own + l] = x[l];
        }
    } else {
        const double *at[W];
        LANES at[l] = from + row[l] * stride;
        for (ptrdiff_t k = 0; k < n; k++) to[k] = (v)EACH(k);
    }
}
/* the k-th n numbers of each lane's series; several are gathered at a time to fill vectors */
#define AHEAD(n) ((n) < W ? W : 1)
static inline v *ahead(v *to, ptrdiff_t n, const double *from, ptrdiff_t stride, ptrdiff_t k, ptrdiff_t count,
    const ptrdiff_t *row)
{
    const ptrdiff_t some = AHEAD(n), left = count - k;
    if (k % some == 0) gather(to, n * (left < some ? left : some), from + k * n, stride, row);
    return to + k % some * n;
}
static NOINLINE void scatter(const v *from, ptrdiff_t n, double *to, ptrdiff_t stride, const ptrdiff_t *row, int lanes)
{
    if (TRANSPOSES && n >= W) {
        for (ptrdiff_t k = 0; k < n; k += W) {
            const ptrdiff_t own = k + W <= n ? k : n - W;
            v x[W];
            LANES x[l] = from[own + l];
            transpose(x);
            for (int l = 0; l < lanes; l++) *(u *)(to + row[l] * stride + own) = x[l];
        }
    } else for (int l = 0; l < lanes; l++) {
        double *at = to + row[l] * stride;
        for (ptrdiff_t k = 0; k < n; k++) at[k] = ((const double *)from)[k * W + l];
    }
}
static inline int rows(ptrdiff_t *row, ptrdiff_t first, ptrdiff_t lanes)
{
    const int real = lanes - first < W ? (int)(lanes - first) : W;
    LANES row[l] = first + (l < real ? l : real - 1);
    return real;
}
