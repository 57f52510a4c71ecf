/* The scheme of Cohen and Dujardin (2014), equation (2.1), as a program for `sepv verify --exec`, in C99:
 *
 *     cc -O2 -o energy_preserving examples/energy_preserving.c -lm
 *     sepv verify --exec ./energy_preserving
 *
 * y1 = y0 + D B((y0 + y1)/2) times the average of grad H on the segment from y0 to y1. It keeps H and quadratic Casimirs.
 */
#include "client.h"

const char hello[] =
    "\"scheme\":\"energy-preserving-c\",\"source\":\"Cohen and Dujardin (2014), equation (2.1)\","
    "\"claims\":[\"contract\",\"identity\",\"energy\",\"casimir\",\"symmetry\"],\"mean_square_order\":1,"
    "\"problems\":[\"harmonic-oscillator\",\"rigid-body\",\"pendulum\"],\"polynomial\":true,\"max_steps\":256";

void increment(const Problem *problem, int d, const double *y, const double *z, double delta, double *R) {
    double middle[MAXD] = {0}, average[MAXD] = {0};
    for (int i = 0; i < d; i++) middle[i] = y[i] + 0.5 * z[i];
    mean_gradient(problem, y, z, average);
    structure(problem, middle, average, R);
    for (int i = 0; i < d; i++) R[i] *= delta;
}
