"""Heun's method with the random step Δ, compiled by JAX, for any vector field."""

from functools import partial

import jax


@partial(jax.jit, static_argnums=0)
def heun(field, numbers, y, delta):
    """y + ½Δ(f(y) + f(y + Δf(y))) for y (d,) or (d, M); `field(numbers, y)` is f."""
    first = field(numbers, y)
    return y + 0.5 * delta * (first + field(numbers, y + delta * first))
