"""Quantiles of Student's t, of F and of the binomial distribution.

The quantiles have twelve or more digits. SciPy is not used, because the import of `scipy.special`
would take a twentieth of the time of all laws.
"""

from __future__ import annotations

from functools import cache
from math import sqrt
from statistics import NormalDist

import mpmath
import numpy as np


@cache
def students_t(tail: float, df: int) -> float:
    """The quantile t with P(T > t) = tail, between 0 and ½,
    for Student's T with df degrees of freedom.

    P(|T| > t) = I_x(df/2, ½) with x = df/(df + t²), the regularised incomplete beta function.
    """

    def excess(t: mpmath.mpf) -> mpmath.mpf:
        both = mpmath.betainc(df / 2, 0.5, 0, df / (df + t * t), regularized=True)
        return mpmath.log(both / (2 * tail))

    normal = -NormalDist().inv_cdf(tail)
    return float(mpmath.findroot(excess, normal + (normal**3 + normal) / (4 * df)))


def fishers_f(tail: float, n: int) -> float:
    """The quantile f with P(F < f) = tail, for F with n and n degrees of freedom;
    √n (√F − 1/√F)/2 is Student's T.
    """
    t = students_t(tail, n) / sqrt(n)
    return (sqrt(1 + t * t) - t) ** 2


@cache
def binomial(level: float, n: int, p: float) -> int:
    """The smallest k with P(at most k of n) ≥ level, for n independent events of probability p."""
    k = np.arange(1, n + 1)
    # Ratios P(k)/P(k − 1), starting from P(0), avoid factorials.
    logs = np.cumsum(np.log((n + 1 - k) / k * p / (1 - p)))
    chances = np.exp(n * np.log1p(-p) + np.concatenate([[0.0], logs]))
    return int(np.searchsorted(np.cumsum(chances), level))
