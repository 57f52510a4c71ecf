"""Gauss Runge-Kutta methods with the random step: quadratic invariants to rounding, no other energy.

Y_i = y0 + Δ Σ_j a_ij f(Y_j), y1 = y0 + Δ Σ_j b_j f(Y_j), with the s Gauss nodes: order 2s, mean-square order s. Every
quadratic first integral is kept (G. J. Cooper, IMA Journal of Numerical Analysis 7, 1987): quadratic Casimirs, and H
where it is quadratic. s = 1 is the midpoint rule (3.4). It is the collocation method of Cohen and Hairer
with the averages of ∇H taken by s nodes.
"""

from __future__ import annotations

from functools import lru_cache

from sepv.schemes._collocation import staged
from sepv.schemes._one_step import SYMMETRIC
from sepv.schemes._scheme import Scheme


@lru_cache(maxsize=8)
def gauss(stages: int) -> Scheme:
    """The Gauss scheme with s stages, s = 1 … 6; any other number raises UsageError.

    Its increments are truncated with k = 4s, and with the paper's k = 2 for s = 1.
    """
    claims = SYMMETRIC | {"symplecticity", "long-time-energy"}
    return staged("gauss", stages, claims, "Gauss Runge-Kutta, with the random step", averaged=False)
