/* The limit: scheme (2.1) for the rigid body by Newton's iteration with the closed inverse of a 3 x 3 matrix, and nothing
   else: no status, no invariants, increments as they are given, a fixed number of iterations.
   SIMD by vectors of eight doubles; two of them at a time hide the latency of the division. */

typedef double lane __attribute__((vector_size(64), aligned(8)));

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
