"""The trace formula after one step, E[F(y1)] = F(y0) + hσ, by quadrature over the increments.

The law *invariant* measures its defect. For additive noise its systems are dy = B∇H dt + Σ c_j g_j
dW_j, whose generator L maps F to a constant, LF = σ. A scheme satisfies the formula exactly if it
adds the noise of half a step, makes a step of y′ = B∇H that keeps F, and adds the noise of the
other half. Each noise adds Var(ΔW_j) σ = ½hσ to E[F]. With clipped increments √h ζ_j, such a scheme
has E[F(y1)] = F(y0) + hσ E[ζ²], which is then the expected value.

**Bound.** At each node of the quadrature the residual r of the step and the rounding of F change F.
The bound is the mean of both changes, plus twice the difference from a rule with one node fewer in
each variable. This difference is of rounding size if F(y1) is a polynomial of low degree in the
noise, as for schemes that satisfy the laws. The noises of both halves may cancel, so r is computed
with every increment as large as the largest one of the rule.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from sepv.properties._orders.gaussian import rule_for

from sepv.law import Measurement
from sepv.law.cases.case import Case
from sepv.law.cases.from_problem import measured_radius
from sepv.law.contraction import contraction_ball
from sepv.law.tolerance import operations, step_residual
from sepv.problem import Array, Problem
from sepv.record import EPS, TINY, PolynomialMap
from sepv.schemes import Scheme, ask

# The roundings of hσ E[ζ²]: those of the rule's weights, and of a sum of rounded products that is
# itself rounded once.
MOMENT_ROUNDINGS = 8


@dataclass(frozen=True)
class Quantity:
    """A function F of the state y that the generator L maps to a constant, LF = σ.

    Attributes
    ----------
    name : str
        The name of F in messages.
    value, size : (d, M) -> (M,)
        F, and the sum of the absolute values of the terms of F. The rounding of F is proportional
        to this sum.
    moved : (y0, y1, r), each (d, M) -> (M,)
        A bound of the change of F that a residual r of the step from y0 to y1 causes.
    rate : float
        The constant σ.
    unit : float
        The unit of the reported defect.
    decay : float
        λ, if LF = σ − λF and increments are not clipped. Then E[F(y1)] = e^(−λh) F(y0) + σ(1
        − e^(−λh))/λ.
    """

    name: str
    value: Callable[[Array], Array]
    size: Callable[[Array], Array]
    moved: Callable[[Array, Array, Array], Array]
    rate: float
    unit: float
    decay: float = 0.0


def short(case: Case) -> Case:
    """Return the case with dW = 0 and the h for which h + 4√h Σ c_j is the contraction radius,
    or 1 if that is less.
    """
    problem, y, _, _ = case.build()
    polynomial = isinstance(problem.gradient, PolynomialMap)
    radius = contraction_ball(problem, y)[0] if polynomial else measured_radius(problem, y)
    noise = 4 * float(problem.c.sum())
    root = (-noise + (noise * noise + 4 * min(radius, 1.0)) ** 0.5) / 2
    return replace(case, h=root * root, dW=(0.0,) * problem.noises)


def measured(scheme: Scheme, problem: Problem, y: Array, h: float, F: Quantity) -> Measurement:
    """Measure |E[F(y1)] − F(y0) − hσ E[ζ²]| for h > 0 and σ = `F.rate`.
    The module's docstring derives the bound.
    """
    mean, allowed = mean_after(scheme, problem, y, h, F)
    coarser, _ = mean_after(scheme, problem, y, h, F, fewer=1)
    start, size = float(F.value(y)), float(F.size(y))
    share, coarser_share = (second_moment(scheme, problem, h, fewer) for fewer in (0, 1))
    change = h * F.rate * share
    difference = mean - coarser - h * F.rate * (share - coarser_share)
    if F.decay:
        change, difference = -math.expm1(-F.decay * h) * (F.rate / F.decay - start), mean - coarser
    rounding = EPS * (operations(problem) * size + MOMENT_ROUNDINGS * abs(change))
    unit = F.unit + EPS * (size + abs(change)) + TINY
    bound = allowed + rounding + 2 * abs(difference)
    expected = f"hσ = {change!r}"
    if F.decay:
        expected = f"{change!r} with λ = {F.decay!r}"
    elif share != 1:
        expected = f"hσ E[ζ²] = {change!r} with E[ζ²] = {share!r} (ΔW = √h ζ is clipped: see truncation)"
    detail = f"E[{F.name}(y1)] − {F.name}(y0) = {mean - start!r}, expected {expected} with σ = {F.rate!r}"
    return Measurement(abs(mean - start - change) / unit, bound / unit, detail)


def second_moment(scheme: Scheme, problem: Problem, h: float, fewer: int = 0) -> float:
    """Return E[ζ²] of the clipped increments √h ζ by the rule of `mean_after`,
    and 1 for a scheme without clipping.

    Kinks of the clipping make the rule inexact. Its error in E[F(y1)] cancels if F(y1) is quadratic
    in the increments.
    """
    if scheme.truncation is None or not problem.noises:
        return 1.0
    nodes = rule_for(scheme, problem, h, 4, fewer)
    return math.fsum(nodes.zeta[0, nodes.index] ** 2 * nodes.weights)


def nodes(scheme: Scheme, problem: Problem, h: float) -> int:
    """Return the number of steps that `mean_after` makes."""
    return int(rule_for(scheme, problem, h, 4).zeta.shape[1])


def mean_after(
    scheme: Scheme, problem: Problem, y: Array, h: float, F: Quantity, fewer: int = 0
) -> tuple[float, float]:
    """Return E[F(y1)] by quadrature (`fewer` nodes less per variable),
    and a bound of residual and rounding errors.
    """
    nodes = rule_for(scheme, problem, h, 4, fewer)
    noise = np.sqrt(h) * nodes.zeta
    states = np.repeat(y[:, None], noise.shape[1], axis=1)
    if scheme.batched:
        ends = ask(scheme, problem, states, h, noise)
    else:
        ends = np.stack([ask(scheme, problem, y, h, w) for w in noise.T], axis=1)
    largest = np.full((problem.noises, noise.shape[1]), np.abs(noise).max(initial=0.0))
    residual = step_residual(problem, states, ends, h, largest, scheme)
    wrong = F.moved(states, ends, residual) + EPS * operations(problem) * F.size(ends)
    return float(F.value(ends)[nodes.index] @ nodes.weights), float(wrong[nodes.index] @ nodes.weights)
