"""A problem given as data, posed in another library's arrays. Imports none of them: it takes the namespace.

A peer's code differentiates, compiles and batches the field f = B∇H in its own way, which NumPy functions
would not let it do. NumPy, JAX and PyTorch share the operations used here.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from sepv import polynomial as poly
from sepv.errors import UsageError
from sepv.polynomial import Polynomial
from sepv.problem import Array, NamedProblem, PolynomialSystem, Problem
from sepv.problems.polynomial_system import structure_entries

# Lanes computed together: every batch goes in blocks of this many, the last one filled up, so that the
# compiled code and the order of its operations do not depend on how many paths a caller asks for.
LANES = 64


@dataclass(frozen=True, eq=False)
class Posed:
    """The field of one problem: `kind` chooses the formula, `arrays` are its numbers.

    Attributes
    ----------
    kind : str
        A problem's name, or "polynomial".
    powers : int
        The largest exponent of a polynomial problem.
    arrays : tuple of ndarray
        For polynomials the exponents (d, T) and the coefficients (d² + d, T): B row by row, then ∇H.
    """

    kind: str
    powers: int
    arrays: tuple[Any, ...]


def pose(problem: Problem) -> Posed:
    """The problem as numbers for `field`.

    Raises
    ------
    UsageError
        For a problem that is not given as data.
    """
    if problem.data is None:
        raise UsageError(
            expected="a problem given as data: polynomial, or one of the paper's by name",
            received=f"{problem.name}, made of Python functions",
            remedy="write it with sepv.problems.polynomial_problem: other libraries cannot run NumPy functions",
        )
    return _pose(problem.data)


def field(xp: Any, kind: str, powers: int, arrays: Any, y: Any) -> Any:
    """f(y) = B(y)∇H(y) for y of shape (d, ...), with the functions of the namespace xp."""
    if kind == "polynomial":
        return _polynomial(xp, powers, arrays, y)
    return _FIELDS[kind](xp, arrays, y)


def in_blocks(step: Callable[[Array, Array], Any], y: Array, dW: Array, lanes: int) -> Array:
    """step(y (d, lanes), dW (m, lanes)) over any number of lanes, or on one state (d,) with dW (m,)."""
    states = y.reshape(y.shape[0], -1)
    count = states.shape[1]
    increments = dW.reshape(dW.shape[0], count)
    filled = -(-count // lanes) * lanes
    lane = np.minimum(np.arange(filled), count - 1)
    parts = []
    for first in range(0, filled, lanes):
        block = lane[first : first + lanes]
        parts.append(np.asarray(step(states[:, block], increments[:, block])))
    return np.concatenate(parts, axis=1)[:, :count].reshape(y.shape)


@lru_cache(maxsize=256)
def _pose(data: PolynomialSystem | NamedProblem) -> Posed:
    if isinstance(data, NamedProblem):
        given = dict(data.parameters)
        return Posed(data.name, 0, tuple(np.array(given[key]) for key in _PARAMETERS[data.name]))
    rows = [entry for row in structure_entries(data) for entry in row] + list(poly.gradient(data.hamiltonian))
    exponents, coefficients = _table(data.dimension, rows)
    return Posed("polynomial", int(exponents.max(initial=0)), (exponents, coefficients))


def _table(dimension: int, rows: list[Polynomial]) -> tuple[Any, Array]:
    """Exponents (d, T) of the monomials of all rows, and coefficients (R, T)."""
    monomials = sorted({e for p in rows for e, _ in p.terms}) or [(0,) * dimension]
    index = {e: t for t, e in enumerate(monomials)}
    coefficients = np.zeros((len(rows), len(monomials)))
    for r, p in enumerate(rows):
        for e, c in p.terms:
            coefficients[r, index[e]] = c
    return np.array(monomials, dtype=np.int64).reshape(-1, dimension).T.copy(), coefficients


def _polynomial(xp: Any, powers: int, arrays: Any, y: Any) -> Any:
    exponents, coefficients = arrays
    d = exponents.shape[0]
    # Products, not y**e: the derivative of 0**0 is not a number in either library.
    power = [xp.ones_like(y)]
    for _ in range(powers):
        power.append(power[-1] * y)
    table = xp.stack(power)
    monomials = table[exponents[0], 0]
    for i in range(1, d):
        monomials = monomials * table[exponents[i], i]
    values = xp.einsum("rt,t...->r...", coefficients, monomials)
    B = values[: d * d].reshape((d, d, *y.shape[1:]))
    return xp.einsum("ij...,j...->i...", B, values[d * d :])


def _oscillator(xp: Any, _arrays: Any, y: Any) -> Any:
    return xp.stack([-y[1], y[0]])


def _pendulum(xp: Any, _arrays: Any, y: Any) -> Any:
    return xp.stack([-xp.sin(y[1]), y[0]])


def _rigid_body(xp: Any, arrays: Any, y: Any) -> Any:
    (inertia,) = arrays
    g = [y[i] / inertia[i] for i in range(3)]
    return xp.stack([y[1] * g[2] - y[2] * g[1], y[2] * g[0] - y[0] * g[2], y[0] * g[1] - y[1] * g[0]])


def _lotka_volterra(xp: Any, arrays: Any, y: Any) -> Any:
    a, b, d, nu, mu = (value[0] for value in arrays)
    g0, g1, g2 = a * b, 1 + nu / y[1], -a - mu / y[2]
    B01, B02, B12 = d * y[0] * y[1], b * d * y[0] * y[2], -y[1] * y[2]
    return xp.stack([B01 * g1 + B02 * g2, B12 * g2 - B01 * g0, -B02 * g0 - B12 * g1])


_FIELDS = {
    "harmonic-oscillator": _oscillator,
    "pendulum": _pendulum,
    "rigid-body": _rigid_body,
    "lotka-volterra": _lotka_volterra,
}
_PARAMETERS: dict[str, tuple[str, ...]] = {
    "harmonic-oscillator": (),
    "pendulum": (),
    "rigid-body": ("inertia",),
    "lotka-volterra": ("a", "b", "d", "nu", "mu"),
}
