#if ENTRY
/* the table's entry that is nearest to x >= 0; *beyond is how far beyond it x lies. Numbers from @FAR@ on are
   multiples of 1 / @PER_UNIT@, which the last bits count. */
static INLINE size_t entry(double x, double *beyond)
{
    const double shifted = x + @FAR@;
    uint64_t bits;
    memcpy(&bits, &shifted, sizeof bits);
    *beyond = x - (shifted - @FAR@);
    return (size_t)(bits & 255u);
}

#endif
#if ATAN_NEAR
/* atan about k / @PER_UNIT@: polynomials of what is beyond it */
@ATAN@
/* for 0 <= x < @ATAN_END@ */
static INLINE double atan_near(double x)
{
    double t;
    const double *const a = ATAN[entry(x, &t)];
    const double t2 = t * t, t4 = t2 * t2;
    return ((a[0] + a[1] * t) + (a[2] + a[3] * t) * t2) + ((a[4] + a[5] * t) * t4 + (a[6] + a[7] * t) * (t2 * t4));
}

#endif
#if OWN_ATAN
static INLINE double own_atan(double x)
{
    const double size = fabs(x);
    return size < @ATAN_END@.0 ? copysign(atan_near(size), x) : atan(x);
}

#endif
#if OWN_ATAN2
static INLINE double own_atan2(double y, double x)
{
    const double size = fabs(y);
    return x > 1e-290 && x < 1e290 && size < @ATAN_END@.0 * x ? copysign(atan_near(size / x), y) : atan2(y, x);
}

#endif
#if ANGLES
/* sine and cosine of k / @PER_UNIT@ */
@ANGLES@
/* sine and cosine of |x| < @ANGLE_END@: those of the nearest entry, turned by the rest */
static INLINE void turned(double x, double *sine, double *cosine)
{
    double t;
    const double *const a = ANGLES[entry(fabs(x), &t)];
    const double s = copysign(a[0], x), c = a[1], from = copysign(1.0, x) * t; /* the mirror image for x < 0 */
    const double t2 = t * t, t4 = t2 * t2;
    const double across = from * ((1.0 + -0.16666666666666666 * t2) + (0.008333333333333333 + -0.0001984126984126984 * t2) * t4);
    const double back = t2 * ((-0.5 + 0.041666666666666664 * t2) + -0.001388888888888889 * t4);
    *sine = s + (s * back + c * across);
    *cosine = c + (c * back - s * across);
}

#endif
#if OWN_COS
static INLINE double own_cos(double x)
{
    double sine, cosine;
    if (!(fabs(x) < @ANGLE_END@.0)) {
        return cos(x);
    }
    turned(x, &sine, &cosine);
    return cosine;
}

#endif
#if OWN_FMAX
static INLINE double own_fmax(double a, double b)
{
    return a > b ? a : b == b ? b : a;
}

#endif
#if OWN_FMIN
static INLINE double own_fmin(double a, double b)
{
    return a < b ? a : b == b ? b : a;
}

#endif
#if OWN_SIGN
static INLINE double own_sign(double x)
{
    return x < 0.0 ? -1.0 : x > 0.0 ? 1.0 : x;
}

#endif
#if OWN_SIN
static INLINE double own_sin(double x)
{
    double sine, cosine;
    if (!(fabs(x) < @ANGLE_END@.0)) {
        return sin(x);
    }
    turned(x, &sine, &cosine);
    return sine;
}

#endif
#if OWN_SINCOS
static INLINE void own_sincos(double x, double *sine, double *cosine)
{
    if (fabs(x) < @ANGLE_END@.0) {
        turned(x, sine, cosine);
    } else {
        *sine = sin(x);
        *cosine = cos(x);
    }
}

#endif
#if OWN_TANH
/* beyond 20 it is one to the last place */
static INLINE double own_tanh(double x)
{
    const double size = fabs(x);
    return size < 20.0 ? tanh(x) : size >= 20.0 ? copysign(1.0, x) : x;
}

#endif
