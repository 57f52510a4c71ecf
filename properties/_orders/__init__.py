"""Measurement of orders of convergence, for one step by quadrature and over sampled paths.

For one step, `local_errors` has errors at falling h and `local_orders` the verdict on their slope;
`gaussian` and `local_moments` compute expectations. For paths, `convergence` has rms errors,
`means` weak errors and limits, `tilting` importance sampling for high orders, and `weak_trees` sums
over all paths if increments have a few values.
"""
