"""The drift and the noise fields of a system for libraries such as JAX, with one or with several
Hamiltonians.

The system is dy = F_0 dt + Σ_j F_j ∘dW_j with F_0 = B∇H_0 and F_j = c_j B∇H_j; in (1.1) all H_j are
H_0. In Itô's form its drift is F_0 + ½ Σ_j F_j′F_j. The products and derivatives of polynomials of
several Hamiltonians are computed once for each system.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from sepv.errors import Skipped
from sepv.posing._formulas import Formulas, pose, size, table
from sepv.problem import Array, PolynomialSystem, Problem
from sepv.problems import structure_entries
from sepv.record import Polynomial, poly


@dataclass(frozen=True)
class OneField:
    """Drift f and noise fields c_j f of a system (1.1), as `PosedFields` gives those of several
    Hamiltonians. The first of its numbers is c.

    Attributes
    ----------
    noises : int
        The length of c.
    """

    formulas: Formulas
    noises: int

    @property
    def width(self) -> int:
        """The number of components that y must have; 0 for the problem's own number."""
        return self.formulas.width

    def drift(self, xp: Any, numbers: Any, y: Any) -> Any:
        """The field f at y (d, ...), of the same shape."""
        return self.formulas.field(xp, numbers[1:], y)

    def noise(self, xp: Any, numbers: Any, y: Any) -> Any:
        """The noise fields c_1 f, …, c_m f at y (d, ...), of shape (m, d, ...)."""
        return numbers[0].reshape((-1, *[1] * y.ndim)) * self.drift(xp, numbers, y)


@dataclass(frozen=True)
class PosedFields:
    """Drift and noise fields of a system for arrays of any library `xp`; hashable,
    as a static argument of JAX.
    """

    dimension: int
    noises: int
    powers: int
    width = 0

    def drift(self, xp: Any, numbers: Any, y: Any) -> Any:
        """The drift at y (d, ...), of the same shape: F_0 = B∇H_0,
        or Itô's drift if `pose_fields` had `ito=True`.
        """
        return self._rows(xp, numbers, y, 0, 1)[0]

    def noise(self, xp: Any, numbers: Any, y: Any) -> Any:
        """The noise fields F_1, …, F_m at y (d, ...), of shape (m, d, ...)."""
        return self._rows(xp, numbers, y, 1, 1 + self.noises)

    def _rows(self, xp: Any, numbers: Any, y: Any, first: int, last: int) -> Any:
        d = self.dimension
        values = Formulas("polynomial", self.powers).values(xp, numbers, y, first * d, last * d)
        return values.reshape((last - first, d, *y.shape[1:]))


def pose_one_field(problem: Problem, *, wide: bool = False) -> tuple[OneField, tuple[Array, ...]]:
    """The fields of a system (1.1), and its numbers as NumPy arrays, the first of which is c.

    Of a polynomial problem `wide` fills up tables and variables as in `pose`, and c with zeros to
    4, 8, … noises. Raises Skipped as `pose`.
    """
    formulas, numbers = pose(problem, padded=wide, wide=wide)
    noises = size(problem.noises, 4) if formulas.width else problem.noises
    return OneField(formulas, noises), (np.pad(problem.c, (0, noises - problem.noises)), *numbers)


def pose_fields(problem: Problem, *, ito: bool = False) -> tuple[PosedFields, tuple[Array, ...]]:
    """The formulas of a system with several Hamiltonians (polynomials),
    and its numbers as NumPy arrays.

    >>> import numpy as np
    >>> from sepv import problems
    >>> fields, numbers = pose_fields(problems.random_inertia())
    >>> fields.noise(np, numbers, np.array([1.0, 0.5, 2.0])).tolist()
    [[-0.0, 1.0, -0.25], [-1.0, 0.0, 0.5]]
    """
    data = problem.data
    if not isinstance(data, PolynomialSystem) or not data.noise_hamiltonians:
        raise Skipped(f"{problem.name} is no system of several Hamiltonians given as data")
    return _posed(data, ito)


@lru_cache(maxsize=64)
def _posed(data: PolynomialSystem, ito: bool) -> tuple[PosedFields, tuple[Array, ...]]:
    B = structure_entries(data)
    noises = [_field(B, H, c) for H, c in zip(data.noise_hamiltonians, data.noise, strict=True)]
    drift = _field(B, data.hamiltonian, 1.0)
    if ito:
        drift = [poly.add(p, *(_second(F, i) for F in noises)) for i, p in enumerate(drift)]
    rows = [p for field in (drift, *noises) for p in field]
    powers, numbers = table(data.dimension, rows, padded=False)
    return PosedFields(data.dimension, len(noises), powers), numbers


def _field(B: Sequence[Sequence[Polynomial]], H: Polynomial, c: float) -> list[Polynomial]:
    """The components of the field c B∇H, as polynomials."""
    slope = poly.gradient(H)
    return [
        poly.scale(c, poly.add(*(poly.multiply(b, g) for b, g in zip(row, slope, strict=True)))) for row in B
    ]


def _second(F: Sequence[Polynomial], i: int) -> Polynomial:
    """The component ½ (F′F)_i of Itô's correction."""
    slope = poly.gradient(F[i])
    return poly.scale(0.5, poly.add(*(poly.multiply(s, p) for s, p in zip(slope, F, strict=True))))
