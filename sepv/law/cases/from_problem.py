"""Cases of one problem: a state near its initial state, inside its domain,
and a step inside the contraction radius.

For a problem given by functions, this radius is measured (`measured_radius`). `sepv.law.units`
chooses the problem's unit of time.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from hypothesis import assume
from hypothesis import strategies as st

from sepv import problems as named
from sepv.errors import UsageError
from sepv.law.cases.case import Case
from sepv.law.contraction import contraction_radius
from sepv.law.tolerance import CONTRACTION, pushes, slopes
from sepv.problem import (
    Array,
    Description,
    GivenProblem,
    NamedProblem,
    PolynomialSystem,
    Problem,
    hamiltonians_of,
    hessian,
    sample_states,
    structures_of,
)

# Names of problems whose H, B and ∇H the references compute in extended precision.
EXACT_NAMES = frozenset(named.PAPER)


# Components of states near an initial state a lie between a times these numbers, or up to AWAY_MAX
# above. Without an initial state they are at most COMPONENTS_MAX.
PERTURBED_RANGE, AWAY_MAX, COMPONENTS_MAX = (0.5, 1.5), 0.3, 2.0

# Strategies are made once: Hypothesis validates each new one, which costs as much as its draws.
_RANDOM_SIGNS = st.sampled_from([1.0, -1.0])
_PERTURBED, _AWAY = st.floats(*PERTURBED_RANGE), st.sampled_from([0.0, 0.1, AWAY_MAX])
# The distance of a state from the initial one as a share of the usual distance. A scheme that has
# the level of the initial state built in may correct only states near to this level.
_NEAR_START = st.sampled_from([1.0, 1.0, 2.0**-7, 2.0**-14, 2.0**-21])
# A quarter of the steps is short, because a scheme may be wrong for short steps alone.
_RANDOM_LENGTHS = st.sampled_from([1.0, 1.0, 1.0, 2.0**-10])
# Half of all factors of h and of ΔW_j are 1, because a quadrature error grows like a high power of
# the step's length.
_PARTS = st.one_of(st.just(1.0), st.floats(0, 1 - 2.0**-10).map(lambda x: 1 - x))
_RANDOM_SHARES = st.sampled_from([1.0, 0.5, 0.25, 2.0**-6])
# Components below 1e-6 become zero: states of extreme size have their own cases.
_COMPONENTS = st.one_of(
    st.sampled_from([1.0, 0.0, -1.0]),
    st.floats(-COMPONENTS_MAX, COMPONENTS_MAX).map(lambda x: x if abs(x) >= 1e-6 else 0.0),
)


def describe(problem: Problem, text: str = "") -> Description:
    """The problem's data if they agree with its functions and can be evaluated to many digits;
    else the problem.
    """
    data = problem.data
    known = isinstance(data, PolynomialSystem) or (data is not None and data.name in EXACT_NAMES)
    # Data contain no flows of parts of H and H_j, so a problem built from data would lack flows.
    lacks = isinstance(data, PolynomialSystem) and bool(problem.flows)
    whole = data is not None and known and not lacks and _agrees(problem, data)
    return data if whole and data is not None else GivenProblem(problem, text)


def _agrees(problem: Problem, data: PolynomialSystem | NamedProblem) -> bool:
    """True if data describe the problem's functions, one of which `dataclasses.replace` may have
    exchanged.
    """
    other = named.build(data)
    if other.dimension != problem.dimension or not np.array_equal(other.c, problem.c):
        return False
    for y in sample_states(problem):
        for key in ("hamiltonian", "gradient", "structure"):
            a, b = getattr(problem, key)(y), getattr(other, key)(y)
            if not np.allclose(a, b, rtol=1e-9, atol=1e-12):  # data of the same formula, or of another one
                return False
    return True


def of_case(value: Any) -> st.SearchStrategy[Case]:
    """Turn a value of a user's strategy into cases: a `Case` stays;
    a problem gives steps near its initial state.
    """
    if isinstance(value, Case):
        return st.just(value)
    if isinstance(value, Problem):
        return near(describe(value))
    if isinstance(value, (PolynomialSystem, NamedProblem, GivenProblem)):
        return near(value)
    raise UsageError(
        expected="a strategy of sepv.PolynomialSystem, sepv.Problem or sepv.verification.Case",
        received=f"one that gave {type(value).__name__}: {value!r:.80}",
        remedy="map it to one of these",
    )


@st.composite
def near(draw: st.DrawFn, description: Description) -> Case:
    """A state near the problem's initial state, inside its domain, and a step from it.

    If the problem has no initial state, the components of y lie between −2 and 2. The step is no
    longer than the contraction radius, which is derived from majorants for polynomial data and
    measured for functions.
    """
    problem = named.build(description)
    y = _state(draw, problem)
    radius = _radius(description, problem, y)
    assume(radius > 0)
    return draw(steps_within(description, y, radius * draw(_RANDOM_SHARES)))


def is_near(case: Case) -> bool:
    """True if a case has a state and a step as `near` draws them of its problem."""
    problem, y, h, dW = case.build()
    if problem.initial is None:
        inside = bool(np.max(np.abs(y)) <= COMPONENTS_MAX)
    else:
        a = np.asarray(problem.initial)
        sides = PERTURBED_RANGE[0] * a, PERTURBED_RANGE[1] * a
        inside = bool(np.all((np.minimum(*sides) <= y) & (y <= np.maximum(*sides) + AWAY_MAX)))
    length = abs(h) + float(np.abs(problem.c * dW).sum())
    return inside and _inside(problem, y) and 0 < h <= 1 and length <= _radius(case.problem, problem, case.y)


def _radius(description: Description, problem: Problem, y: tuple[float, ...]) -> float:
    if isinstance(description, PolynomialSystem):
        return min(contraction_radius(problem, np.array(y)), 4.0)
    if (
        isinstance(description, NamedProblem)
        and problem.longest_step is not None
        # A problem's longest step refers to its default parameters.
        and description == named.by_name(description.name).data
    ):
        return problem.longest_step
    return min(measured_radius(problem, np.array(y)), 4.0)


@st.composite
def steps_within(draw: st.DrawFn, data: Description, y: tuple[float, ...], radius: float) -> Case:
    """Draw a step from y with |h| + Σ|c_j ΔW_j| ≤ radius;
    |h| and each |c_j ΔW_j| get at most an equal share.
    """
    c = named.build(data).c
    length = radius * draw(_RANDOM_LENGTHS)
    share = length / (1 + np.count_nonzero(c))
    h = min(1.0, share * draw(_PARTS))
    dW = tuple(float(draw(_RANDOM_SIGNS) * draw(_PARTS) * (share / cj if cj else 1.0)) for cj in c)
    return Case(data, y, float(h), dW)


def start_of(description: Description) -> Case:
    """A short step of a problem from its first sample state,
    to test if a law applies to the problem.
    """
    problem = named.build(description)
    y = tuple(float(v) for v in next(iter(sample_states(problem))))
    return Case(description, y, 2.0**-6, (2.0**-6,) * problem.noises)


def _state(draw: st.DrawFn, problem: Problem) -> tuple[float, ...]:
    if problem.initial is None:
        y = tuple(draw(st.lists(_COMPONENTS, min_size=problem.dimension, max_size=problem.dimension)))
    else:
        share = draw(_NEAR_START)
        y = tuple(
            float(a) * (1 + share * (draw(_PERTURBED) - 1)) + share * draw(_AWAY)
            for a in np.asarray(problem.initial)
        )
        if not _inside(problem, np.array(y)):
            y = tuple(float(a) for a in np.asarray(problem.initial))
    assume(_inside(problem, np.array(y)))
    return y


def _inside(problem: Problem, y: Array) -> bool:
    return problem.domain is None or bool(np.all(problem.domain(y)))


# Balls about y with radii from (1 + |y|)2⁻¹ to (1 + |y|)2⁻⁵ are sampled; in a narrow domain smaller
# balls as well.
USUAL_BALLS, NARROW_BALLS = 5, 20


def measured_radius(problem: Problem, y: Array) -> float:
    """Half of an estimated contraction radius, from maxima of B,
    ∇H and their derivatives at some states around y.

    `sepv.law.contraction.contraction_radius` uses bounds instead of maxima. Maxima at some states
    are no bounds, because values may be larger elsewhere; the factor ½ is a heuristic allowance. If
    a scheme refuses a step inside this radius, the radius may be too large, so the step is reported
    as not solved and not as a violation.
    """
    rng = np.random.default_rng(0)
    d = problem.dimension
    directions = np.concatenate([np.eye(d), -np.eye(d), rng.uniform(-1, 1, (8, d))])
    best, size = 0.0, 1 + float(np.max(np.abs(y)))
    for halvings in range(1, NARROW_BALLS + 1):
        if best and halvings > USUAL_BALLS:
            break
        r = size / 2**halvings
        points = [y, *(y + r * e for e in directions)]
        if not all(_inside(problem, p) for p in points):
            continue
        parts = [sizes_at(problem, p) for p in points]
        B, g, dB, H = (np.max([part[k] for part in parts], axis=0) for k in range(4))
        if not all(np.all(np.isfinite(part)) for part in (B, g, dB, H)):
            continue
        field = float(np.max(np.maximum(B @ g, pushes(problem))))
        slope = float(np.max(np.sum(np.einsum("ijk,j->ik", dB, g) + B @ H, axis=1)))
        radius = 0.5 * min(r / field if field else np.inf, CONTRACTION / slope if slope else np.inf)
        best = max(best, radius)
    return best


def sizes_at(problem: Problem, y: Array) -> tuple[Array, Array, Array, Array]:
    """|B|, |∇H|, |∂B/∂y| and |∂²H/∂y²| at y; the last two by differences if the problem does not
    give them.
    """
    with np.errstate(all="ignore"):
        dB = slopes(problem.structure, problem.structure_derivative, y)
        H = slopes(problem.gradient, problem.hessian, y)
        B = np.max([np.abs(G(y)) for G in structures_of(problem)], axis=0)
        first, *others = hamiltonians_of(problem)
        g = np.max([np.abs(F.gradient(y)) for F in (first, *others) if F.gradient], axis=0)
        H = np.max([np.abs(H), *(np.abs(hessian(problem, y, F)) for F in others)], axis=0)
        return B, g, np.abs(dB), np.abs(H)
