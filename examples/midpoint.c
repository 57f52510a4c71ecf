/* The stochastic midpoint rule as a program for `sepv verify --exec`, in C99 without a library.
 *
 *     cc -O2 -o midpoint examples/midpoint.c -lm
 *     sepv verify --exec ./midpoint
 *
 * y1 = y0 + D f((y0 + y1)/2), f = B grad H, with the random step D = h + sum_j c_j dW_j: equation (3.4) of
 * D. Cohen and G. Dujardin, Energy-preserving integrators for stochastic Poisson systems (2014). The rule keeps
 * quadratic Casimirs, is symmetric, and keeps a quadratic H. `client.h` is the conversation.
 */
#include "client.h"

const char hello[] =
    "\"scheme\":\"midpoint-c\",\"source\":\"Milstein, Repin and Tretyakov (2002), equation (3.4)\","
    "\"claims\":[\"contract\",\"identity\",\"casimir\",\"midpoint\",\"symmetry\"],\"mean_square_order\":1,"
    "\"problems\":[\"harmonic-oscillator\",\"rigid-body\",\"pendulum\"],\"polynomial\":true,\"max_steps\":256";

void increment(const Problem *problem, int d, const double *y, const double *z, double delta, double *R) {
    double middle[MAXD] = {0};
    for (int i = 0; i < d; i++) middle[i] = y[i] + 0.5 * z[i];
    field(problem, middle, R);
    for (int i = 0; i < d; i++) R[i] *= delta;
}
