"""B, H, ∇H and f = B∇H of a problem as formulas and numbers, for libraries with their own arrays,
such as JAX or torch.

A problem's own functions use NumPy. JAX cannot trace them (`TracerArrayConversionError`) or
differentiate them. From a problem given as data, `pose` makes formulas (hashable) and numbers
(arrays). A compiled step takes the formulas as a static argument and the numbers as data, so that
one program serves all polynomial problems of a size. This module imports no library: a formula gets
the library's functions as `xp`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from sepv.errors import Skipped
from sepv.problem import Array, NamedProblem, PolynomialSystem, Problem, one_field
from sepv.problems import EXTENSIONS, PAPER, build, structure_entries
from sepv.record import FUNCTIONS, Polynomial, Tape, gradient, poly, source
from sepv.schemes import load_problem

__all__ = ["Formulas", "field_in", "in_blocks", "pose"]

# The smallest sizes of tables of polynomials, filled up with zeros, so that few programs serve all
# problems.
TABLE_MIN_POWER, TABLE_MIN_TERMS, TABLE_MIN_VARIABLES = 8, 64, 6
# Each size of a table is this many times the one before.
TERMS_GROW = 4
# The number of states computed together in a block; the last block is filled up.
POSED_LANES = 64
# A function (problem, y0 (d,), h, dW (N, m, M)) -> states (N + 1, d, M).
Path = Callable[[Problem, Array, float, Array], Array]


@dataclass(frozen=True)
class Formulas:
    """The functions B, ∇H, H and f of a problem, for arrays y, (d,) or (d, M), of `xp`: jax.numpy,
    torch or numpy.

    Their argument `numbers` is the second result of `pose`, converted to tensors for torch; JAX
    takes NumPy arrays.

    Attributes
    ----------
    kind : str
        A problem's name, or "polynomial".
    powers : int
        For polynomials, the largest exponent, or more if the arrays are padded.
    texts : tuple of str
        For a problem by name, generated code of B, ∇H, H and f; empty for polynomials.
    width : int
        The number of variables of a wide table of polynomials, which y must have; 0 for the
        problem's own number.
    """

    kind: str
    powers: int = 0
    texts: tuple[str, ...] = ()
    width: int = 0

    def structure(self, xp: Any, numbers: Any, y: Any) -> Any:
        """B(y), of shape (d, d, ...)."""
        d = y.shape[0]
        entries = self._recorded(0, xp, numbers, y) if self.texts else self.values(xp, numbers, y, 0, d * d)
        return entries.reshape((d, d, *y.shape[1:]))

    def gradient(self, xp: Any, numbers: Any, y: Any) -> Any:
        """∇H(y), of shape (d, ...)."""
        if self.texts:
            return self._recorded(1, xp, numbers, y)
        d = y.shape[0]
        return self.values(xp, numbers, y, d * d, d * d + d)

    def hamiltonian(self, xp: Any, numbers: Any, y: Any) -> Any:
        """H(y), of shape (...)."""
        if self.texts:
            return self._recorded(2, xp, numbers, y)[0]
        d = y.shape[0]
        return self.values(xp, numbers, y, d * d + d, d * d + d + 1)[0]

    def field(self, xp: Any, numbers: Any, y: Any) -> Any:
        """The field f(y) = B(y)∇H(y), of shape (d, ...);
        generated code leaves out zero entries of B.
        """
        if self.texts:
            return self._recorded(3, xp, numbers, y)
        d = y.shape[0]
        both = self.values(xp, numbers, y, 0, d * d + d)
        B = both[: d * d].reshape((d, d, *y.shape[1:]))
        return xp.einsum("ij...,j...->i...", B, both[d * d :])

    def _recorded(self, which: int, xp: Any, numbers: Any, y: Any) -> Any:
        """The components of B, ∇H, H or f (`which` = 0 to 3) by generated code;
        constants are repeated for every y.
        """
        values, zero = _compiled(xp, self.texts[which])(y, numbers[which]), xp.zeros_like(y[0])
        return xp.stack([v if getattr(v, "shape", None) == zero.shape else zero + v for v in values])

    def values(self, xp: Any, numbers: Any, y: Any, first: int, last: int) -> Any:
        """The values at y of the rows `first` to `last` − 1 of a table of polynomials,
        given by `numbers`.
        """
        exponents, coefficients = numbers
        # Products replace y**e, because JAX and torch differentiate 0**0 to NaN.
        one, top = xp.ones_like(y), xp.amax(exponents, 1).reshape((-1, *[1] * (y.ndim - 1)))
        power = [one]
        for k in range(self.powers):
            # Powers that no monomial has are left out: they may overflow, and then derivatives have
            # 0·∞.
            power.append(power[-1] * xp.where(top > k, y, one))
        table = xp.stack(power)
        monomials = table[exponents[0], 0]
        for i in range(1, y.shape[0]):
            monomials = monomials * table[exponents[i], i]
        return xp.einsum("rt,t...->r...", coefficients[first:last], monomials)


def pose(
    problem: str | Problem, *, padded: bool = True, wide: bool = False
) -> tuple[Formulas, tuple[Array, ...]]:
    """The formulas of a problem and its numbers, as NumPy arrays.

    Parameters
    ----------
    problem : str or Problem
        A name, a file, ``module:attribute``, or the `Problem` that a step gets.
    padded : bool
        True fills up the tables of a polynomial problem with zeros to one of a few sizes. So a step
        is compiled a few times, and not once for each random problem.
    wide : bool
        True also fills up the variables of a polynomial problem to 6, 12, 24, …: the further ones
        do not change. Then y must have `Formulas.width` components, which `in_blocks` adds.

    Raises
    ------
    Skipped
        If the problem is given by NumPy functions, which no other library can run, or has a
        structure matrix for each noise. If a step does not catch this error, the laws take problems
        given as data instead.

    Examples
    --------
    >>> import numpy as np
    >>> formulas, numbers = pose("rigid-body")
    >>> float(formulas.hamiltonian(np, numbers, np.array([0.0, 0.0, 2.0])))  # y₃²/2I₃ with I₃ = 1
    2.0
    """
    system = load_problem(problem)
    known = (
        isinstance(system.data, PolynomialSystem) or getattr(system.data, "name", "") in PAPER | EXTENSIONS
    )
    if system.data is None or not known or not one_field(system):
        raise Skipped(
            f"{system.name} is not (1.1) given as data, and no other library can run NumPy functions: write it with "
            "sepv.problems.polynomial_problem, or its functions in your library (docs/extending.md)"
        )
    return _pose(system.data, padded, wide)


def field_in(xp: Any, problem: str | Problem) -> Callable[[Any], Any]:
    """The function y -> f(y) = B(y)∇H(y) of one problem, for y (d,) or (d, M), in arrays of `xp`,
    such as jax.numpy.

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
def _pose(
    data: PolynomialSystem | NamedProblem, padded: bool, wide: bool
) -> tuple[Formulas, tuple[Array, ...]]:
    if isinstance(data, NamedProblem):
        problem, y = build(data), Tape().vector(build(data).dimension)
        B, H = problem.structure(y), problem.hamiltonian(y)
        g = gradient(H, y)
        records = [source([y], outputs) for outputs in (B, g, [H], B @ g)]
        return Formulas(data.name, texts=tuple(r.text for r in records)), tuple(
            np.array(r.parameters) for r in records
        )
    entries = [entry for row in structure_entries(data) for entry in row]
    rows = [*entries, *poly.gradient(data.hamiltonian), data.hamiltonian]
    powers, numbers = table(data.dimension, rows, padded)
    if not wide:
        return Formulas("polynomial", powers), numbers
    width = size(data.dimension, TABLE_MIN_VARIABLES)
    return Formulas("polynomial", powers, width=width), _widened(width, *numbers)


def _widened(D: int, exponents: Array, coefficients: Array) -> tuple[Array, Array]:
    """The table of B, ∇H and H of d variables as one of D variables,
    with zero entries for the further ones.
    """
    d, terms = exponents.shape
    B, g = np.zeros((D, D, terms)), np.zeros((D, terms))
    B[:d, :d], g[:d] = coefficients[: d * d].reshape(d, d, terms), coefficients[d * d : d * d + d]
    rows = np.concatenate([B.reshape(D * D, terms), g, coefficients[-1:]])
    return np.concatenate([exponents, np.zeros((D - d, terms), dtype=np.int64)]), rows


@lru_cache(maxsize=64)
def _compiled(xp: Any, text: str) -> Callable[..., tuple[Any, ...]]:
    """Compile generated code of a formula to a function of (y, parameters) in the library `xp`,
    such as jax.numpy.
    """
    namespace: dict[str, Any] = {n: getattr(xp, n, None) for n in (*FUNCTIONS, "where", "logical_not")}
    namespace |= {"power": pow, "inf": math.inf}
    exec(compile(text, "<record>", "exec"), namespace)
    function: Callable[..., tuple[Any, ...]] = namespace["evaluate"]
    return function


def size(needed: int, least: int, factor: int = 2) -> int:
    """The smallest sufficient size among least, factor·least, factor²·least and so on."""
    while least < needed:
        least *= factor
    return least


def table(dimension: int, rows: list[Polynomial], padded: bool) -> tuple[int, tuple[Any, Array]]:
    """A table of R polynomials in T monomials: largest exponent, exponents (d, T),
    and coefficients (R, T).

    If `padded`, exponents and coefficients are filled up with zeros to T = 64, 256, 1024, ….
    """
    monomials = sorted({e for p in rows for e, _ in p.terms}) or [(0,) * dimension]
    powers, count = max(map(max, monomials)), len(monomials)
    if padded:
        powers, count = size(powers, TABLE_MIN_POWER), size(count, TABLE_MIN_TERMS, TERMS_GROW)
    index = {e: t for t, e in enumerate(monomials)}
    exponents = np.zeros((dimension, count), dtype=np.int64)
    exponents[:, : len(monomials)] = np.transpose(monomials)
    coefficients = np.zeros((len(rows), count))
    for r, p in enumerate(rows):
        for e, c in p.terms:
            coefficients[r, index[e]] = c
    return powers, (exponents, coefficients)


def in_blocks(step: Callable[[Array, Array], Any], y: Array, dW: Array, lanes: int, width: int = 0) -> Array:
    """Call step(y (d, lanes), dW (m, lanes)) for any number of states, or one state (d,),
    in blocks of `lanes` states.

    Because all blocks have one size, compiled code and its roundings do not depend on the number of
    states. If `width` is given, as by `pose(problem, wide=True)`, y gets further components 0, and
    only the first d of the result count.
    """
    states = y.reshape(y.shape[0], -1)
    d = len(states)
    if width > d:
        states = np.concatenate([states, np.zeros((width - d, states.shape[1]))])
    count = states.shape[1]
    increments = dW.reshape(dW.shape[0], count)
    filled = -(-count // lanes) * lanes
    lane = np.minimum(np.arange(filled), count - 1)
    parts = []
    for first in range(0, filled, lanes):
        block = lane[first : first + lanes]
        parts.append(np.asarray(step(states[:, block], increments[:, block]))[:d])
    return np.concatenate(parts, axis=1)[:, :count].reshape(y.shape)
