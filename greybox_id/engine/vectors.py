"""The C around the straight-line code: vectors of lanes, and loops over lanes, segments and sensitivities.

Lanes are GCC's vector type (clang has it too), as wide as the machine's registers: 8 with AVX-512, 4 with AVX2,
else 2. Functions come from glibc's libmvec on x86-64, whose results are within 4 ulp; elsewhere each lane calls the
mathematical library. With AVX-512 up to four lanes that are left over run in vectors of four, in three quarters of the
time: divisions and square roots take as long as a vector is wide. Infinities and NaN behave as in CasADi's virtual
machine: the flags promise nothing about them.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as cs

from .graph import Result, straight_line

WIDE, FEW = 8, 4
"""Lanes of the widest vectors, and of those that take what they would leave half empty."""

PRELUDE = r"""
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
#define LANES for (int l = 0; l < W; l++)

typedef double v __attribute__((vector_size(8 * W)));
typedef double u __attribute__((vector_size(8 * W), aligned(8)));
typedef long long m __attribute__((vector_size(8 * W)));

static inline v splat(double x) { v r; LANES r[l] = x; return r; }
static inline v where(m k, v a) { return (v)(k & (m)a); }
static inline v choose(m k, v a, v b) { return (v)((k & (m)a) | (~k & (m)b)); }
#if defined __FP_FAST_FMA || defined __FMA__ || defined __ARM_FEATURE_FMA
static inline v fused(v a, v b, v c) { LANES c[l] = __builtin_fma(a[l], b[l], c[l]); return c; }
#else
static inline v fused(v a, v b, v c) { return a * b + c; }
#endif

/* as C and CasADi have it: the other one, where one is NaN */
static inline v v_fmin(v a, v b) { return choose(a < b, a, choose(b == b, b, a)); }
static inline v v_fmax(v a, v b) { return choose(a > b, a, choose(b == b, b, a)); }
static inline v v_sign(v a) { return choose(a < splat(0), splat(-1), choose(a > splat(0), splat(1), a)); }
static inline v v_fabs(v a) { return (v)((m)a & ~(m)splat(-0.0)); }
static inline v v_copysign(v a, v b) { return (v)(((m)a & ~(m)splat(-0.0)) | ((m)b & (m)splat(-0.0))); }
static inline v v_sqrt(v a) { LANES a[l] = __builtin_sqrt(a[l]); return a; }
static inline v v_floor(v a) { LANES a[l] = __builtin_floor(a[l]); return a; }
static inline v v_ceil(v a) { LANES a[l] = __builtin_ceil(a[l]); return a; }

#define LANEWISE(name) static NOINLINE v v_##name(v a) { LANES a[l] = name(a[l]); return a; }
#define LANEWISE2(name) static NOINLINE v v_##name(v a, v b) { LANES a[l] = name(a[l], b[l]); return a; }
#define LIBRARY(name) v MVEC(v, name)(v); static inline v v_##name(v a) { return MVEC(v, name)(a); }
#define LIBRARY2(name) v MVEC(vv, name)(v, v); static inline v v_##name(v a, v b) { return MVEC(vv, name)(a, b); }
#if LIBMVEC >= 222
LIBRARY(sin) LIBRARY(cos) LIBRARY(log) LIBRARY2(pow)
v MVEC(v, exp)(v);
/* where it is nothing it would be called for each lane: what fades at once is a lag of none */
static inline v v_exp(v a)
{
    const m gone = a < splat(-746);
    return choose(gone, splat(0), MVEC(v, exp)(choose(gone, splat(0), a)));
}
#else
LANEWISE(sin) LANEWISE(cos) LANEWISE(exp) LANEWISE(log) LANEWISE2(pow)
#endif
#if LIBMVEC >= 235
LIBRARY(tan) LIBRARY(asin) LIBRARY(acos) LIBRARY(atan) LIBRARY(sinh) LIBRARY(cosh) LIBRARY(tanh) LIBRARY(asinh)
LIBRARY(acosh) LIBRARY(atanh) LIBRARY(expm1) LIBRARY(log1p) LIBRARY(erf) LIBRARY2(atan2) LIBRARY2(hypot)
#else
LANEWISE(tan) LANEWISE(asin) LANEWISE(acos) LANEWISE(atan) LANEWISE(sinh) LANEWISE(cosh) LANEWISE(tanh) LANEWISE(asinh)
LANEWISE(acosh) LANEWISE(atanh) LANEWISE(expm1) LANEWISE(log1p) LANEWISE(erf) LANEWISE2(atan2) LANEWISE2(hypot)
#endif
LANEWISE2(fmod) LANEWISE2(remainder)

/* W numbers of W lanes, from a vector of each lane to one of each number, and back: pairs of vectors exchange halves */
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

/* n numbers of each lane, between rows of memory and vectors; lanes beyond the last one repeat it and are not stored */
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
"""

SIMULATE = r"""
void simulate(ptrdiff_t lanes, ptrdiff_t segments, ptrdiff_t readings, ptrdiff_t kept, ptrdiff_t apart,
    const double *z0, const double *s, const double *p, const unsigned char *reads, const unsigned char *keeps,
    double *z_out, double *y_out)
{
    for (ptrdiff_t first = 0; first < lanes; first += W) {
        ptrdiff_t row[W], reading = 0, at = 0;
        const int real = rows(row, first, lanes);
        v z[NZ], next[NZ], now[NS + 1], q[NP + 1], w[VALUE_KEPT + 1], y[NY + 1];
        gather(z, NZ, z0, NZ, row);
        gather(q, NP, p, NP, row);
        value_fixed(q, w);
        for (ptrdiff_t k = 0; k < segments; k++) {
            if (keeps[k]) scatter(z, NZ, z_out + at++ * NZ, kept * NZ, row, real);
            gather(now, NS, s + k * NS, apart, row);
            value(z, now, q, w, next, y, reads[k]);
            if (reads[k]) scatter(y, NY, y_out + reading++ * NY, readings * NY, row, real);
            memcpy(z, next, sizeof z);
        }
        if (keeps[segments]) scatter(z, NZ, z_out + at * NZ, kept * NZ, row, real);
    }
}
"""

LINEARISE = r"""
#define TILE 3
#define BATCH (1 + 12 / (NY + 1))
/* adds the products of columns of n rows, tile by tile of nine in registers: the lower triangle, from a row on */
static void accumulate(const v *rows, ptrdiff_t n, v *H, ptrdiff_t wide, ptrdiff_t from)
{
    for (ptrdiff_t i = from; i < wide; i += TILE)
        for (ptrdiff_t j = 0; j <= i; j += TILE) {
            v *const top = H + i * wide + j, *const middle = top + wide, *const low = middle + wide;
            v a = top[0], b = top[1], c = top[2], d = middle[0], e = middle[1], f = middle[2];
            v g = low[0], h = low[1], k = low[2];
            for (ptrdiff_t row = 0; row < n; row++) {
                const v *const left = rows + row * wide + i, *const right = rows + row * wide + j;
                a = fused(left[0], right[0], a); b = fused(left[0], right[1], b); c = fused(left[0], right[2], c);
                d = fused(left[1], right[0], d); e = fused(left[1], right[1], e); f = fused(left[1], right[2], f);
                g = fused(left[2], right[0], g); h = fused(left[2], right[1], h); k = fused(left[2], right[2], k);
            }
            top[0] = a; top[1] = b; top[2] = c; middle[0] = d; middle[1] = e; middle[2] = f;
            low[0] = g; low[1] = h; low[2] = k;
        }
}

/* weighted residuals of one reading, and their weights, which are less in the tails of a robust loss */
static void weigh(const v *y, const v *target, v *w, v *r, double robust)
{
    for (int i = 0; i < NY; i++) {
        r[i] = choose(w[i] > splat(0), (y[i] - target[i]) * w[i], splat(0));
        if (robust < INFINITY) {
            const v size = v_fabs(r[i]), tail = choose(size > splat(robust), v_sqrt(splat(robust) / size), splat(1));
            r[i] = r[i] * tail;
            w[i] = w[i] * tail;
        }
    }
}

void linearise(ptrdiff_t lanes, ptrdiff_t segments, ptrdiff_t readings, ptrdiff_t columns, ptrdiff_t apart,
    double robust, const ptrdiff_t *moving, const double *z0, const double *s, const double *p,
    const unsigned char *reads, const double *seed, double *z_out, double *Z_out, double *y_out, double *Y_out,
    const double *target, const double *weight, const double *given, double *H_out, double *scratch)
{
    /* derivatives and, as their last column, residuals: the last row of their product is J'r */
    const ptrdiff_t wide = (columns + TILE) / TILE * TILE, packed = columns * (columns + 1) / 2;
    v *J = (v *)(((size_t)scratch + sizeof(v) - 1) / sizeof(v) * sizeof(v)), *H = J + BATCH * NY * wide;
    if (H_out) memset(J, 0, BATCH * NY * wide * sizeof(v));
    for (ptrdiff_t first = 0; first < lanes; first += W) {
        ptrdiff_t row[W], reading = 0, batch = 0;
        const int real = rows(row, first, lanes);
        v z[NZ], next[NZ], now[NS + 1], q[NP + 1], w[SLOPE_KEPT + 1], y[NY + 1], t[NY + 1], counts[NY + 1], r[NY + 1];
        v A[NA + 1], B[NB + 1], C[NC + 1], D[ND + 1], Z[NZ * (NZ + NP)], Y[NY * (NZ + NP) + 1];
        gather(z, NZ, z0, NZ, row);
        gather(q, NP, p, NP, row);
        gather(Z, NZ * columns, seed, NZ * columns, row);
        slope_fixed(q, w);
        if (H_out) memset(H, 0, wide * wide * sizeof(v));
        for (ptrdiff_t k = 0; k < segments; k++) {
            gather(now, NS, s + k * NS, apart, row);
            slope(z, now, q, w, next, y, A, B, C, D, reads[k], moving);
            if (reads[k]) {
                C_times(C, Z, Y, columns);
                add(D, ND, D_ROW, D_COLUMN, moving, Y, columns);
                if (H_out) {
                    gather(t, NY, target + reading * NY, readings * NY, row);
                    gather(counts, NY, weight + reading * NY, readings * NY, row);
                    weigh(y, t, counts, r, robust);
                    if (given) gather(r, NY, given + reading * NY, readings * NY, row);
                    for (int i = 0; i < NY; i++) {
                        v *const to = J + (batch * NY + i) * wide;
                        for (ptrdiff_t c = 0; c < columns; c++) to[c] = Y[i * columns + c] * counts[i];
                        to[columns] = r[i];
                    }
                    if (++batch == BATCH) {
                        accumulate(J, batch * NY, H, wide, given ? wide - TILE : 0);
                        batch = 0;
                    }
                } else {
                    scatter(y, NY, y_out + reading * NY, readings * NY, row, real);
                    scatter(Y, NY * columns, Y_out + reading * NY * columns, readings * NY * columns, row, real);
                }
                reading++;
            }
            A_times(A, Z, Z, columns);
            add(B, NB, B_ROW, B_COLUMN, moving, Z, columns);
            memcpy(z, next, sizeof z);
        }
        scatter(z, NZ, z_out, NZ, row, real);
        scatter(Z, NZ * columns, Z_out, NZ * columns, row, real);
        if (H_out) {
            accumulate(J, batch * NY, H, wide, given ? wide - TILE : 0);
            for (ptrdiff_t c = 1; c <= columns; c++)
                memmove(H + c * (c + 1) / 2, H + c * wide, (c + 1) * sizeof(v));
            scatter(H, packed + columns, H_out, packed + columns, row, real);
        }
    }
}
"""

ADD = r"""
static inline void add(const v *J, ptrdiff_t n, const short *row, const short *column, const ptrdiff_t *moving,
    v *to, ptrdiff_t columns)
{
    for (ptrdiff_t j = 0; j < n; j++)
        if (moving[column[j]] >= 0) to[row[j] * columns + moving[column[j]]] += J[j];
}
"""


def scratch_size(columns: int, outputs: int) -> int:
    """Numbers that adding up normal equations in so many columns takes: rows of a batch, their product, alignment."""
    wide = (columns + 3) // 3 * 3
    return WIDE * (1 + wide * (wide + outputs * (1 + 12 // (outputs + 1))))


def source(value: cs.Function, slope: cs.Function) -> str:
    """The C of a kernel; beside it stands `narrow_source`.

    Parameters
    ----------
    value : (z, s, p) -> z_next, y, dense.
    slope : (z, s, p) -> z_next, y, dense, and A, B, C, D: the derivatives of z_next and y, each by z and p, sparse.

    Raises `CannotCompile`.
    """
    A, B, C, D = (slope.sparsity_out(k) for k in range(2, 6))
    sizes = {"NA": A.nnz(), "NB": B.nnz(), "NC": C.nnz(), "ND": D.nnz()}
    following, y = _results(value)
    derivatives = [
        Result("A"),
        Result("B", [f"moving[{parameter}] >= 0" for parameter in B.get_triplet()[1]]),
        Result("C", ["reading"] * C.nnz()),
        Result("D", ["reading"] * D.nnz()),
    ]
    return "\n".join(
        [
            _simulation(value),
            *[f"#define {name} {size}" for name, size in sizes.items()],
            straight_line("slope", slope, [following, y, *derivatives], ["int reading", "const ptrdiff_t *moving"]),
            table("B_ROW", B.get_triplet()[0]),
            table("B_COLUMN", B.get_triplet()[1]),
            table("D_ROW", D.get_triplet()[0]),
            table("D_COLUMN", D.get_triplet()[1]),
            product("A_times", A),
            product("C_times", C),
            ADD,
            LINEARISE,
        ]
    )


def narrow_source(value: cs.Function) -> str:
    """The C of `simulate_few`, in vectors of `FEW` lanes; none where these are the widest there are."""
    simulation = _simulation(value).replace("void simulate(", "void simulate_few(")
    return f"#if defined __AVX512F__\n#define NARROW\n{simulation}\n#endif"


def _simulation(value: cs.Function) -> str:
    sizes = {"NZ": value.nnz_in(0), "NS": value.nnz_in(1), "NP": value.nnz_in(2), "NY": value.nnz_out(1)}
    return "\n".join(
        [
            PRELUDE,
            *[f"#define {name} {size}" for name, size in sizes.items()],
            straight_line("value", value, _results(value), ["int reading"]),
            SIMULATE,
        ]
    )


def _results(value: cs.Function) -> list[Result]:
    return [Result("next"), Result("y", ["reading"] * value.nnz_out(1))]


def table(name: str, entries: Sequence[int]) -> str:
    """A table of small numbers in C."""
    return f"static const short {name}[] = {{{', '.join(map(str, entries)) or 0}}};"


def product(name: str, sparsity: cs.Sparsity) -> str:
    """C of a sparse matrix times Z, column by column of Z so that the result may replace it."""
    row, column = sparsity.get_triplet()
    lines = [f"const v x{j} = Z[{j} * columns + c];" for j in sorted(set(column))]
    for i in range(sparsity.size1()):
        terms = [(f"J[{k}]", f"x{j}") for k, (r, j) in enumerate(zip(row, column, strict=True)) if r == i]
        text = " * ".join(terms[0]) if terms else "splat(0)"
        for entry, x in terms[1:]:
            text = f"fused({entry}, {x}, {text})"
        lines.append(f"result[{i} * columns + c] = {text};")
    return f"""
static void {name}(const v *J, const v *Z, v *result, ptrdiff_t columns)
{{
    for (ptrdiff_t c = 0; c < columns; c++) {{
        {(chr(10) + " " * 8).join(lines)}
    }}
}}"""
