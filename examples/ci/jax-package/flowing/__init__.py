"""Stochastic flows in JAX."""
