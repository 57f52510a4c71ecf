"""The step with the arguments that sepv gives, for `sepv verify flowing.laws:scheme`."""

from functools import lru_cache, partial

import jax
import jax.numpy as jnp
import numpy as np

import sepv
from flowing.heun import heun
from sepv.posing import in_blocks, pose

jax.config.update("jax_enable_x64", True)  # before any array is made; single precision is refused


@lru_cache(maxsize=64)
def _field(formulas):
    # One function for each kind of problem, so that JAX compiles a few times and not for each problem.
    return partial(formulas.field, jnp)


def step(problem, y, h, dW):
    """One step of a state (d,) or a batch (d, M), in blocks of 64, so that no bit depends on the size of the batch."""
    formulas, numbers = pose(problem, wide=True)

    def block(y, dW):
        return heun(_field(formulas), numbers, y, problem.random_step(h, dW))

    return np.asarray(in_blocks(block, y, dW, 64, formulas.width))


scheme = sepv.Scheme(
    "flowing heun",
    step,
    claims=["noise-sum", "random-step"],
    mean_square_order=1.0,
    weak_order=1.0,
    truncation=None,
    batched=True,
)
