"""Parts that many problems share: structures, names and parameters,
and H as a sum of parts with known flows.

The structures are the canonical ones, equations (1.2) and (1.3), and B(y)v = y × v of so(3)*.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sepv._arguments import is_number
from sepv.errors import ProblemError
from sepv.problem import Array, Flow, Function, NamedProblem, PartFlow, Problem, Structure, coefficients
from sepv.record import poly

# Entries (i, j, k, sign) of B(y) = hat(y), the matrix with B(y)v = y × v: B_ij = sign · y_k.
HAT = ((0, 1, 2, -1.0), (0, 2, 1, 1.0), (1, 2, 0, -1.0))
# The identity matrix of size 3, as data.
UNIT3 = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def skew(y: Array, entries: Iterable[tuple[int, int, Any]]) -> Array:
    """The skew matrix B(y), (d, d, ...), from its entries (i, j, B_ij)
    above the diagonal at y (d, ...).
    """
    B = np.zeros((len(y), *y.shape), dtype=y.dtype)
    for i, j, value in entries:
        B[i, j], B[j, i] = value, -value
    return B


def structure(y: Array) -> Array:
    """The canonical structure B = ((0, −I), (I, 0)) for states y = (p, q),
    with a copy for each state: (d, d, ...).
    """
    n = len(y) // 2
    return skew(y, ((i, n + i, -1.0) for i in range(n)))


def canonical(dimension: int, sign: float = -1.0) -> Structure:
    """The canonical structure as polynomial data, for y = (p, q), or for y = (q, p)
    with `sign` = 1.
    """
    n = dimension // 2
    return tuple((k, n + k, poly.constant(dimension, sign)) for k in range(n))


def planes(dimension: int) -> Structure:
    """The constant B of (1.3) as polynomial data: a 2 × 2 block for each pair of components,
    0 for an unpaired one.
    """
    return tuple((2 * k, 2 * k + 1, poly.constant(dimension, -1.0)) for k in range(dimension // 2))


def hat(factor: poly.Polynomial | None = None, spins: int = 1) -> Structure:
    """The structure B(y)v = g(y) (y × v) in each of `spins` blocks of three components,
    as polynomials; g is `factor`.

    Without `factor`, g = 1. Here y and v are the three components of one block, whose |y|² is a
    Casimir.
    """
    d = 3 * spins
    entries = [(n + i, n + j, n + k, s) for n in range(0, d, 3) for i, j, k, s in HAT]
    g = poly.constant(d, 1.0) if factor is None else factor
    return tuple((i, j, poly.multiply(g, poly.scale(s, poly.variable(d, k)))) for i, j, k, s in entries)


def named(name: str, noise: ArrayLike, parameters: dict[str, Sequence[float]], **parts: Any) -> Problem:
    """A built-in problem whose data are its name and its parameters;
    `parts` are further arguments of `Problem`.
    """
    c = tuple(coefficients(noise).tolist())
    given = tuple((key, tuple(map(float, values))) for key, values in {**parameters, "noise": c}.items())
    return Problem(**parts, noise=c, name=name, data=NamedProblem(name, given), check=False)


def total(parts: Sequence[Function]) -> Function:
    """The Hamiltonian Σ H_k of parts H_k, summed from left to right."""

    def hamiltonian(y: Array) -> Array:
        value = parts[0](y)
        for part in parts[1:]:
            value = value + part(y)
        return value

    return hamiltonian


def whole_number(name: str, value: float, least: int, most: int) -> int:
    """The parameter `name` of a problem as an int; ProblemError unless it is a whole number from
    `least` to `most`.
    """
    if not (is_number(value) and value == int(value) and least <= value <= most):
        raise ProblemError(
            expected=f"{name}, a whole number from {least} to {most}",
            received=f"{value!r:.80}",
            remedy=f"give {name}=3; B is a dense matrix, so that larger systems are slow",
        )
    return int(value)


def flows(dimension: int, structure: Function, parts: Sequence[Function]) -> tuple[Flow, ...]:
    """The exact flows of B∇H_k, one for each part H_k of H."""
    return tuple(PartFlow(dimension, structure, part) for part in parts)
