"""Running error analysis: a bound of the rounding error of a formula in plain binary64.

A number carries a bound of its rounding error in units of u = 2⁻⁵³. The bound of a ∘ b is the sum
of the propagated bounds of a and b and of |a ∘ b| for the rounding of the operation itself (Higham,
*Accuracy and Stability of Numerical Algorithms*, §3.3). Second-order terms are left out. Values are
mpmath numbers, so that they do not overflow.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from sepv.reference.arithmetic import (
    BINARY64,
    Arithmetic,
    Function,
    Number,
    Vector,
    context,
    decimal,
    gauss_nodes,
    log1p_ratio_slope,
    sinc_slope,
)
from sepv.reference.equations import make_step
from sepv.reference.problem import Description, in_arithmetic
from sepv.reference.series import PowerSeries
from sepv.reference.steps import ReferenceStep

_ROUNDING_DIGITS = 30
_CTX, _DECIMAL = context(_ROUNDING_DIGITS), decimal(_ROUNDING_DIGITS)
UNIT = 2.0**-53
# Half of the least positive binary64 number bounds the error of an operation that underflows.
UNDERFLOW = _CTX.mpf(2) ** -1075


class Rounded:
    """A binary64 value with a running bound of its rounding error in units of u = 2⁻⁵³."""

    __slots__ = ("error", "value")

    def __init__(self, value: Any, error: Any = 0) -> None:
        self.value, self.error = value, error

    def __add__(self, other: Any) -> Any:
        if isinstance(other, PowerSeries):
            return NotImplemented
        b = _lift(other)
        value = self.value + b.value
        return Rounded(value, self.error + b.error + abs(value))

    def __neg__(self) -> Rounded:
        return Rounded(-self.value, self.error)

    def __sub__(self, other: Any) -> Any:
        if isinstance(other, PowerSeries):
            return NotImplemented
        return self + -_lift(other)

    def __rsub__(self, other: Any) -> Rounded:
        return _lift(other) - self

    def __mul__(self, other: Any) -> Any:
        if isinstance(other, PowerSeries):
            return NotImplemented
        b = _lift(other)
        value = self.value * b.value
        return Rounded(value, abs(self.value) * b.error + abs(b.value) * self.error + _own(value))

    def __truediv__(self, other: Any) -> Any:
        if isinstance(other, PowerSeries):
            return NotImplemented
        b = _lift(other)
        value = self.value / b.value
        return Rounded(value, (self.error + abs(value) * b.error) / abs(b.value) + _own(value))

    def __rtruediv__(self, other: Any) -> Rounded:
        return _lift(other) / self

    __radd__, __rmul__ = __add__, __mul__


def _lift(x: Any) -> Rounded:
    return x if isinstance(x, Rounded) else Rounded(_CTX.mpf(x))


def _nudged(value: Any, slope: Any) -> PowerSeries:
    """The number value + ε slope with ε² = 0, as a power series of which no third term is asked."""
    return PowerSeries(BINARY64.dot, _no_further, [value, slope])


def _no_further(k: int) -> Any:
    raise IndexError(f"no coefficient {k}")


def _own(value: Any) -> Any:
    """A bound of the rounding error that one operation adds to its result, underflow included,
    in units of u.
    """
    return abs(value) + UNDERFLOW / UNIT if value else _CTX.zero


def _function(f: Function, slope: Callable[[Number], Number]) -> Function:
    """The function f on numbers with error bounds; f is assumed to be right within one unit in the
    last place, 2u.
    """

    def of(x: Any) -> Any:
        if isinstance(x, PowerSeries):
            steep = slope(x[0].value)
            return _nudged(of(x[0]), Rounded(steep, 2 * abs(steep)) * x[1])
        value = f(x.value)
        return Rounded(value, abs(slope(x.value)) * x.error + 2 * abs(value))

    return of


ROUNDED_ARITHMETIC = Arithmetic(
    number=lambda x: Rounded(_CTX.mpf(float(x))),
    sin=_function(_CTX.sin, _CTX.cos),
    cos=_function(_CTX.cos, _CTX.sin),
    log=_function(_CTX.ln, lambda x: 1 / x),
    sinc=_function(_DECIMAL.sinc, lambda x: sinc_slope(x, _CTX.cos(x), _DECIMAL.sinc(x))),
    log1p_ratio=_function(_DECIMAL.log1p_ratio, lambda x: log1p_ratio_slope(x, _DECIMAL.log1p_ratio(x))),
    gauss=lambda n: [(Rounded(node, node), Rounded(w, w)) for node, w in gauss_nodes(n, _ROUNDING_DIGITS)],
    tables=(_DECIMAL, lambda v: Rounded(v, abs(v))),
    nudged=_nudged,
    slope=lambda x: x[1] if isinstance(x, PowerSeries) else _lift(0),
)


def error_units(data: Description, y: Vector, h: float, dW: Vector, step: ReferenceStep) -> list[float]:
    """Bounds of the rounding error of binary64 in each component of y1,
    for a step solved to rounding.

    The bound is u(|∂y1/∂residual| r + |y1|), where r is the running error bound of one evaluation
    of the residual at the solution, or of the explicit formula. Another order of operations gives
    another r of about the same size.
    """
    problem = in_arithmetic(data, ROUNDED_ARITHMETIC)
    equation = step.equation
    y0, parts = problem.state(y), make_step(problem, h, tuple(dW))
    x = [Rounded(_CTX.mpf(v)) for v in step.x]
    if equation.residual is None:
        return [float(v.error * UNIT) for v in equation.result(problem, y0, parts, x)]
    errors = [v.error for v in equation.residual(problem, y0, parts, x)]
    d = len(y)
    worst = [max(errors[k::d]) for k in range(d)]
    carried = [sum(c * r for c, r in zip(row, worst, strict=True)) for row in step.condition]
    return [float((c + abs(_CTX.mpf(v))) * UNIT + UNDERFLOW) for c, v in zip(carried, step.y1, strict=True)]
