/* The stages z of an s-stage method by sweeps z_i <- Δ B(Y_i) g_i, as in `sepv.simulate._compiled.stages`, and the
   increment Σ b_i z_i. Return 0, or FROZEN if the core must solve the step: sweeps that do not shrink fast enough, a
   quadrature that the finest rule does not settle, a point outside the domain. */
DEVICE void at(const double *y, const double *z, const double *weights, double *u) {
  UNROLLED for (int r = 0; r < D; r++) {
    u[r] = y[r];
    UNROLLED for (int j = 0; j < STAGES; j++) u[r] += weights[j] * z[j * D + r];
  }
}
/* R(z), with the averages g (s, d) of ∇H, or with ∇H at the stages if g is 0. */
DEVICE void sweep(const double *y, const double *z, double delta, const double *g, double *R) {
  for (int i = 0; i < STAGES; i++) {
    double Y[D], own[D], f[D];
    at(y, z, TABLEAU + i * STAGES, Y);
    gradient(Y, own);
    if (g) for (int r = 0; r < D; r++) own[r] = g[i * D + r];
    apply(Y, own, f);
    for (int r = 0; r < D; r++) R[i * D + r] = delta * f[r];
  }
}
/* The averages g_i = Σ_n W_in ∇H(u_n) by rule number `rule`; return 0 if a node lies outside the domain. */
DEVICE int averages(const double *y, const double *z, int rule, double *g) {
  int within = 1;
  for (int i = 0; i < STAGES * D; i++) g[i] = 0.0;
  for (int n = FIRSTS[rule]; n < FIRSTS[rule + 1]; n++) {
    double u[D], slope[D];
    at(y, z, NODES + n * 2 * STAGES + STAGES, u);
    within &= inside(u);
    gradient(u, slope);
    for (int i = 0; i < STAGES; i++)
      for (int r = 0; r < D; r++) g[i * D + r] += NODES[n * 2 * STAGES + i] * slope[r];
  }
  return within;
}
DEVICE double change_of(const double *R, double *z) {
  double m = 0.0;
  for (int i = 0; i < STAGES * D; i++) m += fabs(R[i] - z[i]), z[i] = R[i];
  return m;
}
DEVICE int stages_inside(const double *y, const double *z) {
  double u[D];
  int within = 1;
  for (int i = 0; i < STAGES; i++) at(y, z, TABLEAU + i * STAGES, u), within &= inside(u);
  at(y, z, WEIGHTS, u);
  return within & inside(u);
}
DEVICE i64 solve(const double *y, const double *step, double *change, i64 *work) {
  double z[STAGES * D], R[STAGES * D], g[STAGES * D], before = INF, scale = 0.0;
  for (int i = 0; i < STAGES * D; i++) z[i] = 0.0;
  for (int i = 0; i < D; i++) scale += fabs(y[i]);
  for (int k = 0; k <= BLIND; k++) {
    sweep(y, z, step[0], 0, R);
    change_of(R, z);
  }
  work[0] += 1 + BLIND, work[1] += (1 + BLIND) * STAGES, work[2] += (1 + BLIND) * STAGES;
  for (int rule = 0; rule < RULES; rule++) {
    int done = 0;
    for (int k = 0; k < TESTED && !done; k++) {
      if (!STRAIGHT) averages(y, z, 2 * rule, g);
      sweep(y, z, step[0], STRAIGHT ? 0 : g, R);
      work[0]++, work[1] += STRAIGHT ? STAGES : FIRSTS[2 * rule + 1] - FIRSTS[2 * rule], work[2] += STAGES;
      const double m = change_of(R, z);
      const int stays = !(m <= SHRINKS * before);
      done = (before < INF && m * m <= STOP_ERROR * (scale * before)) || m <= STAGES * D * NEGLIGIBLE_CORRECTION * scale ||
             (stays && m <= ROUNDING * scale);
      if (stays && !done) return -1;
      before = m;
    }
    if (!done) return -1;
    int fine = EXACT, within = stages_inside(y, z);
    if (!STRAIGHT && (HAS_DOMAIN || !EXACT)) {
      /* A last sweep with more nodes must change z by roundings only. */
      within &= averages(y, z, EXACT ? 2 * rule : 2 * rule + 1, g);
      if (!EXACT) {
        double size = 0.0;
        for (int i = 0; i < STAGES * D; i++) size += fabs(z[i]);
        sweep(y, z, step[0], g, R);
        const double m = change_of(R, z);
        fine = m <= 0x1p-48 * size || m <= STAGES * D * NEGLIGIBLE_CORRECTION * scale;
      }
    }
    if (!within) return -1;
    before = INF;
    if (!fine) continue;
    for (int r = 0; r < D; r++) {
      change[r] = 0.0;
      for (int j = 0; j < STAGES; j++) change[r] += WEIGHTS[j] * z[j * D + r];
    }
    return 0;
  }
  return -1;
}
