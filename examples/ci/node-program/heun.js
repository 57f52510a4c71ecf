// The scheme that the project is about: Heun's method with the random step Δ.

/** y + ½Δ(f(y) + f(y + Δf(y))) for an array y and the vector field f. */
export function heun(field, y, delta) {
  const first = field(y);
  const second = field(y.map((value, i) => value + delta * first[i]));
  return y.map((value, i) => value + 0.5 * delta * (first[i] + second[i]));
}
