"""A step changes each function I that a problem states (`Problem.invariants`) as the exact flow does, or in the mean.

`sepv.problem.relation` finds constants σ and λ with LI = σ − λI, where L is the generator of the system. If no noise
moves I, then I(y1) = e^(−λh) I(y0) + σ(1 − e^(−λh))/λ on each path, and I(y1) = I(y0) for σ = λ = 0. Otherwise this is
true of the mean E[I(y1)], which a quadrature over the increments gives (`sepv.properties._trace_formula`).
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache, partial

import numpy as np
from sepv.properties._decay import LARGEST_DECAY
from sepv.properties._decay import residual as damped_residual
from sepv.properties._trace_formula import Quantity, measured, nodes, short
from sepv.reference.arithmetic import context
from sepv.reference.given_functions import in_many_digits

from sepv.errors import Skipped
from sepv.problem import Array, Function, Problem, Relation, damping_of, derivatives, relation
from sepv.problems import build
from sepv.record import EPS, TINY
from sepv.schemes import Scheme, ask
from sepv.verification import Case, Cases, Effort, Measurement, require, searched, step_residual
from sepv.verification._cases.clipped import clips
from sepv.verification._cases.users_problems import sources
from sepv.verification._tolerance import majorant_over

DIGITS = 40
# The most steps of a quadrature for a scheme that takes one state a call: 76 s for steps of 76 ms.
MOST_NODES = 1000
NONE_STATED = "no problem states a function: Problem(…, invariants={'momentum': lambda y: …}), then -p NAME"


def relations(problem: Problem) -> dict[str, Relation]:
    """The relation LI = σ − λI of each function I that the problem states, by name."""
    return {name: relation(problem, name) for name in problem.invariants}


def stated(case: Case) -> Case | None:
    """Keep a case whose problem states functions. Half of the cases become those of a mean if noise moves a function.

    Cases of a mean have dW = 0 and a step as long as `short` allows.
    """
    found = relations(build(case.problem)).values()
    if not found or abs(damping_of(build(case.problem)) * case.h) > LARGEST_DECAY:
        return None
    moved = [bool(known.moved) for known in found]
    return short(case) if all(moved) or (any(moved) and not case.dW[0] > 0) else case


def check(scheme: Scheme, case: Case) -> Measurement:
    """Measure the function I whose value, or mean, is furthest from the right one, relative to its bound."""
    problem, y, h, dW = case.build()
    found = relations(problem)
    measurements = []
    if paths := [name for name, known in found.items() if not known.moved]:
        y1 = ask(scheme, problem, y, h, dW)
        r = residual(scheme, problem, y, y1, h, dW)
        measurements = [on_path(problem, name, found[name], y, y1, h, r) for name in paths]
    if not dW.any() and h > 0:
        means = [name for name, known in found.items() if known.moved]
        measurements += [in_mean(scheme, case, name, found[name]) for name in means]
    if not measurements:
        raise Skipped("noise moves every stated function, and the case has increments")
    return max(measurements, key=lambda m: m.ratio)


def residual(scheme: Scheme, problem: Problem, y: Array, y1: Array, h: float, dW: Array) -> Array:
    """Twice a bound (d,) of the step's residual: a step may evaluate an averaged ∇I as well as ∇H.

    Twice the residual also covers LI, which is σ − λI up to a few roundings of its terms (`sepv.problem`).
    """
    if damping_of(problem):
        return 2 * damped_residual(scheme, problem, y, y1, h, dW)
    return 2 * step_residual(problem, y, y1, h, dW, scheme)


def on_path(
    problem: Problem, name: str, known: Relation, y: Array, y1: Array, h: float, r: Array
) -> Measurement:
    """Measure I(y1) − e^(−λh) I(y0) − σ(1 − e^(−λh))/λ with DIGITS digits; the bound is Σ_i |∂_iI| r_i on the segment.

    Damping moves the state by the factor e^(−γh/2) before and after the step that has the residual r, so the box of the
    segment is enlarged by the largest such change.
    """
    ctx, I = context(DIGITS), problem.invariants[name]
    exact = in_many_digits(I, problem.dimension, DIGITS)
    assert exact is not None  # `relation` recorded it
    before, after = (exact([ctx.mpf(float(v)) for v in state]) for state in (y, y1))
    sigma, decay = ctx.mpf(known.sigma), ctx.mpf(known.decay)
    grown = -ctx.expm1(-decay * h) / decay if decay else ctx.mpf(h)
    expected = before + (sigma - decay * before) * grown
    beyond = np.expm1(0.5 * abs(damping_of(problem) * h)) * max(np.max(np.abs(v)) for v in (y, y1))
    slope, curve = slopes(I, problem.dimension)
    M = majorant_over(slope, curve, (y, y1), beyond, I)
    # The roundings of σ and λ to binary64.
    bound = float(M @ r) + EPS * abs(float((sigma - decay * before) * grown)) + TINY
    unit = unit_of(slope, y, y1)
    detail = (
        f"I = {name}: I(y1) = {float(after)!r}, expected {float(expected)!r}, I(y0) = {float(before)!r}, "
        f"{known.words}; y1 = {y1.tolist()}"
    )
    return Measurement(abs(float(after - expected)) / unit, bound / unit, detail)


def in_mean(scheme: Scheme, case: Case, name: str, known: Relation) -> Measurement:
    """Measure the mean of I by a quadrature, as far as its number of steps is affordable.

    A step may leave the box of y0 and y1, because noises of parts of it may cancel. No state of a step is taken to be
    further from y0 than twice the farthest y1 of the rule.

    Raises
    ------
    Skipped
        If the scheme clips its increments, and the mean would need more of them than E[ζ²]: if λ ≠ 0, or if the drift
        moves I.
    """
    problem, y, h, _ = case.build()
    own = scheme
    if not clips(scheme, [replace(case, dW=(1.0,) * problem.noises)]):
        own = replace(scheme, truncation=None)  # its increments may then be those of a Wiener process
    elif known.decay or known.drifts:
        raise Skipped(
            "with clipped increments the mean of I is known only if LI is a constant of the noise alone"
        )
    if not scheme.batched and nodes(own, problem, h) > MOST_NODES:
        raise Skipped(f"a mean needs more than {MOST_NODES} steps of single states")
    I = problem.invariants[name]
    slope, curve = slopes(I, problem.dimension)

    def moved(y0: Array, y1: Array, r: Array) -> Array:
        reach = 2 * np.max(np.abs(y1 - y0), axis=1, keepdims=True)
        return np.asarray(np.sum(majorant_over(slope, curve, (y0, y1), reach, I) * 2 * r, axis=0))

    size = partial(_size, I, slope)
    F = Quantity(f"{name}", I, size, moved, known.sigma, unit_of(slope, y), known.decay)
    found = measured(own, problem, y, h, F)
    return Measurement(found.defect, found.bound, f"I = {name}: {found.detail}; {known.words}")


def _size(I: Function, slope: Function, y: Array) -> Array:
    return majorant_over(I, slope, (y,))


def unit_of(slope: Function, *states: Array) -> float:
    """The unit of defects of I: eps |∇I||y|, the effect of one rounding of y on I."""
    return EPS * max(TINY, *(float(np.linalg.norm(slope(y)) * np.linalg.norm(y)) for y in states))


@lru_cache(maxsize=256)
def slopes(I: Function, dimension: int) -> tuple[Function, Function]:
    """∇I (d, ...) and I″ (d, d, ...), derived from the recorded operations of I."""
    derived = derivatives(dimension, I, "an invariant")
    return derived.gradient, derived.hessian


law = searched(
    name="invariant",
    statement="a stated function I with LI = σ − λI changes as along the exact flow, or in the mean if noise moves it",
    source="(1.1), trace formula",
    unit="ulp of I",
    preserves=True,
    cost=0.3,
    steps=75,
    cases=Cases(adapt=stated, why="the problems state no function: Problem(…, invariants={…})", damped=True),
    not_applicable=lambda scheme: "" if sources(scheme) else NONE_STATED,
    check=check,
)


def test_invariant(scheme: Scheme, effort: Effort) -> None:
    require(law, scheme, effort)
