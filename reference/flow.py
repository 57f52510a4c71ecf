"""The exact flow y(θ) of y′ = B(y)∇H(y), which is the solution of (1.1)
at the random time θ(t) = t + Σ_j c_j W_j(t).

There are three methods. Taylor series in mpmath (`taylor`) and Taylor series with all errors
enclosed in balls (`enclosed`) share only the problem's formulas. Closed forms
(`sepv.reference.elliptic`) do not use these formulas.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from sepv.reference.arithmetic import Vector, context, decimal
from sepv.reference.balls import ball, precision, real_balls, require_flint
from sepv.reference.problem import Description, ExactProblem, exact_problem, in_arithmetic
from sepv.reference.series import solution_series
from sepv.reference.solve import FLOAT_ERRORS
from sepv.reference.steps import require_digits
from sepv.reference.tableau import horner

from sepv.errors import SepvError, UsageError

_MOST_STEPS = 20_000


class FlowNotReached(SepvError, ArithmeticError):
    """The flow cannot be followed to the given time: it leaves the domain, or blows up."""


def taylor(data: Description, y: Sequence[float], theta: float, digits: int = 50) -> Vector:
    """The exact flow φ_θ(y) by Taylor series in mpmath,
    to `digits` digits of the largest component on the way.

    Order and step follow Jorba and Zou (Experimental Mathematics 14, 2005): the order is ln(1/ε)/2,
    and the step is e⁻² times the radius of convergence that the last coefficients show, so that the
    last term is about ε. Guard digits, 15 + 2 log10(1 + |θ|), cover the sums and the growth of
    errors along the flow; `enclosed` proves the result.

    Raises
    ------
    UsageError
        If θ is not finite, digits is out of range, or the problem is unknown.
    FlowNotReached
    """
    require_digits(digits)
    if not math.isfinite(theta):
        raise UsageError(expected="a finite θ", received=repr(theta), remedy="θ = t + Σ c_j W_j(t)")
    guard = 15 + int(2 * math.log10(1 + abs(theta)))
    working = digits + guard
    ctx, arithmetic = context(working), decimal(working)
    order = int(working * math.log(10) / 2) + 1
    state = exact_problem(data, working).state(y)
    left = ctx.mpf(float(theta))
    for _ in range(_MOST_STEPS):
        if not left:
            return state
        try:
            coefficients = solution_series(data, arithmetic, state, order)
            step = _step(ctx, coefficients, order)
        except FLOAT_ERRORS as error:
            raise _not_reached(theta, float(left), str(error)) from error
        if step is None or step >= abs(left):
            step, left = left, ctx.zero
        else:
            step = ctx.mpf(float(step)) * ctx.sign(left)
            left -= step
        state = [horner(row, step) for row in coefficients]
        if not all(map(ctx.isfinite, state)) or abs(step) < 1e-12 * abs(theta):
            break
    raise _not_reached(theta, float(left), "steps become too short")


def flow_series(data: Description, y: Sequence[float], order: int, digits: int = 40) -> list[Vector]:
    """Coefficients c_0, …, c_order with φ_θ(y) = Σ c_k θ^k + O(θ^{order+1}),
    each c_k as a list of d numbers.
    """
    rows = solution_series(data, decimal(digits), exact_problem(data, digits).state(y), order)
    return [list(column) for column in zip(*rows, strict=True)]


def _step(ctx: Any, coefficients: list[Vector], order: int) -> Any:
    """The step, e⁻² times the radius of convergence that the last two coefficients show;
    None if both are zero.
    """
    size = max(abs(row[0]) for row in coefficients) or ctx.one
    radii = []
    for k in (order - 1, order):
        last = max(abs(row[k]) for row in coefficients)
        if last:
            radii.append((size / last) ** (ctx.one / k))
    return min(radii) * ctx.exp(-2) if radii else None


def _not_reached(theta: float, left: float, why: str) -> FlowNotReached:
    return FlowNotReached(
        f"The exact flow was followed to θ = {theta - left!r} of {theta!r} and no further: {why}. The solution "
        "leaves the domain or blows up there. Remedy: a smaller θ or another initial state."
    )


def enclosed(data: Description, y: Sequence[float], theta: float, digits: int = 50, bits: int = 0) -> Vector:
    """Balls that provably contain the exact flow φ_θ(y),
    with radii of at most 10^−digits of the largest component.

    Each step of length s is a Taylor polynomial in balls with Lagrange's remainder f^[N](Y) s^N,
    where Y contains the solution over the whole step because y + [0, s] f(Y) lies inside Y (Picard
    and Lindelöf). The balls grow along the flow. No method keeps them small; instead the
    computation has enough additional bits.

    Raises
    ------
    UsageError
        If python-flint is not installed.
    FlowNotReached
    """
    require_digits(digits)
    # The remainder of a step grows with the balls: by two digits per unit of θ for Lotka-Volterra,
    # less for others.
    working = digits + 15 + int(4 * abs(theta))
    bits = bits or int(3.33 * working) + 200
    order = int(working * math.log(10) / 2) + 20
    with precision(bits):
        problem = in_arithmetic(data, real_balls(bits))
        state, left = problem.state(y), problem.number(theta)
        for _ in range(_MOST_STEPS):
            if left == 0:
                return state
            step, state = _enclosed_step(problem, state, left, order, working)
            left = (left - step).mid()  # exact: both are sums of few binary64 numbers
            size = max(abs(v).upper() for v in state)
            if not all(v.is_finite() and v.rad() * 10**digits < size for v in state):
                break
    raise _not_reached(theta, float(left), "the enclosure grows too wide")


def _enclosed_step(
    problem: ExactProblem, state: Vector, left: Any, order: int, digits: int
) -> tuple[Any, Vector]:
    """Take a step of at most `left`, the remaining time;
    return the step's length and balls with the solution.
    """
    series = solution_series(problem.data, problem.arithmetic, state, order - 1)
    size = max(abs(v).upper() for v in state)
    last = max(abs(row[-1]).upper() for row in series)
    radius = float((size / last).root(order - 1)) if last > 0 else math.inf
    step = left
    if abs(left) > math.exp(-2) * radius:
        step = problem.number(math.copysign(math.exp(-2) * radius, float(left)))
    speed = max(abs(v).upper() for v in problem.field(state))
    # Near a rest point the rounding of the balls exceeds the movement, so that the box must allow
    # for it.
    rounding = size * problem.number(2.0) ** (30 - require_flint().ctx.prec)
    for _ in range(60):
        box = [v + ball(2 * abs(step) * speed + rounding) for v in state]
        span = step.union(0)
        image = [v + span * f for v, f in zip(state, problem.field(box), strict=True)]
        if all(b.is_finite() and b.contains_interior(i) for b, i in zip(box, image, strict=True)):
            rest = solution_series(problem.data, problem.arithmetic, box, order)
            remainder = [row[order] * step**order for row in rest]
            if all(r.is_finite() and abs(r).upper() * 10**digits < size for r in remainder):
                following = [horner(row, step) + r for row, r in zip(series, remainder, strict=True)]
                return step, following
        if speed == 0:
            return left, state
        step = problem.number(float(step) / 2)
    raise _not_reached(float(left), float(left), "no box contains the solution over a step")
