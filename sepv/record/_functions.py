"""The elementary functions that can be recorded, by their names, with values and derivatives.

NumPy lacks three of them: sin x/x, log1p(x)/x and expm1(x)/x. Averages of gradients along a segment
consist of these three and their derivatives. They are computed without loss of digits as x → 0.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
# The arguments |x| below which the formulas of the three derivatives lose digits and are replaced
# by power series.
_SINC_SERIES_BELOW, _LOG_SERIES_BELOW, _EXP_SERIES_BELOW = 0.5, 0.1, 0.5
_SERIES_TERMS = 18


def _ratio(function: Callable[[Any], Any], x: Any) -> Any:
    if isinstance(x, float):
        return float(function(x)) / x if x else 1.0
    x = np.asarray(x, dtype=np.float64)
    return np.where(x == 0, 1.0, function(x) / np.where(x == 0, 1.0, x))[()]


def sinc(x: Any) -> Any:
    """The function sin(x)/x, which is 1 at x = 0."""
    return _ratio(np.sin, x)


def sinc_slope(x: Any) -> Any:
    """The derivative of `sinc`, (cos x − sinc x)/x = Σ (−1)ⁿ 2n x²ⁿ⁻¹/(2n + 1)!."""
    return _slope(
        x, _SINC_SERIES_BELOW, _SINC_SERIES, lambda v: (np.cos(v) - sinc(v)) / v, lambda v: v * v, lambda v: v
    )


def log1p_ratio(x: Any) -> Any:
    """The function log(1 + x)/x for x > −1, which is 1 at x = 0."""
    return _ratio(np.log1p, x)


def log1p_ratio_slope(x: Any) -> Any:
    """The derivative of `log1p_ratio`, (1/(1 + x) − log1p(x)/x)/x = Σ (−1)ⁿ n xⁿ⁻¹/(n + 1)."""
    return _slope(x, _LOG_SERIES_BELOW, _LOG_SERIES, lambda v: (1 / (1 + v) - log1p_ratio(v)) / v)


def expm1_ratio(x: Any) -> Any:
    """The function (eˣ − 1)/x, which is 1 at x = 0."""
    return _ratio(np.expm1, x)


def expm1_ratio_slope(x: Any) -> Any:
    """The derivative of `expm1_ratio`, (eˣ − expm1(x)/x)/x = Σ xⁿ/(n! (n + 2))."""
    return _slope(x, _EXP_SERIES_BELOW, _EXP_SERIES, lambda v: (np.exp(v) - expm1_ratio(v)) / v)


def _slope(
    x: Any,
    small: float,
    coefficients: list[float],
    quotient: Callable[[Any], Any],
    variable: Callable[[Any], Any] = lambda v: v,
    factor: Callable[[Any], Any] = lambda _: 1.0,
) -> Any:
    """The series factor(x) Σ c_n variable(x)ⁿ if |x| < small, and quotient(x) otherwise.

    `coefficients` lists the c_n in the order of Horner's rule, the highest first.
    """

    def series(v: Any) -> Any:
        at, total = variable(v), 0.0 * v
        for c in coefficients:
            total = total * at + c
        return total * factor(v)

    if isinstance(x, float):
        return series(x) if abs(x) < small else quotient(x)
    x = np.asarray(x, dtype=np.float64)
    near = np.abs(x) < small
    if near.all():
        return series(x)[()]
    return np.where(near, series(np.where(near, x, 0.0)), quotient(np.where(near, 1.0, x)))[()]


# The factorials n! in binary64.
_F = [float(f) for f in np.cumprod([1.0, *range(1, 2 * _SERIES_TERMS + 2)])]
_SINC_SERIES = [(-1) ** n * 2 * n / _F[2 * n + 1] for n in range(_SERIES_TERMS // 2, 0, -1)]
_LOG_SERIES = [(-1) ** n * n / (n + 1) for n in range(_SERIES_TERMS, 0, -1)]
_EXP_SERIES = [1 / (_F[n] * (n + 2)) for n in range(_SERIES_TERMS - 1, -1, -1)]


@dataclass(frozen=True)
class Function:
    """An elementwise function f = `value`; `slope` is the function of two symbols, x and f(x),
    that returns f′(x).
    """

    value: Callable[[Any], Any]
    slope: Callable[[Any, Any], Any] | None


FUNCTIONS: dict[str, Function] = {
    "sin": Function(np.sin, lambda x, _: x.cos()),
    "cos": Function(np.cos, lambda x, _: -x.sin()),
    "tan": Function(np.tan, lambda _, f: 1 + f * f),
    "exp": Function(np.exp, lambda _, f: f),
    "expm1": Function(np.expm1, lambda _, f: 1 + f),
    "log": Function(np.log, lambda x, _: 1 / x),
    "log1p": Function(np.log1p, lambda x, _: 1 / (1 + x)),
    "sqrt": Function(np.sqrt, lambda _, f: 0.5 / f),
    "sinh": Function(np.sinh, lambda x, _: x.cosh()),
    "cosh": Function(np.cosh, lambda x, _: x.sinh()),
    "tanh": Function(np.tanh, lambda _, f: 1 - f * f),
    "arctan": Function(np.arctan, lambda x, _: 1 / (1 + x * x)),
    "sinc": Function(sinc, lambda x, _: x.apply("sinc_slope")),
    "log1p_ratio": Function(log1p_ratio, lambda x, _: x.apply("log1p_ratio_slope")),
    "expm1_ratio": Function(expm1_ratio, lambda x, _: x.apply("expm1_ratio_slope")),
    # Newton's matrix needs these derivatives, and no second derivatives.
    "sinc_slope": Function(sinc_slope, None),
    "log1p_ratio_slope": Function(log1p_ratio_slope, None),
    "expm1_ratio_slope": Function(expm1_ratio_slope, None),
}
