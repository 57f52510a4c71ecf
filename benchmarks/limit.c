/* The limit: scheme (2.1) for the rigid body, and for Lotka-Volterra, by Newton's iteration with the closed inverse of a
   3 x 3 matrix, and nothing else: no status, no invariants, increments as they are given, a fixed number of iterations.
   SIMD vectors have eight doubles; two vectors at a time hide the latency of the division. */

typedef double lane __attribute__((vector_size(64), aligned(8)));
typedef long ints __attribute__((vector_size(64), aligned(8)));

/* g = (1/I3 - 1/I2, 1/I1 - 1/I3, 1/I2 - 1/I1): the field is y1' = g1 y2 y3 and so on, cyclically. */
#define STEP(NAME, REAL)                                                                                       \
    static inline __attribute__((always_inline)) void NAME(REAL *y, REAL d, const double *g, int iterations) { \
        REAL z0 = y[0] * 0, z1 = z0, z2 = z0;                                                                  \
        for (int n = 0; n < iterations; n++) {                                                                 \
            REAL m0 = y[0] + 0.5 * z0, m1 = y[1] + 0.5 * z1, m2 = y[2] + 0.5 * z2;                             \
            REAL a0 = d * m0, a1 = d * m1, a2 = d * m2;                                                        \
            REAL f0 = z0 - g[0] * a1 * m2, f1 = z1 - g[1] * a2 * m0, f2 = z2 - g[2] * a0 * m1;                 \
            REAL k01 = 0.5 * g[0] * a2, k02 = 0.5 * g[0] * a1, k10 = 0.5 * g[1] * a2;                          \
            REAL k12 = 0.5 * g[1] * a0, k20 = 0.5 * g[2] * a1, k21 = 0.5 * g[2] * a0;                          \
            REAL c00 = 1 - k12 * k21, c01 = k10 + k12 * k20, c02 = k20 + k10 * k21;                            \
            REAL c10 = k01 + k02 * k21, c11 = 1 - k02 * k20, c12 = k21 + k01 * k20;                            \
            REAL c20 = k02 + k01 * k12, c21 = k12 + k02 * k10, c22 = 1 - k01 * k10;                            \
            REAL r = 1 / (c00 - k01 * c01 - k02 * c02);                                                        \
            z0 -= (c00 * f0 + c10 * f1 + c20 * f2) * r;                                                        \
            z1 -= (c01 * f0 + c11 * f1 + c21 * f2) * r;                                                        \
            z2 -= (c02 * f0 + c12 * f1 + c22 * f2) * r;                                                        \
        }                                                                                                      \
        y[0] += z0, y[1] += z1, y[2] += z2;                                                                    \
    }

STEP(step_lanes, lane)
STEP(step_one, double)

/* y (3, M) and dW in blocks of 16 paths (M/16, N, 16): the layout that is best for this kernel. */
void simd(double *y, long M, const double *dW, long N, double h, const double *g, int iterations) {
    for (long k = 0; k < M; k += 16) {
        lane a[3], b[3];
        for (int i = 0; i < 3; i++) a[i] = *(lane *)(y + i * M + k), b[i] = *(lane *)(y + i * M + k + 8);
        const double *w = dW + k * N;
        for (long n = 0; n < N; n++, w += 16) {
            step_lanes(a, h + *(lane *)w, g, iterations);
            step_lanes(b, h + *(lane *)(w + 8), g, iterations);
        }
        for (int i = 0; i < 3; i++) *(lane *)(y + i * M + k) = a[i], *(lane *)(y + i * M + k + 8) = b[i];
    }
}

/* One path: y (3,), dW (N,). */
void scalar(double *y, const double *dW, long N, double h, const double *g, int iterations) {
    double a[3] = {y[0], y[1], y[2]};
    for (long n = 0; n < N; n++) step_one(a, h + dW[n], g, iterations);
    y[0] = a[0], y[1] = a[1], y[2] = a[2];
}

static inline __attribute__((always_inline)) lane where(ints condition, lane a, lane b) {
    return (lane)((condition & (ints)a) | (~condition & (ints)b));
}

/* log(1 + x)/x of eight numbers, to about an ulp: 1 + x = 2^k (1 + f) with f in (-0.3, 0.42), and the polynomial of
   fdlibm's e_log.c for log(1 + f). The rounding of 1 + x is added to the result. */
static inline __attribute__((always_inline)) lane log1p_ratio(lane x) {
    const long half_root = 0x3fe6a09e667f3bcdL, one = 0x3ff0000000000000L, fraction = 0x000fffffffffffffL;
    lane u = 1 + x;
    ints bits = (ints)u + (one - half_root);
    lane k = __builtin_convertvector((bits >> 52) - 1023, lane);
    lane f = (lane)((bits & fraction) + half_root) - 1, lost = (x - (u - 1)) / u;
    lane s = f / (2 + f), z = s * s, w = z * z, half = 0.5 * f * f;
    lane even = w * (3.999999999940941908e-01 + w * (2.222219843214978396e-01 + w * 1.531383769920937332e-01));
    lane odd = z * (6.666666666666735130e-01 + w * (2.857142874366239149e-01 +
                    w * (1.818357216161805012e-01 + w * 1.479819860511658591e-01)));
    lane log = k * 6.93147180559945286227e-01 + (f - (half - s * (half + even + odd)) + lost);
    return where(x == 0, 1 + 0 * x, log / x);
}

/* (2.1) for the system of section 4.4 with its own numbers: B12 = -y1 y2/2, B13 = y1 y3/2, B23 = -y2 y3 and
   H = 2 y1 + y2 + 2 y3 + log y2 - 2 log y3, by Newton's iteration with the closed inverse. The mean of 1/y along the
   step is log(1 + x)/(x y) with x = z/y. Its derivative by z is (1/(y + z) - mean)/z; what cancels there for small z
   costs digits of Newton's matrix alone. */
static inline __attribute__((always_inline)) void volterra(lane *y, lane d, int iterations) {
    lane z0 = y[0] * 0, z1 = z0, z2 = z0, r1 = 1 / y[1], r2 = 1 / y[2];
    for (int n = 0; n < iterations; n++) {
        lane m0 = y[0] + 0.5 * z0, m1 = y[1] + 0.5 * z1, m2 = y[2] + 0.5 * z2;
        lane l1 = r1, l2 = r2, s1 = -0.5 * r1 * r1, s2 = -0.5 * r2 * r2;
        if (n) {
            l1 = r1 * log1p_ratio(z1 * r1), l2 = r2 * log1p_ratio(z2 * r2);
            s1 = where(z1 == 0, s1, (1 / (y[1] + z1) - l1) / z1);
            s2 = where(z2 == 0, s2, (1 / (y[2] + z2) - l2) / z2);
        }
        lane g1 = 1 + l1, g2 = 2 - 2 * l2, d1 = s1, d2 = -2 * s2;
        lane b01 = -0.5 * d * m0 * m1, b02 = 0.5 * d * m0 * m2, b12 = -d * m1 * m2;
        lane f0 = z0 - (b01 * g1 + b02 * g2), f1 = z1 - (b12 * g2 - 2 * b01), f2 = z2 + (2 * b02 + b12 * g1);
        lane e = 0.25 * d, k = 0.5 * d;
        lane a00 = 1 + e * (m1 * g1 - m2 * g2), a01 = e * m0 * g1 - b01 * d1, a02 = -e * m0 * g2 - b02 * d2;
        lane a10 = -k * m1, a11 = 1 + k * (m2 * g2 - m0), a12 = k * m1 * g2 - b12 * d2;
        lane a20 = k * m2, a21 = -k * m2 * g1 + b12 * d1, a22 = 1 + k * (m0 - m1 * g1);
        lane c00 = a11 * a22 - a12 * a21, c01 = a12 * a20 - a10 * a22, c02 = a10 * a21 - a11 * a20;
        lane r = 1 / (a00 * c00 + a01 * c01 + a02 * c02);
        z0 -= r * (c00 * f0 + (a02 * a21 - a01 * a22) * f1 + (a01 * a12 - a02 * a11) * f2);
        z1 -= r * (c01 * f0 + (a00 * a22 - a02 * a20) * f1 + (a02 * a10 - a00 * a12) * f2);
        z2 -= r * (c02 * f0 + (a01 * a20 - a00 * a21) * f1 + (a00 * a11 - a01 * a10) * f2);
    }
    y[0] += z0, y[1] += z1, y[2] += z2;
}

/* Like `simd`, with the step `volterra` in place of `step_lanes`. */
void simd_volterra(double *y, long M, const double *dW, long N, double h, int iterations) {
    for (long k = 0; k < M; k += 16) {
        lane a[3], b[3];
        for (int i = 0; i < 3; i++) a[i] = *(lane *)(y + i * M + k), b[i] = *(lane *)(y + i * M + k + 8);
        const double *w = dW + k * N;
        for (long n = 0; n < N; n++, w += 16) {
            volterra(a, h + 0.5 * *(lane *)w, iterations);
            volterra(b, h + 0.5 * *(lane *)(w + 8), iterations);
        }
        for (int i = 0; i < 3; i++) *(lane *)(y + i * M + k) = a[i], *(lane *)(y + i * M + k + 8) = b[i];
    }
}
