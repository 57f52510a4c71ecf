"""Consistency: y1 = y0 + hf(y0) + o(h), measured by the limit κ of (y1 − φ_h(y0))/h for h → 0.

If the weights of a method add to 1 + 1e-9, its error is κh + O(h^(p+1)) with κ = 1e-9 f(y0). Its
slope is p + 1 down to the h at which both terms are equal, and 1 below, as for a solver that stops
early. But the error of such a solver scatters with h, or is a power of h in which the sweeps are
counted, and so tends to 0 faster than h. Here E(h) = (y1 − φ_h)/h = κ + a_1 h + a_2 h² + … is
fitted by polynomials of degree n, with weights h, because an error R of y1 (of rounding, the flow,
or a tolerance that is stated) changes E(h) by R/h. So κ is found up to

    Σ_i |r_i| R/h_i + 2 max(|κ_n − κ_(n−1)|, |κ_(n−1) − κ_(n−2)|),

where r is the row of the fit that gives κ, and the second term estimates what higher powers of h
do. A fit whose residuals exceed 2R/h is no fit: its errors scatter. Of all n and ranges of h, that
with the smallest bound counts.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sepv.problem import Array

# The degrees of the polynomials, and the numbers of coarse step sizes that are left out.
DEGREES, LEFT_OUT_STEP_SIZES = (3, 4, 5), range(0, 16, 3)


class KappaLimit(NamedTuple):
    """The limit κ (d,) of (y1 − φ_h)/h for h → 0, and the bound below which it may come from
    rounding.
    """

    value: Array
    bound: float

    @property
    def is_zero(self) -> bool:
        """True if no component of κ exceeds the bound."""
        return float(np.max(np.abs(self.value))) <= self.bound


def limit(h: Array, errors: Array, rounding: float) -> KappaLimit | None:
    """Return the limit of errors (L, d) over h (L,), each exact up to `rounding`, for h → 0;
    None if they scatter.
    """
    found = [
        own
        for first in LEFT_OUT_STEP_SIZES
        for n in DEGREES
        if h.size - first > n + 2 and (own := _fitted(h[first:], errors[first:], n, rounding)) is not None
    ]
    return min(found, key=lambda own: own.bound) if found else None


def _fitted(h: Array, errors: Array, degree: int, rounding: float) -> KappaLimit | None:
    x = h / h[0]
    powers = np.vander(x, degree + 1, increasing=True)
    limits = []
    for n in range(degree - 2, degree + 1):
        # Rows times h: the error R of y1 has the same size in each.
        inverse = np.linalg.pinv(powers[:, : n + 1] * h[:, None])
        parts = inverse @ errors
        limits.append(parts[0])
    if np.max(np.abs(powers @ parts * h[:, None] - errors)) > 2 * rounding:
        return None
    before, last, value = limits
    beyond = max(float(np.max(np.abs(value - last))), float(np.max(np.abs(last - before))))
    return KappaLimit(value, float(np.sum(np.abs(inverse[0]))) * rounding + 2 * beyond)
