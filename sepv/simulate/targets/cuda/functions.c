/* Functions of `sepv.record._functions` that C lacks. Only Newton's matrix uses the three slopes, so that a relative
   error of 1e-9 costs nothing: their numerators cancel for small x, where a few terms of the series take over. */
#define SMALL 0x1p-8
DEVICE double sinc(double x) { return x == 0.0 ? 1.0 : sin(x) / x; }
DEVICE double log1p_ratio(double x) { return x == 0.0 ? 1.0 : log1p(x) / x; }
DEVICE double expm1_ratio(double x) { return x == 0.0 ? 1.0 : expm1(x) / x; }
DEVICE double sinc_slope(double x) {
  const double xx = x * x;
  return fabs(x) < SMALL ? x * (-1.0 / 3 + xx * (1.0 / 30 - xx * (1.0 / 840))) : (cos(x) - sinc(x)) / x;
}
DEVICE double log1p_ratio_slope(double x) {
  const double few = -0.5 + x * (2.0 / 3 + x * (-0.75 + x * 0.8));
  return fabs(x) < SMALL ? few : (1.0 / (1.0 + x) - log1p_ratio(x)) / x;
}
DEVICE double expm1_ratio_slope(double x) {
  const double few = 0.5 + x * (1.0 / 3 + x * (0.125 + x * (1.0 / 30)));
  return fabs(x) < SMALL ? few : (exp(x) - expm1_ratio(x)) / x;
}
