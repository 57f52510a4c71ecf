"""Gauss Runge-Kutta methods with the random step: they keep quadratic invariants,
and H only if H is quadratic.

Y_i = y0 + Δ Σ_j a_ij f(Y_j), y1 = y0 + Δ Σ_j b_j f(Y_j), for s Gauss nodes: order 2s, mean-square
order s. Every quadratic first integral is kept (G. J. Cooper, IMA Journal of Numerical Analysis 7,
1987): quadratic Casimirs, and a quadratic H. With s = 1 the method is the midpoint rule (3.4). For
every s it is the collocation method of Cohen and Hairer with ∇H averaged by s nodes only.
"""

from __future__ import annotations

from functools import lru_cache

from sepv.schemes._collocation import staged
from sepv.schemes._one_step import SYMMETRIC
from sepv.schemes._scheme import Scheme


@lru_cache(maxsize=8)
def gauss(stages: int) -> Scheme:
    """The Gauss scheme with s stages, s = 1 … 6; any other number raises UsageError.

    Increments are truncated to √(2kh|ln h|) (Remark 2.1), with k = 4s for s > 1 and the paper's
    k = 2 for s = 1.
    """
    claims = SYMMETRIC | {"poisson-map:constant", "long-time-energy"}
    return staged("gauss", stages, claims, "Gauss Runge-Kutta, with the random step", averaged=False)
