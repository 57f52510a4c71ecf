/* The increment z of an explicit scheme; the status says whether its end is finite and in the domain. */
DEVICE i64 solve(const double *y, const double *step, double *z, i64 *work) {
  double end[D], total = 0.0;
  right_side(y, step, z);
  work[1] += FIRST_GRADIENTS, work[2] += FIRST_STRUCTURES;
  UNROLLED for (int i = 0; i < D; i++) end[i] = y[i] + z[i], total += fabs(end[i]);
  return !(total < INF) ? OVERFLOW_ : inside(end) ? 0 : LEFT_DOMAIN;
}
