"""A step stays in the problem's domain: for Lotka-Volterra the positive octant,
which the exact flow never leaves.

Solutions of ẏ_i = y_i r_i(y), also of stochastic systems of this form, keep the sign of every
component. A scheme that stays in the domain need not reject steps. Cohen and Dujardin (2014), §1,
[23], point to such integrators.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from hypothesis import strategies as st

from sepv.errors import Skipped, StepFailure
from sepv.law import Case, Cases, Effort, Measurement, Middle, require, searched
from sepv.law.strategies import coefficients, noises
from sepv.problem import Array, NamedProblem, Problem, Systems, noise_field, vector_field
from sepv.problems.shown_to_schemes import as_given
from sepv.schemes import Scheme, by_name, guarded

PARAMETER_NAMES = ("a", "b", "d", "nu", "mu", "noise")
# Six systems with parameters of all signs, the first one the paper's. They are few, with many steps
# each, because sepv needs as much time to record a system as for a dozen steps.
POSITIVE_SYSTEMS = tuple(
    NamedProblem("lotka-volterra", tuple((n, tuple(v)) for n, v in zip(PARAMETER_NAMES, values, strict=True)))
    for values in (
        ([-2.0], [-1.0], [-0.5], [1.0], [2.0], [0.5]),
        ([1.0], [1.0], [1.0], [1.0], [-1.0], [1.0]),
        ([-0.5], [2.0], [1.5], [-1.0], [0.25], [1.0, 0.5]),
        ([0.125], [-4.0], [1.0], [2.0], [-2.0], [0.25]),
        ([3.0], [0.5], [-1.0], [-0.5], [1.0], [0.5, 2.0]),
        ([1.0], [-1.0], [2.0], [0.5], [4.0], [0.0, 1.0]),
    )
)
SPLITTINGS = {"lotka-volterra": "splitting", "random-lotka-volterra": "stochastic-splitting"}
# Hypothesis strategies, built once for all tests (see `sepv.law.strategies`).
_POSITIVE_SYSTEMS, _STEP_SIGNS = st.sampled_from(POSITIVE_SYSTEMS), st.sampled_from([1.0, -1.0])
_STATES = st.tuples(*[st.tuples(st.sampled_from([1.0, 1.5]), st.integers(-10, 2))] * 3)
_NOISES = noises(least=1, most=3).filter(any)
# A step that moves each y_i by less than SHORT_MOVE·y_i is far from leaving the domain.
SHORT_MOVE = 0.125
_STEP_LENGTHS, _STEP_SHARES = st.sampled_from([2.0, 1.0, 0.5, 0.125]), st.sampled_from([0.5, 0.0625])


@st.composite
def lotka_volterra_steps(draw: st.DrawFn) -> Case:
    """Draw states with components from 2⁻¹⁰ to 6, and steps up to twice as long as an Euler step
    that reaches zero.
    """
    data = draw(_POSITIVE_SYSTEMS)
    y = tuple(size * 2.0**power for size, power in draw(_STATES))
    problem, state = as_given(data, "data"), np.array(y)
    c = problem.c.tolist()
    field = problem.structure(state) @ problem.gradient(state)
    rate = float(np.max(np.abs(field) / state))
    length = draw(_STEP_LENGTHS) / max(rate, 1.0)
    # After h, the first noise with c ≠ 0 gets the rest of the length, so that Δ has either sign.
    h = length * draw(_STEP_SHARES)
    first = next(j for j, v in enumerate(c) if v)
    rest = draw(_STEP_SIGNS) * length - h
    dW = tuple(rest / c[first] if j == first else 0.0 for j in range(len(c)))
    return Case(data, y, h, dW)


@st.composite
def species_steps(draw: st.DrawFn) -> Case:
    """Draw steps of Lotka-Volterra systems with any parameters and noises on the species;
    all components are positive.

    The drift and each noise move log y_i by up to 4.
    """
    c = draw(_NOISES)
    beta = tuple(draw(coefficients()) for _ in range(3))
    others = tuple((name, (draw(coefficients()),)) for name in ("a", "b", "d", "nu", "mu"))
    data = NamedProblem("random-lotka-volterra", (("beta", beta), ("noise", c), *others))
    y = tuple(size * 2.0**power for size, power in draw(_STATES))
    problem, state = as_given(data, "data"), np.array(y)
    length = draw(st.sampled_from([4.0, 2.0, 1.0, 0.25]))
    h = length * draw(_STEP_SHARES) / _rate(vector_field(problem, state), state)
    shares = [draw(st.sampled_from([1.0, -1.0, 0.5, -0.25])) for _ in c]
    rates = [_rate(v * noise_field(problem, j, state), state) for j, v in enumerate(c)]
    dW = tuple(length * share / rate for share, rate in zip(shares, rates, strict=True))
    return Case(data, y, h, dW)


def _ends_tamely(method: Scheme, problem: Problem, y: Array, h: float, dW: Array) -> bool:
    """True if a step of a splitting method ends in [2⁻⁶⁴, 2⁶⁴],
    so that other right methods do not overflow.
    """
    with np.errstate(all="ignore"):
        end = method.step(problem, y, h, dW)
    return bool(np.all((end > 2.0**-64) & (end < 2.0**64)))


def _rate(field: Array, y: Array) -> float:
    """Return the largest |field_i/y_i|, the rate of the logarithm of y_i, but at least 1."""
    return max(1.0, float(np.max(np.abs(field) / y)))


def check(scheme: Scheme, case: Case) -> Measurement:
    """Measure 1 if y1 is outside the domain or NaN, else 0. A refused step is skipped,
    because it returns no state.
    """
    problem, y, h, dW = case.build()
    if problem.domain is None:
        raise Skipped("the problem has no domain to leave")
    if not np.all(problem.domain(y)):  # simplified cases have zeros, which every scheme keeps
        raise Skipped("the state is outside of the domain")
    try:
        y1 = guarded(scheme).step(problem, y, h, dW)
    except StepFailure as error:
        raise Skipped("the scheme refuses the step") from error
    return Measurement(float(not np.all(problem.domain(y1))), 0.0, f"y1 = {y1.tolist()}")


def reaching(case: Case) -> Case | None:
    """Double a short step of a given Lotka-Volterra problem until an Euler step leaves the domain.

    The step may not move y by more than 2|y|. Methods that keep components positive use
    exponentials. If a step of a Lotka-Volterra problem by a splitting method ends outside of
    [2⁻⁶⁴, 2⁶⁴], the case is dropped, because another correct method might overflow or underflow.
    Steps of other problems are unchanged: no bound is known for these.
    """
    problem, y, h, dW = case.build()
    if problem.domain is None or not np.all(problem.domain(y)):
        return None
    name = case.problem.name if isinstance(case.problem, NamedProblem) else ""
    if name in SPLITTINGS and not _ends_tamely(by_name(SPLITTINGS[name]), problem, y, h, dW):
        return None
    if name != "lotka-volterra":
        return case
    with np.errstate(all="ignore"):
        z = problem.random_step(h, dW) * vector_field(problem, y)
        moved = float(np.max(np.abs(z) / y))
    n = 1.0
    while 0 < moved < SHORT_MOVE and n * moved <= 1:
        n *= 2
        if not np.all(problem.domain(y + n * z)):
            tame = _ends_tamely(by_name("splitting"), problem, y, n * h, n * dW)
            return replace(case, h=n * h, dW=tuple(n * w for w in case.dW)) if tame else case
    return case


law = searched(
    name="positivity",
    statement="y1 is inside the problem's domain; for Lotka-Volterra all components are positive",
    source="§1, [23]",
    unit="states outside",
    cost=0.6,
    steps=96,
    middle=Middle.MAP,
    cases=Cases(
        adapt=reaching,
        why="the problems have no domain to leave",
        instead={
            Systems.SINGLE: lotka_volterra_steps,
            Systems.NAMBU: lotka_volterra_steps,
            Systems.HAMILTONIANS: species_steps,
        },
        no_cases_of={Systems.SEVERAL: "no system of the class has a domain to leave"},
    ),
    check=check,
)


def test_positivity(scheme: Scheme, effort: Effort) -> None:
    require(law, scheme, effort)
