"""A step stays in the problem's domain: the positive octant for Lotka-Volterra, which its exact flow never leaves.

ẏ_i = y_i r_i(y) keeps the sign of every component, for stochastic systems of this form too. A scheme with this property
needs no rejected steps: the domain-keeping integrators that Cohen and Dujardin (2014), §1, [23], point to.
"""

from __future__ import annotations

import numpy as np
from hypothesis import assume
from hypothesis import strategies as st

from sepv.errors import Skipped, StepFailure
from sepv.problem import Array, NamedProblem, Systems, noise_field, vector_field
from sepv.problems.shown_to_schemes import as_given
from sepv.schemes import Scheme, by_name, guarded, splitting
from sepv.verification import Case, Cases, Effort, Measurement, require, searched
from sepv.verification._cases.of_law import only
from sepv.verification.strategies import coefficients, noises

NAMES = ("a", "b", "d", "nu", "mu", "noise")
# Few systems, with all signs, and many steps, because recording a system takes as long as a dozen steps. The first is
# the paper's.
SYSTEMS = tuple(
    NamedProblem("lotka-volterra", tuple((n, tuple(v)) for n, v in zip(NAMES, values, strict=True)))
    for values in (
        ([-2.0], [-1.0], [-0.5], [1.0], [2.0], [0.5]),
        ([1.0], [1.0], [1.0], [1.0], [-1.0], [1.0]),
        ([-0.5], [2.0], [1.5], [-1.0], [0.25], [1.0, 0.5]),
        ([0.125], [-4.0], [1.0], [2.0], [-2.0], [0.25]),
        ([3.0], [0.5], [-1.0], [-0.5], [1.0], [0.5, 2.0]),
        ([1.0], [-1.0], [2.0], [0.5], [4.0], [0.0, 1.0]),
    )
)
# Strategies are built once (`sepv.verification.strategies`).
_SYSTEMS, _SIGNS = st.sampled_from(SYSTEMS), st.sampled_from([1.0, -1.0])
_STATES = st.tuples(*[st.tuples(st.sampled_from([1.0, 1.5]), st.integers(-10, 2))] * 3)
_NOISES = noises(least=1, most=3).filter(any)
_LENGTHS, _SHARES = st.sampled_from([2.0, 1.0, 0.5, 0.125]), st.sampled_from([0.5, 0.0625])


@st.composite
def lotka_volterra_steps(draw: st.DrawFn) -> Case:
    """States from 2⁻¹⁰ to 6, and steps up to twice the length after which a tangent reaches zero.

    Methods that keep the octant use exponentials of such steps. Cases where those of the splitting leave 2^±64 are left
    out: another right method might overflow or underflow there.
    """
    data = draw(_SYSTEMS)
    y = tuple(size * 2.0**power for size, power in draw(_STATES))
    problem, state = as_given(data, "data"), np.array(y)
    c = problem.c.tolist()
    field = problem.structure(state) @ problem.gradient(state)
    rate = float(np.max(np.abs(field) / state))
    length = draw(_LENGTHS) / max(rate, 1.0)
    # h first, the rest in the first noise with c ≠ 0: Δ of either sign.
    h = length * draw(_SHARES)
    first = next(j for j, v in enumerate(c) if v)
    rest = draw(_SIGNS) * length - h
    dW = tuple(rest / c[first] if j == first else 0.0 for j in range(len(c)))
    with np.errstate(all="ignore"):
        end = splitting.step(problem, state, h, np.array(dW))
    assume(bool(np.all((end > 2.0**-64) & (end < 2.0**64))))
    return Case(data, y, h, dW)


@st.composite
def species_steps(draw: st.DrawFn) -> Case:
    """Lotka-Volterra with any parameters and noises at its species; all components positive.

    Steps move a logarithm by up to 4 with each of the fields. Large exponentials are left out as above.
    """
    c = draw(_NOISES)
    beta = tuple(draw(coefficients()) for _ in range(3))
    others = tuple((name, (draw(coefficients()),)) for name in ("a", "b", "d", "nu", "mu"))
    data = NamedProblem("random-lotka-volterra", (("beta", beta), ("noise", c), *others))
    y = tuple(size * 2.0**power for size, power in draw(_STATES))
    problem, state = as_given(data, "data"), np.array(y)
    length = draw(st.sampled_from([4.0, 2.0, 1.0, 0.25]))
    h = length * draw(_SHARES) / _rate(vector_field(problem, state), state)
    shares = [draw(st.sampled_from([1.0, -1.0, 0.5, -0.25])) for _ in c]
    rates = [_rate(v * noise_field(problem, j, state), state) for j, v in enumerate(c)]
    dW = tuple(length * share / rate for share, rate in zip(shares, rates, strict=True))
    with np.errstate(all="ignore"):
        end = by_name("stochastic-splitting").step(problem, state, h, np.array(dW))
    assume(bool(np.all((end > 2.0**-64) & (end < 2.0**64))))
    return Case(data, y, h, dW)


def _rate(field: Array, y: Array) -> float:
    """The rate of the logarithms, at least 1."""
    return max(1.0, float(np.max(np.abs(field) / y)))


def check(scheme: Scheme, case: Case) -> Measurement:
    """Measure 1 for a state outside the domain or NaN, else 0. A refused step leaves no state, and is not measured."""
    problem, y, h, dW = case.build()
    if problem.domain is None:
        raise Skipped("the problem has no domain to leave")
    if not np.all(problem.domain(y)):  # the shrinker reaches zeros, from which no scheme comes back
        raise Skipped("the state is outside of the domain")
    try:
        y1 = guarded(scheme).step(problem, y, h, dW)
    except StepFailure as error:
        raise Skipped("the scheme refuses the step") from error
    return Measurement(float(not np.all(problem.domain(y1))), 0.0, f"y1 = {y1.tolist()}")


_NO_DOMAIN = "no system of the class has a domain to leave"
law = searched(
    name="positivity",
    statement="y1 is inside the problem's domain: all components positive for Lotka-Volterra",
    source="§1, [23]",
    unit="states outside",
    cost=0.6,
    steps=96,
    cases=Cases(
        adapt=only(lambda p: p.domain is not None),
        why="the problems have no domain to leave",
        instead={
            Systems.SINGLE: lotka_volterra_steps,
            Systems.NAMBU: lotka_volterra_steps,
            Systems.HAMILTONIANS: species_steps,
        },
        not_of={Systems.SEVERAL: _NO_DOMAIN},
    ),
    check=check,
)


def test_positivity(scheme: Scheme, effort: Effort) -> None:
    require(law, scheme, effort)
