"""Systems in three dimensions given by two invariants: B(y)v = g(y) (v × ∇C(y)),
so that f = g ∇H × ∇C.

Near a point where it does not vanish, every Poisson structure in dimension three has this form
(Nambu's form), and C is its Casimir. C and g may be any functions, quadratic or not.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sepv.core.arrays import Array, cross_entries
from sepv.core.problem import Function
from sepv.problem._derived import derivatives, to_be_derived


@dataclass(frozen=True)
class Nambu:
    """The Casimir C and the factor g of a problem in dimension three,
    whose B is B(y)v = g(y)(v × ∇C(y)).

    Attributes
    ----------
    factor : callable, (3, ...) -> (...)
        The factor g.
    casimir : callable
        C, (3, ...) -> (...). If ∇C is not given, the attributes below are derived from C.
    gradient, hessian : callable, optional
        ∇C and C″, (3, ...) -> (3, ...) and (3, ...) -> (3, 3, ...).
    mean_gradient : callable, optional
        (y0, y1) -> ∫₀¹∇C(y0 + τ(y1 − y0))dτ, exact to rounding.
    degree : int, optional
        The degree of a polynomial C. If neither `degree` nor `mean_gradient` is given, adaptive
        quadrature averages ∇C.
    """

    factor: Function
    casimir: Function
    gradient: Function = to_be_derived
    hessian: Function = to_be_derived
    mean_gradient: Callable[[Array, Array], Array] | None = None
    degree: int | None = None
    dimension: int = 3

    def __post_init__(self) -> None:
        if self.gradient is to_be_derived:
            for key, value in vars(derivatives(3, self.casimir, "casimir")).items():
                object.__setattr__(self, key, value)


def cross(u: Array, v: Array) -> Array:
    """The vector product u × v of (3, ...) arrays."""
    return np.stack(cross_entries(u, v))
