"""A problem for a library with arrays of its own, such as JAX or torch: B, H, ∇H and f = B∇H as formulas and numbers.

A problem's own functions are NumPy's, which a compiler cannot trace (`TracerArrayConversionError`) and an automatic
derivative does not see through. A problem given as data is posed again: `pose` returns formulas, which are hashable and
few, and numbers, which are arrays. A compiled step takes the formulas as a static argument and the numbers as data, so
that one program serves every problem of a size. No library is imported here: a formula takes the namespace.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache, reduce
from operator import add
from typing import Any

import numpy as np

from sepv.errors import Skipped
from sepv.peers._multistep import PathSolver
from sepv.peers._padded_batches import in_blocks
from sepv.problem import Array, NamedProblem, PolynomialSystem, Problem
from sepv.problem._hamiltonians import is_several
from sepv.problems._polynomial_system import structure_entries
from sepv.record import Polynomial
from sepv.record import _polynomial as poly
from sepv.schemes import load_problem

__all__ = ["Formulas", "PathSolver", "field_in", "in_blocks", "pose"]

# Tables of polynomials are filled up with zeros to one of a few sizes, so that few programs serve all problems.
LEAST_POWER, LEAST_TERMS = 8, 32


@dataclass(frozen=True)
class Formulas:
    """The functions of a problem in any namespace: `xp` is jax.numpy, torch or numpy, `y` has shape (d,) or (d, M).

    `numbers` are those of `pose`, or the same as arrays of the namespace: torch wants tensors, JAX takes both.

    Attributes
    ----------
    kind : str
        A problem's name, or "polynomial".
    powers : int
        At least the largest exponent of a polynomial problem.
    """

    kind: str
    powers: int = 0

    def structure(self, xp: Any, numbers: Any, y: Any) -> Any:
        """B(y), of shape (d, d, ...)."""
        if self.kind == "polynomial":
            d = y.shape[0]
            return self.values(xp, numbers, y, 0, d * d).reshape((d, d, *y.shape[1:]))
        B, d = _NAMED[self.kind].structure(numbers, y), y.shape[0]
        zero = xp.zeros_like(y[0])
        table = [[_entry(B, i, j, zero) + zero for j in range(d)] for i in range(d)]
        return xp.stack([xp.stack(row) for row in table])

    def gradient(self, xp: Any, numbers: Any, y: Any) -> Any:
        """∇H(y), of shape (d, ...)."""
        if self.kind == "polynomial":
            d = y.shape[0]
            return self.values(xp, numbers, y, d * d, d * d + d)
        return xp.stack(_NAMED[self.kind].gradient(xp, numbers, y))

    def hamiltonian(self, xp: Any, numbers: Any, y: Any) -> Any:
        """H(y), of shape (...)."""
        if self.kind == "polynomial":
            d = y.shape[0]
            return self.values(xp, numbers, y, d * d + d, d * d + d + 1)[0]
        return _NAMED[self.kind].hamiltonian(xp, numbers, y)

    def field(self, xp: Any, numbers: Any, y: Any) -> Any:
        """f(y) = B(y)∇H(y), of shape (d, ...); entries of B that vanish everywhere cost nothing."""
        d = y.shape[0]
        if self.kind == "polynomial":
            both = self.values(xp, numbers, y, 0, d * d + d)
            B = both[: d * d].reshape((d, d, *y.shape[1:]))
            return xp.einsum("ij...,j...->i...", B, both[d * d :])
        B, g = _NAMED[self.kind].structure(numbers, y), _NAMED[self.kind].gradient(xp, numbers, y)
        pairs = [[(_entry(B, i, j, None), g[j]) for j in range(d)] for i in range(d)]
        return xp.stack([reduce(add, [b * slope for b, slope in row if b is not None]) for row in pairs])

    def values(self, xp: Any, numbers: Any, y: Any, first: int, last: int) -> Any:
        """Rows of the table of polynomials at y."""
        exponents, coefficients = numbers
        # Products, not y**e: the derivative of 0**0 is not a number in either library.
        power = [xp.ones_like(y)]
        for _ in range(self.powers):
            power.append(power[-1] * y)
        table = xp.stack(power)
        monomials = table[exponents[0], 0]
        for i in range(1, y.shape[0]):
            monomials = monomials * table[exponents[i], i]
        return xp.einsum("rt,t...->r...", coefficients[first:last], monomials)


def pose(problem: str | Problem, *, padded: bool = True) -> tuple[Formulas, tuple[Array, ...]]:
    """The formulas of a problem and its numbers, as NumPy arrays.

    Parameters
    ----------
    problem : str or Problem
        A name, a file, ``module:attribute``, or the record that a step is given.
    padded : bool
        Fill up the tables of a polynomial problem with zeros to one of a few sizes, so that a compiled step is
        compiled a few times and not once for each random problem.

    Raises
    ------
    Skipped
        For a problem that is not given as data, or has a structure for each noise: no other library can run its NumPy
        functions. A step that lets this pass is asked about problems given as data instead.

    Examples
    --------
    >>> import numpy as np
    >>> formulas, numbers = pose("rigid-body")
    >>> float(formulas.hamiltonian(np, numbers, numbers[0]))  # H at y = (I1, I2, I3)
    0.999
    """
    found = load_problem(problem)
    known = isinstance(found.data, PolynomialSystem) or getattr(found.data, "name", "") in _NAMED
    if found.data is None or not known or is_several(found):
        raise Skipped(
            f"{found.name} is not (1.1) given as data, and no other library can run NumPy functions: write it with "
            "sepv.problems.polynomial_problem, or its functions in your library (docs/extending.md)"
        )
    return _pose(found.data, padded)


def field_in(xp: Any, problem: str | Problem) -> Callable[[Any], Any]:
    """y (d,) or (d, M) -> f(y) = B(y)∇H(y) of one problem, in the arrays of the namespace `xp`.

    Use float64: ``jax.config.update("jax_enable_x64", True)`` before any JAX array is made.

    Raises
    ------
    Skipped
        As `pose`.

    Examples
    --------
    >>> import numpy as np
    >>> f = field_in(np, "pendulum")
    >>> f(np.array([0.5, 0.0])).tolist()
    [-0.0, 0.5]
    """
    formulas, numbers = pose(problem, padded=False)
    make = getattr(xp, "as_tensor", None) or xp.asarray
    arrays = tuple(make(a) for a in numbers)
    return lambda y: formulas.field(xp, arrays, y)


@lru_cache(maxsize=256)
def _pose(data: PolynomialSystem | NamedProblem, padded: bool) -> tuple[Formulas, tuple[Array, ...]]:
    if isinstance(data, NamedProblem):
        given = dict(data.parameters)
        return Formulas(data.name), tuple(np.array(given[key]) for key in _NAMED[data.name].parameters)
    entries = [entry for row in structure_entries(data) for entry in row]
    rows = [*entries, *poly.gradient(data.hamiltonian), data.hamiltonian]
    monomials = sorted({e for p in rows for e, _ in p.terms}) or [(0,) * data.dimension]
    powers, count = max(max(e) for e in monomials), len(monomials)
    if padded:
        powers, count = size(powers, LEAST_POWER), size(count, LEAST_TERMS)
    return Formulas("polynomial", powers), table(data.dimension, rows, monomials, count)


def size(needed: int, least: int) -> int:
    """The smallest of least, 2 least, 4 least, … that is enough."""
    while least < needed:
        least *= 2
    return least


def table(
    dimension: int, rows: list[Polynomial], monomials: list[tuple[int, ...]], count: int
) -> tuple[Any, Array]:
    """Exponents (d, T) of the monomials, and the coefficients (R, T) of the rows; T = count, the rest zeros."""
    index = {e: t for t, e in enumerate(monomials)}
    exponents = np.zeros((dimension, count), dtype=np.int64)
    for e, t in index.items():
        exponents[:, t] = e
    coefficients = np.zeros((len(rows), count))
    for r, p in enumerate(rows):
        for e, c in p.terms:
            coefficients[r, index[e]] = c
    return exponents, coefficients


Entries = Mapping[tuple[int, int], Any]


@dataclass(frozen=True)
class _Named:
    """One of the paper's problems: its parameters' names, B above the diagonal (numbers, y), ∇H and H."""

    parameters: tuple[str, ...]
    structure: Callable[[Any, Any], Entries]
    gradient: Callable[[Any, Any, Any], list[Any]]
    hamiltonian: Callable[[Any, Any, Any], Any]


def _entry(B: Entries, i: int, j: int, nothing: Any) -> Any:
    if (j, i) in B:
        return -B[j, i]
    return B.get((i, j), nothing)


def _lotka_volterra(numbers: Any) -> list[Any]:
    return [value[0] for value in numbers]


def _lotka_volterra_structure(numbers: Any, y: Any) -> Entries:
    _a, b, d, _nu, _mu = _lotka_volterra(numbers)
    return {(0, 1): d * y[0] * y[1], (0, 2): b * d * y[0] * y[2], (1, 2): -y[1] * y[2]}


def _lotka_volterra_gradient(xp: Any, numbers: Any, y: Any) -> list[Any]:
    a, b, _d, nu, mu = _lotka_volterra(numbers)
    return [a * b * xp.ones_like(y[0]), 1 + nu / y[1], -a - mu / y[2]]


def _lotka_volterra_energy(xp: Any, numbers: Any, y: Any) -> Any:
    a, b, _d, nu, mu = _lotka_volterra(numbers)
    return a * b * y[0] + y[1] - a * y[2] + nu * xp.log(y[1]) - mu * xp.log(y[2])


_NAMED = {
    "harmonic-oscillator": _Named(
        (),
        lambda _numbers, _y: {(0, 1): -1.0},
        lambda _xp, _numbers, y: [y[0], y[1]],
        lambda _xp, _numbers, y: 0.5 * (y[0] * y[0] + y[1] * y[1]),
    ),
    "pendulum": _Named(
        (),
        lambda _numbers, _y: {(0, 1): -1.0},
        lambda xp, _numbers, y: [y[0], xp.sin(y[1])],
        lambda xp, _numbers, y: 0.5 * y[0] * y[0] - xp.cos(y[1]),
    ),
    "rigid-body": _Named(
        ("inertia",),
        lambda _numbers, y: {(0, 1): -y[2], (0, 2): y[1], (1, 2): -y[0]},
        lambda _xp, numbers, y: [y[i] / numbers[0][i] for i in range(3)],
        lambda _xp, numbers, y: 0.5 * reduce(add, [y[i] * y[i] / numbers[0][i] for i in range(3)]),
    ),
    "lotka-volterra": _Named(
        ("a", "b", "d", "nu", "mu"),
        _lotka_volterra_structure,
        _lotka_volterra_gradient,
        _lotka_volterra_energy,
    ),
}
