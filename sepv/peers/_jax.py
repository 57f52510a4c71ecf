"""Steps of libraries that use JAX, for mechanical problems H = ½pᵀM⁻¹p + V(q): compiled,
in float64, V written in JAX.

A polynomial problem is data to the compiled step, so that a new random problem compiles nothing. It
is padded with coordinates q = p = 0 of mass 1 that stay at rest, because V does not depend on them.
JAX's own context manager turns float64 on around each call, for one thread; importing this module
changes nothing in JAX.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache, partial
from importlib import import_module
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from sepv.peers._integrator import Advance, diagonal
from sepv.posing import Formulas, pose, size
from sepv.problem import Array, Mechanics, PolynomialSystem, damping_of
from sepv.problems import polynomial_problem

# JAX has had this context manager in two places.
enable_x64 = jax.enable_x64 if hasattr(jax, "enable_x64") else import_module("jax.experimental").enable_x64

# A function (V, M⁻¹, q, p, h, …) -> (q1, p1). M⁻¹ has the shape (n,) if it is diagonal, else
# (n, n).
Step = Callable[..., tuple[Any, Any]]


def advance_by(step: Step) -> Advance:
    """Convert a step written in JAX to the function `advance` that `_integrator.integrator`
    takes. Further arguments, numbers or arrays (n,), are the step's too.
    """

    def advance(system: Mechanics, q: Array, p: Array, *more: Any) -> tuple[Array, Array]:
        n, (formulas, numbers, inverse_mass) = len(q), _posed(system)
        given = [
            np.pad(x, (0, len(inverse_mass) - n)) if np.ndim(x) else np.float64(x) for x in (q, p, *more)
        ]
        with enable_x64(True):
            q1, p1 = _compiled(step, formulas, system.positions_first, numbers, inverse_mass, *given)
            return np.asarray(q1)[:n], np.asarray(p1)[:n]

    return advance


@partial(jax.jit, static_argnums=(0, 1, 2))
def _compiled(step: Step, formulas: Formulas, positions_first: bool, numbers: Any, *given: Any) -> Any:
    def potential(q: Any) -> Any:
        if formulas.kind == "polynomial":
            return formulas.values(jnp, numbers, q, 0, 1)[0]
        rest = jnp.zeros_like(q)
        return formulas.hamiltonian(
            jnp, numbers, jnp.concatenate([q, rest] if positions_first else [rest, q])
        )

    return step(potential, *given)


@lru_cache(maxsize=8)
def _posed(system: Mechanics) -> tuple[Formulas, Any, Array]:
    """The potential V(q) = H(q, 0) of a mechanical system as formulas and numbers,
    and the inverse mass matrix M⁻¹.
    """
    problem, data = system.problem, system.problem.data
    if isinstance(data, PolynomialSystem) and damping_of(problem):
        # V is that of the problem without friction and noise.
        problem = polynomial_problem(replace(data, noise=(), noise_vectors=(), damping=0.0))
    formulas, numbers = pose(problem)
    n, inverse_mass = system.degrees, system.inverse_mass
    if formulas.kind == "polynomial":
        exponents, coefficients = numbers
        of_q, of_p = system.split(exponents)
        more = size(n, 4) - n
        numbers = (np.pad(of_q, ((0, more), (0, 0))), (coefficients[-1] * ~of_p.any(axis=0))[None])
        inverse_mass = np.block([[inverse_mass, np.zeros((n, more))], [np.zeros((more, n)), np.eye(more)]])
    return formulas, numbers, np.diag(inverse_mass) if diagonal(system) else inverse_mass
