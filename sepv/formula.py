"""A scheme's formula is written once, for arrays and for symbols: (fields, y, z, Δ) -> R of y1 = y0 + R, z = y1 − y0.

`fields` answers what the formula asks of a problem. `Asked` answers with arrays and counts; the compiled engine answers
with symbols, and derives Newton's matrix from the record of R.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol, cast

import numpy as np

from sepv.average import Average, average_gradient
from sepv.implicit import Increment
from sepv.problem import Array, Problem


class Fields(Protocol):
    """What a formula may ask of a problem, of arrays (d, M) or of symbols (d,)."""

    def structure(self, y: Any) -> Any:
        """B(y), (d, d, ...)."""

    def gradient(self, y: Any) -> Any:
        """∇H(y), (d, ...)."""

    def mean_gradient(self, y: Any, z: Any) -> Any:
        """∫₀¹∇H(y + τz)dτ, (d, ...), for the formula's own y and z."""

    def factor(self, y: Any) -> Any:
        """g(y) of B(y)v = g(y)(v × ∇C(y)), (...)."""

    def mean_casimir_gradient(self, y: Any, z: Any) -> Any:
        """∫₀¹∇C(y + τz)dτ, (3, ...), for the formula's own y and z."""


Formula = Callable[[Fields, Any, Any, Any], Any]


class Asked:
    """A problem's answers along the segment from y0 to y1 (d, M), with what they cost.

    Attributes
    ----------
    gradients, structures : (M,)
        Evaluations of ∇H, and of B or of what stands for it.
    reliable : (M,)
        Where the quadratures are.
    mean, B : (d, M), (d, d, M)
        The last averaged gradient and structure, which Newton's matrix takes over.
    """

    def __init__(self, problem: Problem, y0: Array, y1: Array) -> None:
        self._problem, self._y0, self._y1 = problem, y0, y1
        self.gradients = np.zeros(y0.shape[1], dtype=np.int64)
        self.structures = np.zeros_like(self.gradients)
        self.reliable = np.ones(y0.shape[1], dtype=bool)
        self.mean = self.B = np.empty(0)

    def structure(self, y: Array) -> Array:
        """B(y)."""
        self.structures = self.structures + 1
        self.B = self._problem.structure(y)
        return self.B

    def gradient(self, y: Array) -> Array:
        """∇H(y)."""
        self.gradients = self.gradients + 1
        return self._problem.gradient(y)

    def mean_gradient(self, y: Array, z: Array) -> Array:  # noqa: ARG002 - y0 and y1 − y0, which y1 is not rounded from
        """∫₀¹∇H(y + τz)dτ."""
        found = average_gradient(self._problem, self._y0, self._y1)
        self.gradients = self.gradients + found.evaluations
        self.mean = self._trusted(found)
        return self.mean

    def factor(self, y: Array) -> Array:
        """g(y)."""
        assert self._problem.nambu is not None
        return self._problem.nambu.factor(y)

    def mean_casimir_gradient(self, y: Array, z: Array) -> Array:  # noqa: ARG002 - as for H
        """∫₀¹∇C(y + τz)dτ; its evaluations count as those of a structure."""
        found = average_gradient(cast(Any, self._problem.nambu), self._y0, self._y1)
        self.structures = self.structures + found.evaluations
        return self._trusted(found)

    def _trusted(self, found: Average) -> Array:
        self.reliable = self.reliable & found.reliable
        return found.value


def counted(
    formula: Formula, problem: Problem, y0: Array, y1: Array, delta: Array, *, parts: bool = False
) -> Increment:
    """R of arrays with its counts; with `parts` what Newton's matrix of (2.1) takes over, ∇̄H and B(ȳ)."""
    asked = Asked(problem, y0, y1)
    value = formula(asked, y0, y1 - y0, delta)
    taken = (asked.mean, asked.B) if parts else ()
    return Increment(value, asked.gradients, asked.structures, asked.reliable, parts=taken)
