/* car: kinematic single-track vehicle with an understeer gradient (kinematic), from fit, greybox-id 1.0.0rc1. */

#if defined(__FAST_MATH__) || defined(__ASSOCIATIVE_MATH__) || defined(_M_FP_FAST)
#error "The tables here need sums taken in the order in which they stand: no -ffast-math, -Ofast or /fp:fast."
#elif defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__
#error "What is not finite has to stay so: no -ffinite-math-only."
#endif

#include "car.h"

#include <math.h>
#include <stdint.h>
#include <string.h>

#if defined __GNUC__
#define INLINE inline __attribute__((always_inline, unused))
#else
#define INLINE inline
#endif

/* the table's entry that is nearest to x >= 0; *beyond is how far beyond it x lies. Numbers from 0x1p47 on are
   multiples of 1 / 32, which the last bits count. */
static INLINE size_t entry(double x, double *beyond)
{
    const double shifted = x + 0x1p47;
    uint64_t bits;
    memcpy(&bits, &shifted, sizeof bits);
    *beyond = x - (shifted - 0x1p47);
    return (size_t)(bits & 255u);
}

/* sine and cosine of k / 32 */
static const double ANGLES[97][2] = {
    {0x0.0p+0, 0x1.0000000000000p+0},
    {0x1.ffeaaaeeee86fp-6, 0x1.ffc00155527d3p-1},
    {0x1.ffaaaeeed4edbp-5, 0x1.ff0015549f4d3p-1},
    {0x1.7f701032550e4p-4, 0x1.fdc06bf7e6b9bp-1},
    {0x1.feaaeee86ee36p-4, 0x1.fc015527d5bd3p-1},
    {0x1.3eb312c5d66cbp-3, 0x1.f9c340a7cc428p-1},
    {0x1.7dc102fbaf2b5p-3, 0x1.f706bdf9ece1cp-1},
    {0x1.bc6f84edc6199p-3, 0x1.f3cc7c3b3d16ep-1},
    {0x1.faaeed4f31577p-3, 0x1.f01549f7deea1p-1},
    {0x1.1c37d64c6b876p-2, 0x1.ebe214f76efa8p-1},
    {0x1.3ad129769d3d8p-2, 0x1.e733ea0193d40p-1},
    {0x1.591bc9fa2f597p-2, 0x1.e20bf49acd6c1p-1},
    {0x1.7710255764214p-2, 0x1.dc6b7eb995912p-1},
    {0x1.94a6be9f546c5p-2, 0x1.d653f073e4040p-1},
    {0x1.b1d8305321617p-2, 0x1.cfc6cfa52ad9fp-1},
    {0x1.ce9d2e3d4a51fp-2, 0x1.c8c5bf8ce1a84p-1},
    {0x1.eaee8744b05f0p-2, 0x1.c1528065b7d50p-1},
    {0x1.0362939c69955p-1, 0x1.b96eeef58840ep-1},
    {0x1.110d0c4b69c3bp-1, 0x1.b11d04162a4c6p-1},
    {0x1.1e7343236574cp-1, 0x1.a85ed4373e02dp-1},
    {0x1.2b91dea88421ep-1, 0x1.9f368ed912f85p-1},
    {0x1.386597456282bp-1, 0x1.95a67e00cb1fdp-1},
    {0x1.44eb381cf386bp-1, 0x1.8bb105a5dc900p-1},
    {0x1.511f9fd7b351cp-1, 0x1.8158a31916d5dp-1},
    {0x1.5cffc16bf8f0dp-1, 0x1.769fec655211fp-1},
    {0x1.6888a4e134b2fp-1, 0x1.6b898fa9efb5dp-1},
    {0x1.73b7680dea578p-1, 0x1.6018526f563dfp-1},
    {0x1.7e893f5037959p-1, 0x1.544f10f592ca5p-1},
    {0x1.88fb7640b8da2p-1, 0x1.4830bd7d4ceb3p-1},
    {0x1.930b705f9f85ap-1, 0x1.3bc05f8b3a656p-1},
    {0x1.9cb6a9bbce64bp-1, 0x1.2f011326420e4p-1},
    {0x1.a5fab793d29c8p-1, 0x1.21f608107e37ap-1},
    {0x1.aed548f090ceep-1, 0x1.14a280fb5068cp-1},
    {0x1.b74427397fca2p-1, 0x1.0709d2b6b95eep-1},
    {0x1.bf4536c24bb85p-1, 0x1.f25ec6b852fc2p-2},
    {0x1.c6d67751be646p-1, 0x1.d62d52e9fdfa9p-2},
    {0x1.cdf604a1cadcep-1, 0x1.b9865639d0596p-2},
    {0x1.d4a216d89c717p-1, 0x1.9c70fa40c279dp-2},
    {0x1.dad902fa8ac87p-1, 0x1.7ef4842f0bccdp-2},
    {0x1.e0993b54d68f6p-1, 0x1.611852fae0769p-2},
    {0x1.e5e14fe11418cp-1, 0x1.42e3dd88bd952p-2},
    {0x1.eaafeea12b0c4p-1, 0x1.245eb0cdba154p-2},
    {0x1.ef03e3f3d42a2p-1, 0x1.05906dec537dap-2},
    {0x1.f2dc1ae18002ep-1, 0x1.cd0190985ef77p-3},
    {0x1.f6379d619369dp-1, 0x1.8e6f075a987d6p-3},
    {0x1.f9159497e853fp-1, 0x1.4f78e46e35a46p-3},
    {0x1.fb75490a83c2cp-1, 0x1.102ee507ff5f0p-3},
    {0x1.fd5622cf734eap-1, 0x1.a141b6a6da89dp-4},
    {0x1.feb7a9b2c6d8bp-1, 0x1.21bd54fc5f9a7p-4},
    {0x1.ff9985549ce69p-1, 0x1.43e10afde8436p-5},
    {0x1.fffb7d3f3a253p-1, 0x1.0fd9d5c093df5p-7},
    {0x1.ffdd78f5268bfp-1, -0x1.780a3ac0ba58bp-6},
    {0x1.ff3f7ff74c9a7p-1, -0x1.bbd1afe4369efp-5},
    {0x1.fe21b9c319278p-1, -0x1.5d97a825ea2aap-4},
    {0x1.fc846dc89c3afp-1, -0x1.dcef1441cb33cp-4},
    {0x1.fa680358ad68ap-1, -0x1.2de7a38a3ff6fp-3},
    {0x1.f7cd018b18246p-1, -0x1.6d0c449d3e98ap-3},
    {0x1.f4b40f1cd6831p-1, -0x1.abd5a485cce28p-3},
    {0x1.f11df24662dadp-1, -0x1.ea34113fa728fp-3},
    {0x1.ed0b908a2aac3p-1, -0x1.140bf9c1636a7p-2},
    {0x1.e87dee7b2f393p-1, -0x1.32b8e9548fce1p-2},
    {0x1.e3762f7be2204p-1, -0x1.51192c465a31bp-2},
    {0x1.ddf595754e444p-1, -0x1.6f252aae8625bp-2},
    {0x1.d7fd80869f372p-1, -0x1.8cd561b589476p-2},
    {0x1.d18f6ead1b446p-1, -0x1.aa22657537205p-2},
    {0x1.caacfb64a61cdp-1, -0x1.c704e2d3b0cbfp-2},
    {0x1.c357df40e4024p-1, -0x1.e375a15821ab9p-2},
    {0x1.bb91ef7f1729ep-1, -0x1.ff6d84f8d3facp-2},
    {0x1.b35d1d90d2dd6p-1, -0x1.0d72c7f114e12p-1},
    {0x1.aabb769fa1ad3p-1, -0x1.1aeb721b04367p-1},
    {0x1.a1af2309bdca6p-1, -0x1.281d62e1a3938p-1},
    {0x1.983a65d7fc580p-1, -0x1.35054dda59168p-1},
    {0x1.8e5f9c2d0e3a9p-1, -0x1.419ff91b9ba6dp-1},
    {0x1.84213cae3a920p-1, -0x1.4dea3e0b69097p-1},
    {0x1.7981d6e5b8b11p-1, -0x1.59e10a28e82edp-1},
    {0x1.6e84129ed0f95p-1, -0x1.65815fd1054fdp-1},
    {0x1.632aaf3bed93bp-1, -0x1.70c856fdd6b67p-1},
    {0x1.57788306c57f6p-1, -0x1.7bb31e009a57bp-1},
    {0x1.4b707a7acdecdp-1, -0x1.863efa361dc25p-1},
    {0x1.3f15978a1f45fp-1, -0x1.906948b56347dp-1},
    {0x1.326af0dcfcab1p-1, -0x1.9a2f7ef858b7dp-1},
    {0x1.2573b10c2dffep-1, -0x1.a38f2b7e75819p-1},
    {0x1.183315d65df2ap-1, -0x1.ac85f6691793ep-1},
    {0x1.0aac6f50aea35p-1, -0x1.b511a21177e5ep-1},
    {0x1.f9c63e25718c7p-2, -0x1.bd300b98112c3p-1},
    {0x1.ddb52ebc547f7p-2, -0x1.c4df2b6d54e0cp-1},
    {0x1.c12cb48474a24p-2, -0x1.cc1d15d38c71cp-1},
    {0x1.a433f17654f04p-2, -0x1.d2e7fb59c6201p-1},
    {0x1.86d2239c183fbp-2, -0x1.d93e294faed14p-1},
    {0x1.690ea34208610p-2, -0x1.df1e0a323be10p-1},
    {0x1.4af0e1208cd6dp-2, -0x1.e486261109c75p-1},
    {0x1.2c80648006a85p-2, -0x1.e97522ec563bcp-1},
    {0x1.0dc4c95708521p-2, -0x1.ede9c50b7e58fp-1},
    {0x1.dd8b7cc6c48dbp-3, -0x1.f1e2ef4beb207p-1},
    {0x1.9f16067cfb738p-3, -0x1.f55fa36858a40p-1},
    {0x1.6038ccdb01312p-3, -0x1.f85f02386603dp-1},
    {0x1.210386db6d55bp-3, -0x1.fae04be85e5d2p-1}
};

/* sine and cosine of |x| < 3: those of the nearest entry, turned by the rest */
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

static INLINE double own_cos(double x)
{
    double sine, cosine;
    if (!(fabs(x) < 3.0)) {
        return cos(x);
    }
    turned(x, &sine, &cosine);
    return cosine;
}

static INLINE double own_fmax(double a, double b)
{
    return a > b ? a : b == b ? b : a;
}

const double car_default_parameters[] = {
    0.1743787708474309, 0.16077599473194182, 0.16109380063427894, 0.004881122476949204,
    0.07200693437696039
};

const char *const car_state_names[] = {
    "yaw_rate"
};

const char *const car_input_names[] = {
    "steer", "v_x"
};

const char *const car_parameter_names[] = {
    "l_f", "l_r", "yaw_lag", "K_us", "steering_delay"
};

const char *const car_output_names[] = {
    "yaw_rate", "a_y"
};

void car_step(const double *x, const double *u, const double *p, double dt, double *x_next)
{
    const double v11 = p[0] + p[1];
    const double v18 = own_fmax((v11 + (p[3] * (u[1] * u[1]))), (0.1 * v11));
    const double v22 = 1.0 / p[2];
    const double v26 = dt * (1.0 / 2.0);
    const double v7 = tan(u[0]);
    const double v19 = (u[1] * v7) / v18;
    const double v23 = (v19 - x[0]) * v22;
    const double v30 = (v19 - (x[0] + (v26 * v23))) * v22;
    const double v36 = (v19 - (x[0] + (v26 * v30))) * v22;
    const double v43 = ((v23 + (v30 + v30)) + (v36 + v36)) + ((v19 - (x[0] + (dt * v36))) * v22);
    const double v45 = x[0] + ((dt * (1.0 / 6.0)) * v43);
    x_next[0] = v45;
}

void car_step_jacobian(const double *x, const double *u, const double *p, double dt, double *x_next,
    double *by_x, double *by_u)
{
    const double v4 = dt * (1.0 / 6.0);
    const double v11 = p[0] + p[1];
    const double v15 = v11 + (p[3] * (u[1] * u[1]));
    const double v17 = 0.1 * v11;
    const double v18 = own_fmax(v15, v17);
    const double v19 = 1.0 / v18;
    const double v23 = 1.0 / p[2];
    const double v27 = dt * (1.0 / 2.0);
    const double v50 = (1.0 - (v27 * v23)) * v23;
    const double v51 = -v50;
    const double v56 = (1.0 - (v27 * v50)) * v23;
    const double v57 = -v56;
    const double v63 = (((v51 + v51) - v23) + (v57 + v57)) - ((1.0 - (dt * v56)) * v23);
    const double v65 = 1.0 + (v4 * v63);
    const int v88 = v17 <= v15;
    const int v89 = v15 <= v17;
    const double v94 = ((double)v88 / ((double)v88 + (double)v89)) * (p[3] * (u[1] + u[1]));
    const double v7 = tan(u[0]);
    const double v20 = (u[1] * v7) * v19;
    const double v24 = (v20 - x[0]) * v23;
    const double v31 = (v20 - (x[0] + (v27 * v24))) * v23;
    const double v37 = (v20 - (x[0] + (v27 * v31))) * v23;
    const double v44 = ((v24 + (v31 + v31)) + (v37 + v37)) + ((v20 - (x[0] + (dt * v37))) * v23);
    const double v46 = x[0] + (v4 * v44);
    const double v66 = own_cos(u[0]);
    const double v69 = (u[1] / (v66 * v66)) * v19;
    const double v70 = v69 * v23;
    const double v73 = (v69 - (v27 * v70)) * v23;
    const double v78 = (v69 - (v27 * v73)) * v23;
    const double v84 = ((v70 + (v73 + v73)) + (v78 + v78)) + ((v69 - (dt * v78)) * v23);
    const double v85 = v4 * v84;
    const double v96 = (v7 * v19) - ((v20 * v19) * v94);
    const double v97 = v96 * v23;
    const double v100 = (v96 - (v27 * v97)) * v23;
    const double v105 = (v96 - (v27 * v100)) * v23;
    const double v111 = ((v97 + (v100 + v100)) + (v105 + v105)) + ((v96 - (dt * v105)) * v23);
    const double v112 = v4 * v111;
    x_next[0] = v46;
    by_x[0] = v65;
    by_u[0] = v85;
    by_u[1] = v112;
}

void car_step_by_p(const double *x, const double *u, const double *p, double dt, double *by_p)
{
    const double v3 = p[0] + p[1];
    const double v6 = u[1] * u[1];
    const double v8 = v3 + (p[3] * v6);
    const double v9 = 0.1 * v3;
    const int v10 = v8 <= v9;
    const int v11 = v9 <= v8;
    const double v13 = 1.0 / ((double)v11 + (double)v10);
    const double v18 = own_fmax(v8, v9);
    const double v19 = 1.0 / v18;
    const double v25 = dt * (1.0 / 6.0);
    const double v27 = 1.0 / p[2];
    const double v28 = v25 * v27;
    const double v29 = v25 + v25;
    const double v31 = v29 - (dt * v28);
    const double v32 = v31 * v27;
    const double v36 = dt * (1.0 / 2.0);
    const double v38 = v29 - (v36 * v32);
    const double v39 = v38 * v27;
    const double v42 = v25 - (v36 * v39);
    const double v16 = tan(u[0]);
    const double v20 = (u[1] * v16) * v19;
    const double v45 = (v20 * v19) * (((v28 + v32) + v39) + (v42 * v27));
    const double v49 = ((double)v11 * v13) * v45;
    const double v51 = -((0.1 * (((double)v10 * v13) * v45)) + v49);
    const double v54 = (v20 - x[0]) * v27;
    const double v58 = (v20 - (x[0] + (v36 * v54))) * v27;
    const double v62 = (v20 - (x[0] + (v36 * v58))) * v27;
    const double v71 = ((((v20 - (x[0] + (dt * v62))) * v27) * v27) * v25) + ((v62 * v27) * v31);
    const double v78 = -((v71 + ((v58 * v27) * v38)) + ((v54 * v27) * v42));
    const double v80 = -(v6 * v49);
    by_p[0] = v51;
    by_p[1] = v51;
    by_p[2] = v78;
    by_p[3] = v80;
    by_p[4] = 0.0;
}

void car_ode(const double *x, const double *u, const double *p, double *x_dot)
{
    const double v6 = p[0] + p[1];
    const double v13 = own_fmax((v6 + (p[3] * (u[1] * u[1]))), (0.1 * v6));
    const double v2 = tan(u[0]);
    const double v19 = (((u[1] * v2) / v13) - x[0]) * (1.0 / p[2]);
    x_dot[0] = v19;
}

void car_ode_jacobian(const double *x, const double *u, const double *p, double *x_dot,
    double *by_x, double *by_u)
{
    const double v6 = p[0] + p[1];
    const double v10 = v6 + (p[3] * (u[1] * u[1]));
    const double v12 = 0.1 * v6;
    const double v13 = own_fmax(v10, v12);
    const double v14 = 1.0 / v13;
    const double v19 = 1.0 / p[2];
    const double v21 = -v19;
    const int v29 = v12 <= v10;
    const int v30 = v10 <= v12;
    const double v35 = ((double)v29 / ((double)v29 + (double)v30)) * (p[3] * (u[1] + u[1]));
    const double v2 = tan(u[0]);
    const double v15 = (u[1] * v2) * v14;
    const double v20 = (v15 - x[0]) * v19;
    const double v22 = own_cos(u[0]);
    const double v26 = ((u[1] / (v22 * v22)) * v14) * v19;
    const double v38 = ((v2 * v14) - ((v15 * v14) * v35)) * v19;
    x_dot[0] = v20;
    by_x[0] = v21;
    by_u[0] = v26;
    by_u[1] = v38;
}

void car_output(const double *x, const double *u, const double *p, double *y)
{
    const double v8 = p[0] + p[1];
    const double v15 = own_fmax((v8 + (p[3] * (u[1] * u[1]))), (0.1 * v8));
    const double v5 = tan(u[0]);
    const double v22 = (u[1] * x[0]) + (p[1] * ((((u[1] * v5) / v15) - x[0]) * (1.0 / p[2])));
    const double y_0 = x[0];
    y[0] = y_0;
    y[1] = v22;
}

void car_output_jacobian(const double *x, const double *u, const double *p, double *y, double *by_x,
    double *by_u)
{
    const double v8 = p[0] + p[1];
    const double v12 = v8 + (p[3] * (u[1] * u[1]));
    const double v14 = 0.1 * v8;
    const double v15 = own_fmax(v12, v14);
    const double v16 = 1.0 / v15;
    const double v20 = 1.0 / p[2];
    const double v26 = u[1] - (p[1] * v20);
    const int v36 = v14 <= v12;
    const int v37 = v12 <= v14;
    const double v42 = ((double)v36 / ((double)v36 + (double)v37)) * (p[3] * (u[1] + u[1]));
    const double v5 = tan(u[0]);
    const double v17 = (u[1] * v5) * v16;
    const double v23 = (u[1] * x[0]) + (p[1] * ((v17 - x[0]) * v20));
    const double v28 = own_cos(u[0]);
    const double v33 = p[1] * (((u[1] / (v28 * v28)) * v16) * v20);
    const double v47 = x[0] + (p[1] * (((v5 * v16) - ((v17 * v16) * v42)) * v20));
    const double y_0 = x[0];
    y[0] = y_0;
    y[1] = v23;
    by_x[0] = 1.0;
    by_x[1] = v26;
    by_u[0] = 0.0;
    by_u[1] = v33;
    by_u[2] = 0.0;
    by_u[3] = v47;
}

void car_delays(const double *p, double *s)
{
    const double s_0 = p[4];
    s[0] = s_0;
}

void car_vde_forw(const double *x, const double *S_x, const double *S_u, const double *u,
    const double *p, double *x_dot, double *S_x_dot, double *S_u_dot)
{
    double by_x[CAR_NX * CAR_NX], by_u[CAR_NX * CAR_NU];
    int i, j, k;
    car_ode_jacobian(x, u, p, x_dot, by_x, by_u);
    for (j = 0; j < CAR_NX; j++) {
        for (i = 0; i < CAR_NX; i++) {
            double sum = 0.0;
            for (k = 0; k < CAR_NX; k++) {
                sum += by_x[i + CAR_NX * k] * S_x[k + CAR_NX * j];
            }
            S_x_dot[i + CAR_NX * j] = sum;
        }
    }
    for (j = 0; j < CAR_NU; j++) {
        for (i = 0; i < CAR_NX; i++) {
            double sum = by_u[i + CAR_NX * j];
            for (k = 0; k < CAR_NX; k++) {
                sum += by_x[i + CAR_NX * k] * S_u[k + CAR_NX * j];
            }
            S_u_dot[i + CAR_NX * j] = sum;
        }
    }
}

/* which delay each input has; -1: none */
static const int car_delay_of[CAR_NU] = {0, -1};

void car_commands_start(car_commands *line, const double *u)
{
    line->time[0] = -HUGE_VAL;
    memcpy(line->u[0], u, sizeof line->u[0]);
    line->count = 1;
}

int car_commands_push(car_commands *line, double time, const double *u)
{
    const size_t place = line->count % CAR_COMMANDS;
    if (!(time > line->time[(line->count - 1) % CAR_COMMANDS])) {
        return -1;
    }
    line->time[place] = time;
    memcpy(line->u[place], u, sizeof line->u[place]);
    line->count++;
    return 0;
}

/* what input i is at a time, and when it changes next; -1 where the line does not reach back */
static int car_command_at(const car_commands *line, size_t i, double time, double *u, double *until)
{
    const size_t held = line->count < CAR_COMMANDS ? line->count : CAR_COMMANDS;
    size_t back = 0;
    *until = HUGE_VAL;
    while (back + 1 < held && line->time[(line->count - 1 - back) % CAR_COMMANDS] > time) {
        *until = line->time[(line->count - 1 - back) % CAR_COMMANDS];
        back++;
    }
    *u = line->u[(line->count - 1 - back) % CAR_COMMANDS][i];
    return line->time[(line->count - 1 - back) % CAR_COMMANDS] > time ? -1 : 0;
}

int car_commands_until(const car_commands *line, const double *p, double time, double *u, double *on)
{
    double late[1];
    size_t i;
    int found = 0;
    car_delays(p, late);
    *on = HUGE_VAL;
    for (i = 0; i < CAR_NU; i++) {
        const double delay = car_delay_of[i] < 0 ? 0.0 : late[car_delay_of[i]];
        double until;
        if (car_command_at(line, i, time - delay, &u[i], &until) != 0) {
            found = -1;
        }
        if (until - (time - delay) < *on) {
            *on = until - (time - delay);
        }
    }
    return found;
}

int car_commands_acting(const car_commands *line, const double *p, double time, double *u)
{
    double on;
    return car_commands_until(line, p, time, u, &on);
}

int car_step_late(const car_commands *line, const double *x, const double *p, double time, double dt,
    double *x_next)
{
    const double end = time + dt, soon = 1e-9 * dt; /* commands a billionth of a step apart act as one */
    double now[CAR_NX], u[CAR_NU], on;
    int found = 0;
    memcpy(now, x, sizeof now);
    while (end - time > soon) {
        double h = end - time;
        if (car_commands_until(line, p, time + soon, u, &on) != 0) {
            found = -1;
        }
        if (on + soon < h) {
            h = on + soon;
        }
        car_step(now, u, p, h, now);
        time += h;
    }
    memcpy(x_next, now, sizeof now);
    return found;
}
