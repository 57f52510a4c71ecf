"""The schemes of the paper, one file each."""

from __future__ import annotations

from sepv.scheme import Scheme
from sepv.schemes.discrete_gradient import scheme as discrete_gradient
from sepv.schemes.energy_preserving import scheme as energy_preserving
from sepv.schemes.euler_heun import scheme as euler_heun
from sepv.schemes.euler_maruyama import scheme as euler_maruyama
from sepv.schemes.midpoint import scheme as midpoint
from sepv.schemes.milstein import scheme as milstein

ALL: dict[str, Scheme] = {
    s.name: s for s in (energy_preserving, midpoint, discrete_gradient, euler_heun, milstein, euler_maruyama)
}

__all__ = [
    "ALL",
    "discrete_gradient",
    "energy_preserving",
    "euler_heun",
    "euler_maruyama",
    "midpoint",
    "milstein",
]
