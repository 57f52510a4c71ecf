/* A state that has grown by 1/EPS, in units of the high word. */
#define OUTGROWN (52 << 20)
/* Newton's iteration for z = R(z), with the stop rule of the core (`_stop_rule`), whose names it uses. `beginning` gives
   the first z, and `iteration` F = z − R(z), the correction c, and whether z − c stays in the domain. Return 0 if z is
   the step, and FROZEN if the core must solve it: after MAXITER iterations, outside the domain, without a finite
   correction, or where a residual needs the core's closer bound.

   Most of an iteration is not its tests: until corrections are small, only their size is kept. One exit is earlier than
   the core's, as in `sepv.simulate._compiled.newton`: Newton's corrections shrink quadratically, so that after two of
   the relative sizes s' and s the next is s³/s'², or s times the relative error of the matrix if this is larger. EARLY is
   the largest s for which the second is below STOP_ERROR; it is 0 for an iteration that is not Newton's. */
DEVICE i64 converged(const double *y, const double *step, double *z, int *iterations) {
  double F[D], c[D], q[DIRECTIONS + 1], last_size = INF, last_move = INF, last_scale = 1.0;
  int before = 0;
  beginning(y, step, z, q);
  UNROLLED for (int i = 0; i < D; i++) before = larger(before, magnitude(y[i]));
  for (*iterations = 1; *iterations <= MAXITER; ++*iterations) {
    const int stays = iteration(y, z, step, q, F, c);
    int moved = 0, reach = 0;
    UNROLLED for (int i = 0; i < D; i++) {
      moved = larger(moved, magnitude(c[i]));
      reach = larger(reach, magnitude(fabs(y[i]) + fabs(z[i])));
    }
    if (moved >= NOT_FINITE || !stays || (before && reach - before > OUTGROWN)) return -1;
    const double move = of_magnitude(moved), scale = of_magnitude(reach);
    double size = INF;
    if (move <= fmax(STAGNATION, EARLY) * scale) {
      double residual = 0.0;
      size = 0.0;
      if (last_size == INF && last_move < INF) last_size = last_move * roughly(last_scale + TINY);
      UNROLLED for (int i = 0; i < D; i++) {
        residual = fmax(residual, fabs(F[i]));
        size = fmax(size, fabs(c[i]) * roughly(fabs(y[i]) + fabs(z[i]) + EPS * scale + TINY));
      }
      if (residual <= ZERO_RESIDUAL) return ends(y, z);
      const double far = fmax(last_size, FIRST);
      const int early = size <= EARLY && (last_size < INF || size <= FIRST) && size * size * size <= STOP_ERROR * (far * far);
      const int shrinks = last_size < INF && size * size <= STOP_ERROR * last_size;
      const int last = size <= 0.5 * EPS || (shrinks && residual <= EPS * scale);
      const int stuck = size >= 0.5 * last_size && move >= 0.5 * last_move;
      const int near = move <= STAGNATION * scale && residual <= ROUNDING * scale + ZERO_RESIDUAL;
      if (early || (near && (last || stuck))) {
        UNROLLED for (int i = 0; i < D; i++) z[i] -= c[i];
        return ends(y, z);
      }
    }
    UNROLLED for (int i = 0; i < D; i++) z[i] -= c[i];
    last_size = size, last_move = move, last_scale = scale;
  }
  *iterations = MAXITER;
  return -1;
}
DEVICE i64 solve(const double *y, const double *step, double *z, i64 *work) {
  int n;
  const i64 code = converged(y, step, z, &n);
  work[0] += n, work[1] += FIRST_GRADIENTS + n * GRADIENTS, work[2] += FIRST_STRUCTURES + n * STRUCTURES;
  return code;
}
