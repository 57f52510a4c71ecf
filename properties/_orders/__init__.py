"""Measurement of orders: on one step by quadrature, and over paths.

One step: `local_errors` (errors at falling h), `local_orders` (the verdict on their slope), with `gaussian` and
`local_moments` for the expectations. Paths: `convergence` (rms errors), `means` (weak errors and limits), `tilting`
(importance sampling for high orders), `weak_trees` (all paths of increments with a few values).
"""
