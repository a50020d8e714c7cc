/* Functions for processors with fused multiply-add, inlined if they are few: library calls would spill all vector
   registers. Arguments are reduced to the range of a short polynomial (`tests/support/polynomials.py` derives the
   coefficients); within 2 ulp. Beyond the reduction, lanes call the mathematical library one by one. */
#define HALF_PI_0 0x1.921fb54442d18p+0
#define HALF_PI_1 0x1.1a62633145c07p-54
#define HALF_PI_2 -0x1.f1976b7ed8fbcp-110
#define QUARTER_PI_0 0x1.921fb54442d18p-1
#define QUARTER_PI_1 0x1.1a62633145c07p-55
#define LOG_2_0 0x1.62e42fefa39efp-1
#define LOG_2_1 0x1.abc9e3b39803fp-56
#define PER_HALF_PI 0x1.45f306dc9c883p-1
#define PER_LOG_2 0x1.71547652b82fep+0
#define SINE_0 -0x1.5555555555555p-3
#define SINE_1 0x1.1111111110bb2p-7
#define SINE_2 -0x1.a01a019e83816p-13
#define SINE_3 0x1.71de379654304p-19
#define SINE_4 -0x1.ae600aca92c64p-26
#define SINE_5 0x1.5e0b05bff20f2p-33
#define COSINE_0 0x1.5555555555555p-5
#define COSINE_1 -0x1.6c16c16c16967p-10
#define COSINE_2 0x1.a01a019f4e9b4p-16
#define COSINE_3 -0x1.27e4fa17bf139p-22
#define COSINE_4 0x1.1eeb68cd22f56p-29
#define COSINE_5 -0x1.907d8f29fe831p-37
#define ARCTANGENT_0 -0x1.5555555555554p-2
#define ARCTANGENT_1 0x1.9999999998dc4p-3
#define ARCTANGENT_2 -0x1.2492492404b84p-3
#define ARCTANGENT_3 0x1.c71c7173ea3c7p-4
#define ARCTANGENT_4 -0x1.745d0a97a103cp-4
#define ARCTANGENT_5 0x1.3b128bd13ad4dp-4
#define ARCTANGENT_6 -0x1.110022ea1642ap-4
#define ARCTANGENT_7 0x1.e095394500e78p-5
#define ARCTANGENT_8 -0x1.a6804c1919632p-5
#define ARCTANGENT_9 0x1.5ee719af5549cp-5
#define ARCTANGENT_10 -0x1.da589e23a9097p-6
#define ARCTANGENT_11 0x1.6d6a59d433d83p-7
#define EXPONENTIAL_0 0x1.0000000000000p-1
#define EXPONENTIAL_1 0x1.5555555555557p-3
#define EXPONENTIAL_2 0x1.5555555555556p-5
#define EXPONENTIAL_3 0x1.11111111100dcp-7
#define EXPONENTIAL_4 0x1.6c16c16c162d4p-10
#define EXPONENTIAL_5 0x1.a01a01abe7fe1p-13
#define EXPONENTIAL_6 0x1.a01a01a6d889cp-16
#define EXPONENTIAL_7 0x1.71de0231960ebp-19
#define EXPONENTIAL_8 0x1.27e4db646b17ep-22
#define EXPONENTIAL_9 0x1.af4de97ca4194p-26
#define EXPONENTIAL_10 0x1.1f730349868cep-29

#define BOTH(a, low, high) fused(splat(high), a, splat(low))
#if W == 8
typedef unsigned char mask;
static INLINE mask exceeds(v a, v b) { return __builtin_ia32_cmppd512_mask(a, b, 30, -1, 4); }
static INLINE mask equal(v a, v b) { return __builtin_ia32_cmppd512_mask(a, b, 0, -1, 4); }
static INLINE mask bits(m a, m b) { return __builtin_ia32_ptestmq512(a, b, -1); }
static INLINE v pick(mask k, v a, v b) { return __builtin_ia32_blendmpd_512_mask(b, a, k); }
#else
typedef m mask;
static INLINE mask exceeds(v a, v b) { return a > b; }
static INLINE mask equal(v a, v b) { return a == b; }
static INLINE mask bits(m a, m b) { return (a & b) != 0; }
static INLINE v pick(mask k, v a, v b) { return choose(k, a, b); }
#endif

/* whether any lane is above a limit; NaN is not */
static INLINE int any_above(v a, double limit)
{
#if W == 8
    return __builtin_ia32_cmppd512_mask(a, splat(limit), 30, -1, 4);
#elif W == 4
    return __builtin_ia32_movmskpd256((v)(a > splat(limit)));
#else
    int any = 0;
    LANES any |= a[l] > limit;
    return any;
#endif
}
#define REST(name) static NOINLINE COLD v rest_##name(v a, v known, double limit) \
    { LANES if (__builtin_fabs(a[l]) > limit) known[l] = name(a[l]); return known; }
REST(sin) REST(cos) REST(exp)
static NOINLINE COLD v rest_atan2(v y, v x, v known, double limit)
{
    LANES if (__builtin_fabs(y[l]) + __builtin_fabs(x[l]) > limit) known[l] = atan2(y[l], x[l]);
    return known;
}

/* sine and cosine: a multiple of pi/2 is subtracted; beyond a billion rounding may choose the wrong one */
#define TURNS 1e9
static INLINE void quarters(v a, v *sine, v *cosine, m *quarter)
{
    const v shifted = fused(a, splat(PER_HALF_PI), splat(0x1.8p52)), count = splat(0x1.8p52) - shifted;
    const v r = fused(count, splat(HALF_PI_2), fused(count, splat(HALF_PI_1), fused(count, splat(HALF_PI_0), a)));
    const v z = r * r, zz = z * z, z4 = zz * zz;
    const v s = fused(z4, BOTH(z, SINE_4, SINE_5), fused(zz, BOTH(z, SINE_2, SINE_3), BOTH(z, SINE_0, SINE_1)));
    const v c = fused(
        z4, BOTH(z, COSINE_4, COSINE_5), fused(zz, BOTH(z, COSINE_2, COSINE_3), BOTH(z, COSINE_0, COSINE_1)));
    *sine = fused(r * z, s, r);
    *cosine = fused(zz, c, fused(z, splat(-0.5), splat(1)));
    *quarter = (m)shifted;
}
static IN_LINE v v_sin(v a)
{
    v s, c;
    m quarter;
    quarters(a, &s, &c, &quarter);
    const v r = (v)((m)pick(bits(quarter, (m){0} + 1), c, s) ^ (quarter & 2) << 62);
    return any_above(v_fabs(a), TURNS) ? rest_sin(a, r, TURNS) : r;
}
static IN_LINE v v_cos(v a)
{
    v s, c;
    m quarter;
    quarters(a, &s, &c, &quarter);
    const v r = (v)((m)pick(bits(quarter, (m){0} + 1), s, c) ^ (quarter + 1 & 2) << 62);
    return any_above(v_fabs(a), TURNS) ? rest_cos(a, r, TURNS) : r;
}
/* atan(y/x) = k pi/4 + atan after rotation by -k pi/4; k = 1 for ratios above 1/2, 2 above 2 */
static INLINE v turned(v above, v below, v k)
{
    const v t = above / below, z = t * t, zz = z * z, z4 = zz * zz;
    const v low = fused(zz, BOTH(z, ARCTANGENT_2, ARCTANGENT_3), BOTH(z, ARCTANGENT_0, ARCTANGENT_1));
    const v middle = fused(zz, BOTH(z, ARCTANGENT_6, ARCTANGENT_7), BOTH(z, ARCTANGENT_4, ARCTANGENT_5));
    const v high = fused(zz, BOTH(z, ARCTANGENT_10, ARCTANGENT_11), BOTH(z, ARCTANGENT_8, ARCTANGENT_9));
    const v bent = fused(t * z, fused(z4 * z4, high, fused(z4, middle, low)), k * splat(QUARTER_PI_1));
    return fused(k, splat(QUARTER_PI_0), t + bent);
}
static IN_LINE v v_atan(v a)
{
    const v x = v_fabs(a);
    const mask some = exceeds(x, splat(0.5)), most = exceeds(x, splat(2));
    const v above = pick(most, splat(-1), pick(some, x - splat(1), x));
    const v below = pick(most, x, pick(some, x + splat(1), splat(1)));
    return v_copysign(turned(above, below, pick(most, splat(2), pick(some, splat(1), splat(0)))), a);
}
#define LARGE 1e300
static IN_LINE v v_atan2(v b, v a)
{
    const v y = v_fabs(b), x = v_fabs(a), sum = y + x;
    const mask some = exceeds(y + y, x), most = exceeds(y, x + x);
    const m behind = (m)a & (m)splat(-0.0);
    const v above = pick(most, -x, pick(some, y - x, y)), below = pick(most, y, pick(some, sum, x));
    const v k = pick(most, splat(2), pick(some, splat(1), splat(0)));
    const v back = splat(4) - k;
    v r = turned((v)((m)above ^ behind), below, pick(bits(behind, behind), back, k));
    r = pick(equal(sum, splat(0)), pick(bits(behind, behind), splat(2 * HALF_PI_0), splat(0)), r);
    r = v_copysign(r, b);
    return any_above(sum, LARGE) ? rest_atan2(b, a, r, LARGE) : r;
}

/* exp a = 2^n (1 + r + polynomial(r)), with |r| <= log(2)/2; 2^n is finite up to n = 1023 */
#define SPAN 708
static INLINE v beyond(v a, v *r, v *power)
{
    const v shifted = fused(a, splat(PER_LOG_2), splat(0x1.8p52)), count = splat(0x1.8p52) - shifted;
    *r = fused(count, splat(LOG_2_1), fused(count, splat(LOG_2_0), a));
    const v z = *r * *r, zz = z * z;
    const v low = fused(z, BOTH(*r, EXPONENTIAL_2, EXPONENTIAL_3), BOTH(*r, EXPONENTIAL_0, EXPONENTIAL_1));
    const v middle = fused(z, BOTH(*r, EXPONENTIAL_6, EXPONENTIAL_7), BOTH(*r, EXPONENTIAL_4, EXPONENTIAL_5));
    const v high = fused(z, splat(EXPONENTIAL_10), BOTH(*r, EXPONENTIAL_8, EXPONENTIAL_9));
    *power = (v)(((m)shifted << 52) + (m)splat(1));
    return z * fused(zz * zz, high, fused(zz, middle, low));
}
static IN_LINE v v_exp(v a)
{
    v r, power;
    const mask gone = exceeds(splat(-746), a); /* underflow to zero: a lag of zero decays at once */
    const v b = pick(gone, splat(0), a), s = beyond(b, &r, &power) + r;
    const v e = pick(gone, splat(0), fused(s, power, power));
    return any_above(v_fabs(b), SPAN) ? rest_exp(b, e, SPAN) : e;
}
/* tanh a = e / (e + 2) with e = exp(2 a) - 1; rounding errors are corrected below e = 2; at 20 it is 1 */
static IN_LINE v v_tanh(v a)
{
    v r, power;
    const v x = v_fabs(a), s = beyond(pick(exceeds(x, splat(20)), splat(40), x + x), &r, &power);
    const v less = power - splat(1), sum = fused(power, r, less), rest = fused(power, s, fused(power, r, less - sum));
    const v e = sum + rest, left = (sum - e) + rest, below = e + splat(2), below_left = (splat(2) - below) + e + left;
    const v q = e / below, share = pick(exceeds(e, splat(2)), splat(0), fused(q, splat(-0.5), splat(0.5)));
    return v_copysign(fused(left - q * below_left, share, q), a);
}
