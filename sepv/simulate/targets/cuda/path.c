/* Steps of paths, one path a thread. The functions of the problem and the scheme (`solve`, `moved`, `invariants`,
   `step_numbers`) are printed before this text. All arrays have the path as last axis. */

/* A path that `solve` has left to the core waits with this status, its state before the step, and the step's number. */
#define FROZEN (-1)

/* The increment that the scheme gets: clipped, or one of few values. */
DEVICE double seen(double u, double bound, i64 points, const double *thresholds, const double *values) {
  if (!points) return u < -bound ? -bound : u > bound ? bound : u;
  i64 reached = 0;
  while (reached < points && u >= thresholds[reached]) reached++;
  return values[reached];
}

/* Take the steps from `begin` to `count` of a block, whose step 0 has the number n0. `change` (K, …) is the increment
   of the first step if the core has solved it, else 0; only a whole block adds up W. */
DEVICE void path(i64 p, i64 M, i64 begin, i64 count, i64 n0, double h, double bound, const double *dW, i64 points,
                 const double *thresholds, const double *values, const double *y0, double *Y, double *W, double *lost,
                 double *worst, i64 *status, i64 *failed, i64 *work, const double *change, i64 stride) {
  double y[D], z[D], step[NUMBERS], u[NOISES + 1], start[INVARIANTS], at[INVARIANTS], e[D];
  double w[NOISES + 1], energy = worst[p], casimir = worst[M + p];
  i64 code = status[p], n = begin, counts[3] = {0, 0, 0};
  UNROLLED for (int j = 0; j < NOISES; j++) w[j] = W[j * M + p];
  UNROLLED for (int i = 0; i < D; i++) y[i] = y0[i];
  invariants(y, start);
  UNROLLED for (int i = 0; i < D; i++) y[i] = Y[i * M + p], e[i] = COMPENSATED ? lost[i * M + p] : 0.0;
  for (; n < count && code == 0; n++) {
    UNROLLED for (int j = 0; j < NOISES; j++) {
      u[j] = dW[(n * NOISES + j) * M + p];
      w[j] += u[j];
      u[j] = seen(u[j], bound, points, thresholds, values);
    }
    step_numbers(h, u, step);
    if (change && n == begin) {
      UNROLLED for (int i = 0; i < D; i++) z[i] = change[i * stride];
    } else {
      code = solve(y, step, z, counts);
      if (code) {
        failed[p] = n0 + n;
        continue;
      }
    }
    UNROLLED for (int i = 0; i < D; i++) {
      if (COMPENSATED) {
        /* Kahan's summation with Knuth's two-sum, as in `sepv.simulate._batch`. */
        const double wanted = z[i] + e[i], value = y[i] + wanted, taken = value - y[i];
        e[i] = (y[i] - (value - taken)) + (wanted - taken);
        y[i] = value;
      } else y[i] += z[i];
    }
    invariants(y, at);
    energy = fmax(energy, fabs(at[0] - start[0]));
    UNROLLED for (int i = 1; i < INVARIANTS; i++) casimir = fmax(casimir, fabs(at[i] - start[i]));
  }
  UNROLLED for (int i = 0; i < D; i++) {
    Y[i * M + p] = y[i];
    if (COMPENSATED) lost[i * M + p] = e[i];
  }
  worst[p] = energy, worst[M + p] = casimir, status[p] = code;
  UNROLLED for (int i = 0; i < 3; i++) work[i * M + p] += counts[i];
  if (change) return; /* W had the whole block before */
  for (; n < count; n++)
    UNROLLED for (int j = 0; j < NOISES; j++) w[j] += dW[(n * NOISES + j) * M + p];
  UNROLLED for (int j = 0; j < NOISES; j++) W[j * M + p] = w[j];
}

#define SHARED_ARGUMENTS \
  i64 count, i64 n0, double h, double bound, const double *dW, i64 points, const double *thresholds, \
      const double *values, const double *y0, double *Y, double *W, double *lost, double *worst, i64 *status, \
      i64 *failed, i64 *work
#define SHARED count, n0, h, bound, dW, points, thresholds, values, y0, Y, W, lost, worst, status, failed, work

/* A block of steps of all M paths. */
KERNEL void advance(i64 M, SHARED_ARGUMENTS) {
  EACH(p, M) path(p, M, 0, SHARED, 0, 0);
}

/* The rest of a block for the K paths with the numbers `lanes`, from the steps that they failed at, whose increments
   `changes` (d, K) the core has found. */
KERNEL void resume(i64 K, i64 M, const i64 *lanes, const i64 *begins, const double *changes, SHARED_ARGUMENTS) {
  EACH(k, K) path(lanes[k], M, begins[k], SHARED, changes + k, K);
}
