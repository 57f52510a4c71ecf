"""The class of large problems, with sparse matrices where `sepv.Problem` has dense ones.

`sepv.Problem` returns B(y) as (d, d) and B′ as (d, d, d): at d = 10⁴ that is 0.8 GB and 8 TB. Here B is a sparse
matrix, and B′ is replaced by its product with a vector, because Newton's matrix needs only this product. Functions get
one state and no batch of states, because one state already fills the processor's vector units.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import fsum
from typing import Any

import numpy as np

from sepv.errors import ProblemError
from sepv.problem import Array

# A scipy.sparse array in any format.
Sparse = Any


@dataclass(frozen=True, eq=False)
class LargeProblem:
    """A large system dy = B(y)∇H(y)(dt + Σ_j c_j ∘dW_j) with a sparse and skew-symmetric B(y).

    Attributes
    ----------
    structure : (d,) -> sparse (d, d)
        The structure matrix B(y).
    structure_slope : (y, v) -> sparse (d, d), optional
        The derivative of B(y)v by y with v held fixed; None for constant B.
    terms : (d,) -> (n,)
        Numbers whose sum is H(y); `energy` adds them exactly.
    gradient, hessian : (d,) -> (d,) and (d,) -> sparse (d, d)
        ∇H and H″.
    degree : int, optional
        The degree of H if H is a polynomial. Gauss-Legendre quadrature with ⌈degree/2⌉ nodes then averages ∇H exactly.
    mean_gradient : (y0, y1) -> (d,), optional
        ∫₀¹∇H(y0 + τ(y1 − y0))dτ in closed form. Exactly one of `mean_gradient` and `degree` must be given.
    casimirs : (d,) -> (K,), optional
        Quadratic and linear Casimirs, which scheme (2.1) keeps (Proposition 3.2).
    other_casimirs : (d,) -> (K,), optional
        Other Casimirs, which scheme (2.1) does not keep. Their defects are measured too.
    domain : (d,) -> bool, optional
    initial : (d,)
    noise : the c_j ≥ 0, shape (m,)
    """

    name: str
    structure: Callable[[Array], Sparse]
    structure_slope: Callable[[Array, Array], Sparse] | None
    terms: Callable[[Array], Array]
    gradient: Callable[[Array], Array]
    hessian: Callable[[Array], Sparse]
    initial: Array
    degree: int | None = None
    mean_gradient: Callable[[Array, Array], Array] | None = None
    casimirs: Callable[[Array], Array] | None = None
    other_casimirs: Callable[[Array], Array] | None = None
    domain: Callable[[Array], bool] | None = None
    noise: tuple[float, ...] = (1.0,)

    def __post_init__(self) -> None:
        initial = np.array(self.initial, dtype=np.float64)
        if initial.ndim != 1 or not initial.size or not np.all(np.isfinite(initial)):
            raise ProblemError(
                expected="initial, a finite state (d,)",
                received=f"shape {initial.shape}: {self.initial!r:.60}",
                remedy="one number for each component",
            )
        if (self.degree is None) == (self.mean_gradient is None):
            raise ProblemError(
                expected="one of degree and mean_gradient",
                received="both" if self.degree is not None else "neither",
                remedy="the degree of a polynomial H, or the averaged gradient in closed form",
            )
        if not all(np.isfinite(c) and c >= 0 for c in self.noise):
            raise ProblemError(
                expected="noise: the coefficients c_j, finite and ≥ 0, or () for none",
                received=f"{self.noise!r}",
                remedy="a sign belongs into the Wiener increment: c∘dW and −c∘dW have the same law",
            )
        initial.setflags(write=False)
        object.__setattr__(self, "initial", initial)

    @property
    def dimension(self) -> int:
        """The number d of components of y."""
        return int(self.initial.size)

    def energy(self, y: Array) -> float:
        """H(y) as the exact sum of its terms; a plain sum of d terms would have an error of about √d roundings."""
        return fsum(self.terms(y).tolist())

    def energy_difference(self, y: Array, y0: Array) -> float:
        """H(y) − H(y0) as one exact sum of the terms of both; its rounding is relative to the difference, not to H."""
        return fsum(self.terms(y).tolist() + (-self.terms(y0)).tolist())

    def random_step(self, h: float, dW: Array) -> float:
        """The random step Δ = h + Σ_j c_j ΔW_j for dW of shape (m,)."""
        return h + float(sum(c * w for c, w in zip(self.noise, dW, strict=True)))
