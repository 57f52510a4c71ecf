/* Newton's correction c = A⁻¹F by elimination with partial pivoting, for more unknowns than are written out. */
DEVICE void eliminate(double *A, double *c) {
  for (int k = 0; k < D; k++) {
    int pivot = k;
    for (int i = k + 1; i < D; i++)
      if (fabs(A[i * D + k]) > fabs(A[pivot * D + k])) pivot = i;
    if (pivot != k) {
      for (int j = k; j < D; j++) {
        const double other = A[k * D + j];
        A[k * D + j] = A[pivot * D + j], A[pivot * D + j] = other;
      }
      const double other = c[k];
      c[k] = c[pivot], c[pivot] = other;
    }
    for (int i = k + 1; i < D; i++) {
      const double factor = A[i * D + k] / A[k * D + k];
      for (int j = k + 1; j < D; j++) A[i * D + j] -= factor * A[k * D + j];
      c[i] -= factor * c[k];
    }
  }
  for (int i = D - 1; i >= 0; i--) {
    for (int j = i + 1; j < D; j++) c[i] -= A[i * D + j] * c[j];
    c[i] /= A[i * D + i];
  }
}
