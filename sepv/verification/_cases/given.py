"""Cases from problems that a user names: what a scheme is for is what it is judged on.

An item is a problem (by name, ``module:attribute``, file, record or data), a family of
`sepv.verification._cases.families`, or a Hypothesis strategy of problems, of their data or of whole cases.
Each law takes of it what it speaks of, changes the noise where it is about the noise, and says why where it
can say nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from hypothesis import HealthCheck, Phase, Verbosity, assume, given, settings
from hypothesis import seed as hypothesis_seed
from hypothesis import strategies as st

from sepv import problems as named
from sepv._arguments import did_you_mean
from sepv.errors import Skipped, UsageError
from sepv.problem import (
    Array,
    Description,
    GivenProblem,
    HamiltoniansProblem,
    NamedProblem,
    PolynomialSystem,
    Problem,
    StructuresProblem,
    Systems,
    is_poisson,
)
from sepv.problem._checks import sample_states
from sepv.problem._hamiltonians import is_several, noise_hessian
from sepv.problem._poisson import derivative_of_structure
from sepv.problems._polynomial_system import drift_of_energy
from sepv.schemes import load_problem
from sepv.schemes._load import load_object
from sepv.verification._cases.case import Case, with_noise
from sepv.verification._cases.families import FAMILIES
from sepv.verification._contraction import contraction_radius
from sepv.verification._tolerance import slopes
from sepv.verification.strategies import CONTRACTION, components, halved, in_the_mean, steps_within

# Of the references: names whose H, B and ∇H exist in extended precision.
EXACT_NAMES = frozenset(named.PAPER)


@dataclass(frozen=True)
class Item:
    """One thing that a scheme is for.

    Attributes
    ----------
    text : str
        How a user named it, and how a command names it again; empty where it was handed over as an object.
    values : strategy of Case, Problem or their data
    problems : tuple of Problem
        With an initial state, for the laws about many steps.
    fixed : Problem, optional
        Where there is one problem only, so that what does not apply is known without drawing.
    """

    text: str
    values: st.SearchStrategy[Any]
    problems: tuple[Problem, ...] = ()
    fixed: Problem | None = None


def items(asked: Iterable[Any] | Any) -> tuple[Item, ...]:
    """What a user asks for, read once.

    Raises
    ------
    UsageError
        For anything that is no problem, family or strategy.
    """
    if isinstance(asked, (str, Problem, st.SearchStrategy, PolynomialSystem, NamedProblem, Item)):
        asked = (asked,)
    try:
        listed = tuple(asked)
    except TypeError:
        listed = (asked,)
    if not listed:
        raise UsageError(
            expected="problems, one at least", received="none", remedy="leave it out for every problem"
        )
    return tuple(_item(entry) for entry in listed)


def _item(asked: Any) -> Item:
    if isinstance(asked, Item):
        return asked
    text = asked if isinstance(asked, str) else ""
    family = text.replace("_", "-")
    if family in FAMILIES:
        _, strategy, names = FAMILIES[Systems(family)]
        return Item(text, strategy(), tuple(named.by_name(name) for name in names))
    value = load_object(text) if ":" in text and not text.endswith(".json") else asked
    if not isinstance(value, (st.SearchStrategy, Problem)) and callable(value) and _is_strategy(value):
        value = value()
    if isinstance(value, st.SearchStrategy):
        return Item(text, value)
    try:
        problem = load_problem(asked)
    except UsageError as error:
        known = [*map(str, FAMILIES), *named.PAPER, *named.EXTENSIONS, *named.SEVERAL, *named.HAMILTONIANS]
        raise UsageError(
            expected=f"{error.expected}; or a family, one of {', '.join(FAMILIES)}; or a Hypothesis strategy of them",
            received=did_you_mean(text, known) if text and ":" not in text else error.received,
            remedy=error.remedy,
        ) from error
    own = (problem,) if problem.initial is not None else ()
    return Item(text, st.just(describe(problem, text)), own, problem)


def _is_strategy(value: Any) -> bool:
    """Whether a function is one that Hypothesis made: its call gives a strategy."""
    return getattr(value, "__module__", "").startswith("hypothesis") or bool(
        getattr(value, "is_hypothesis_strategy_function", False)
    )


def describe(problem: Problem, text: str = "") -> Description:
    """Its data, where they say the same as its functions and the references know them; else the problem itself."""
    data = problem.data
    known = isinstance(data, PolynomialSystem) or (data is not None and data.name in EXACT_NAMES)
    # Flows of parts of H and H_j are no data: what is made of the data again would lack them.
    lacks = isinstance(data, PolynomialSystem) and bool(problem.flows)
    whole = data is not None and known and not lacks and _agrees(problem, data)
    return data if whole and data is not None else GivenProblem(problem, text)


def _agrees(problem: Problem, data: PolynomialSystem | NamedProblem) -> bool:
    """A record that was changed by `dataclasses.replace` may still carry the data of what it was."""
    other = named.build(data)
    if other.dimension != problem.dimension or not np.array_equal(other.c, problem.c):
        return False
    for y in sample_states(problem):
        for key in ("hamiltonian", "gradient", "structure"):
            a, b = getattr(problem, key)(y), getattr(other, key)(y)
            if not np.allclose(a, b, rtol=1e-9, atol=1e-12):  # the same formula, or another
                return False
    return True


def of_case(value: Any) -> st.SearchStrategy[Case]:
    """The steps of whatever a strategy gave: a whole case as it is, a problem near its initial state."""
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

    Without an initial state: components in ±2. The step is at most as long as a contraction allows: derived from
    majorants for polynomial data, measured for functions.
    """
    problem = named.build(description)
    y = _state(draw, problem)
    if isinstance(description, PolynomialSystem):
        radius = min(contraction_radius(problem, np.array(y)), 4.0)
    elif (
        isinstance(description, NamedProblem)
        and problem.longest_step is not None
        and _as_by_name(description)
    ):
        radius = problem.longest_step
    else:
        radius = min(measured_radius(problem, np.array(y)), 4.0)
    assume(radius > 0)
    return draw(steps_within(description, y, radius * draw(st.sampled_from([1.0, 0.5, 0.25, 2.0**-6]))))


def _as_by_name(description: NamedProblem) -> bool:
    """With the default parameters, of which a problem's longest step speaks."""
    return description == named.by_name(description.name).data


def _state(draw: st.DrawFn, problem: Problem) -> tuple[float, ...]:
    if problem.initial is None:
        y = tuple(draw(st.lists(components(), min_size=problem.dimension, max_size=problem.dimension)))
    else:
        y = tuple(
            float(a) * draw(st.floats(0.5, 1.5)) + draw(st.sampled_from([0.0, 0.1, 0.3]))
            for a in np.asarray(problem.initial)
        )
        if not _inside(problem, np.array(y)):
            y = tuple(float(a) for a in np.asarray(problem.initial))
    assume(_inside(problem, np.array(y)))
    return y


def _inside(problem: Problem, y: Array) -> bool:
    return problem.domain is None or bool(np.all(problem.domain(y)))


# Balls of radius 2⁻¹ to 2⁻⁵ of a state are looked at; in a narrow domain smaller ones, until one lies inside.
USUAL, NARROWEST = 5, 20


def measured_radius(problem: Problem, y: Array) -> float:
    """As `sepv.verification._contraction.contraction_radius`, with maxima over some states of the ball in
    place of majorants, halved.

    The maxima are no bounds: between the states looked at the slopes may be larger. The half is a heuristic for that.
    A step that is refused inside it says more of the radius than of the scheme, and is reported as not solved.
    """
    rng = np.random.default_rng(0)
    d = problem.dimension
    directions = np.concatenate([np.eye(d), -np.eye(d), rng.uniform(-1, 1, (8, d))])
    best, size = 0.0, 1 + float(np.max(np.abs(y)))
    for halvings in range(1, NARROWEST + 1):
        if best and halvings > USUAL:
            break
        r = size / 2**halvings
        points = [y, *(y + r * e for e in directions)]
        if not all(_inside(problem, p) for p in points):
            continue
        parts = [_sizes(problem, p) for p in points]
        B, g, dB, H = (np.max([part[k] for part in parts], axis=0) for k in range(4))
        if not all(np.all(np.isfinite(part)) for part in (B, g, dB, H)):
            continue
        field = float(np.max(B @ g))
        slope = float(np.max(np.sum(np.einsum("ijk,j->ik", dB, g) + B @ H, axis=1)))
        radius = 0.5 * min(r / field if field else np.inf, CONTRACTION / slope if slope else np.inf)
        best = max(best, radius)
    return best


def _sizes(problem: Problem, y: Array) -> tuple[Array, Array, Array, Array]:
    """|B|, |∇H|, |∂B/∂y| and |∂²H/∂y²| at y, the last two by differences where they are not given."""
    with np.errstate(all="ignore"):
        dB = slopes(problem.structure, problem.structure_derivative, y)
        H = slopes(problem.gradient, problem.hessian, y)
        structures = [problem.structure, *getattr(problem, "noise_structures", ())]
        B = np.max([np.abs(G(y)) for G in structures], axis=0)
        g = np.abs(problem.gradient(y))
        if isinstance(problem, HamiltoniansProblem):
            g = np.max([g, *(np.abs(f(y)) for f in problem.noise_gradients)], axis=0)
            curved = [np.abs(noise_hessian(problem, j, y)) for j in range(problem.noises)]
            H = np.max([np.abs(H), *curved], axis=0)
        return B, g, np.abs(dB), np.abs(H)


# What a law makes of a case, or None where it says nothing about it.
Turn = Callable[[Case], Case | None]


def _as_it_is(case: Case) -> Case:
    return case


def _has_casimirs(case: Case) -> Case | None:
    problem = named.build(case.problem)
    return case if len(problem.casimirs) or len(problem.linear_casimirs) else None


def _no_step(case: Case) -> Case | None:
    """h = c_1 2^-n and ΔW_1 = −2^-n: Δ = 0 exactly, whatever c_1 is, the other increments being zero."""
    problem = named.build(case.problem)
    if is_several(problem):  # no noise cancels h
        return replace(case, h=0.0, dW=(0.0,) * problem.noises)
    c = problem.c
    if not c.size or not c[0]:
        return None
    unit = 2.0 ** np.floor(np.log2(max(abs(case.h), 2.0**-30)))
    return replace(case, h=float(c[0] * unit), dW=(-float(unit), *(0.0,) * (c.size - 1)))


def _quadratic(case: Case) -> Case | None:
    return case if named.build(case.problem).degree in (1, 2) and not _functions(case) else None


def _functions(case: Case) -> bool:
    return isinstance(case.problem, GivenProblem)


def _constant_or_silent(case: Case) -> Case | None:
    """B constant: as it is. Else the same system without noise, which the law compares with the deterministic step."""
    if _functions(case):
        return None
    problem = named.build(case.problem)
    if is_several(problem):
        return None
    rng = np.random.default_rng(1)
    states = np.array(case.y)[:, None] * (1 + 0.25 * rng.uniform(-1, 1, (len(case.y), 4)))
    B = problem.structure(states)
    if bool(np.all(B[..., :1] == B)) and problem.c.any():
        return case
    return with_noise(case, (0.0,) * max(1, problem.noises), (case.dW or (case.h,)))


def _several_noises(case: Case) -> Case | None:
    """Two noises at least; a second one, half of the first, where there is one only."""
    c = tuple(float(v) for v in named.build(case.problem).c)
    if len(c) > 1 or is_several(named.build(case.problem)):
        return case if len(c) > 1 else None
    first = c[0] if c and c[0] else 1.0
    share = case.dW[0] if case.dW and c[0] else case.h
    return with_noise(case, (first, first / 2), (share / 2, share))


def _noisy(case: Case) -> Case | None:
    c = named.build(case.problem).c
    return case if c.size and c.any() else None


def _data(case: Case) -> Case | None:
    return None if _functions(case) else case


def _nambu(case: Case) -> Case | None:
    return case if named.build(case.problem).nambu is not None and not _functions(case) else None


def _poisson(case: Case) -> Case | None:
    problem = named.build(case.problem)
    if isinstance(problem, StructuresProblem):
        return None
    return halved(case) if is_poisson(problem, np.array(case.y)) else None


def _constant(case: Case) -> Case | None:
    problem = named.build(case.problem)
    if isinstance(problem, StructuresProblem):
        return None
    return None if np.any(derivative_of_structure(problem, np.array(case.y))) else halved(case)


def _bounded(case: Case) -> Case | None:
    return case if named.build(case.problem).domain is not None else None


def _steady_drift(case: Case) -> Case | None:
    """Of a system whose E[H_0] changes at a constant rate, a step over which all likely increments have a solution."""
    data = case.problem
    if isinstance(data, GivenProblem) and isinstance(data.problem.data, PolynomialSystem):
        data = data.problem.data
    if not isinstance(data, PolynomialSystem) or not isinstance(named.build(data), HamiltoniansProblem):
        return None
    return None if drift_of_energy(data) is None else in_the_mean(replace(case, problem=data))


def _of_one_hamiltonian(turn: Turn) -> Turn:
    """The turn for laws that say nothing of several Hamiltonians."""

    def turned(case: Case) -> Case | None:
        return None if isinstance(named.build(case.problem), HamiltoniansProblem) else turn(case)

    return turned


_NEEDS_DATA = "it compares with a solution in extended precision, which needs the problem as data"
# law: (what it makes of a case, why it says nothing where that is None)
TURNS: dict[str, tuple[Turn, str]] = {
    "casimir": (_has_casimirs, "the problems name no quadratic or linear Casimir"),
    "any-casimir": (_nambu, "the problems have no Casimir and factor in dimension 3 as data"),
    "poisson-map": (_poisson, "B of the problems does not satisfy Jacobi's identity"),
    "symplecticity": (_constant, "B of the problems is not constant"),
    "positivity": (_bounded, "the problems have no domain to leave"),
    "energy-drift": (
        _steady_drift,
        "the generator makes no constant of H_0, or the problems are not given as data",
    ),
    "identity": (_no_step, "the problems have no noise that could cancel h"),
    "midpoint": (_quadratic, "the problems have no quadratic H given as data"),
    "reduction": (_constant_or_silent, _NEEDS_DATA),
    "noise-sum": (_several_noises, "the problems have one structure for each noise"),
    "symmetry": (_noisy, "the problems have no noise"),
    "random-step": (_noisy, "the problems have no noise"),
    "reference": (_data, _NEEDS_DATA),
}
_NOT_KEPT = "with several Hamiltonians that do not commute with H_0 the exact flow does not keep H_0"
_NO_STEP = "with several Hamiltonians there is no random step Δ"
_OTHER = "it is about the equation of (2.1), which several Hamiltonians do not have"
# What laws cannot say of several Hamiltonians {H_0, H_j} ≠ 0.
NOT_OF_HAMILTONIANS = {
    "energy": _NOT_KEPT,
    "rounding": _NOT_KEPT,
    "random-step": _NO_STEP,
    "midpoint": _OTHER,
    "reduction": _OTHER,
    "reference": _OTHER,
    "any-casimir": "its cases have one Hamiltonian: see casimir, and poisson-map",
}
# Laws whose cases are systems of their own.
OUTSIDE = {
    "expansion": "it starts at y = 0 with systems made for that; the local laws measure the order on these problems",
    "equivariance": "a change of variables leads out of the problems that the scheme is for",
}


def may_ask(scheme: Any, problem: Problem, states: Array) -> bool:
    """Whether a law may ask about states (d, ...) that it made from one of the scheme's own.

    Inside the problem's domain, where one is stated. Without one every state will do, unless a user said what the
    scheme is for: their problems may mean positive states, or a ball, and only what was drawn is sure to be one.
    """
    if problem.domain is not None:
        return bool(np.all(problem.domain(states)))
    return not scheme.problems


NO_START = "the problems have no initial state: name one that has, or give initial= when making it"


def cases_for(law: str, scheme: Any) -> st.SearchStrategy[Case] | str | None:
    """Where a law draws the cases of a scheme that is for something special: a strategy, or why there is none.

    None where the scheme is for all systems of its class.
    """
    own = sources(scheme)
    if not own:
        return None
    if law in OUTSIDE:
        return OUTSIDE[law]
    turn, reason = TURNS.get(law, (_as_it_is, ""))
    why = NOT_OF_HAMILTONIANS.get(law, "") if law != "any-casimir" else ""
    if why:
        if all(isinstance(item.fixed, HamiltoniansProblem) for item in own):
            return why
        if any(item.fixed is None or isinstance(item.fixed, HamiltoniansProblem) for item in own):
            turn = _of_one_hamiltonian(turn)
    usable = [item for item in own if (_meets if item.fixed is None else _some)(item, turn)]
    if not usable:
        return why or reason
    drawn: st.SearchStrategy[Any] = st.one_of(*(item.values.flatmap(of_case) for item in usable))
    if turn is not _as_it_is:
        drawn = drawn.map(turn).filter(lambda case: case is not None)
    return drawn


class _Met(Exception):
    """Raised inside a look at a family: a law says something about this member."""


def _meets(item: Item, turn: Turn) -> bool:
    """Whether a law says something about one of thirty members of a family; a search would ask for hundreds."""
    if turn is _as_it_is:
        return True

    def look(case: Case) -> None:
        if turn(case) is not None:
            raise _Met

    members = settings(
        max_examples=30, database=None, deadline=None, phases=(Phase.generate,), verbosity=Verbosity.quiet,
        suppress_health_check=list(HealthCheck),
    )(given(item.values.flatmap(of_case))(look))  # fmt: skip
    try:
        hypothesis_seed(0)(members)()
    except _Met:
        return True
    return False


def _some(item: Item, turn: Turn) -> bool:
    """Whether a law says something about the one problem of an item: asked of a step at its initial state."""
    assert item.fixed is not None
    problem = item.fixed
    y = tuple(float(v) for v in next(iter(sample_states(problem))))
    case = Case(describe(problem, item.text), y, 2.0**-6, (2.0**-6,) * problem.noises)
    return turn(case) is not None


def sources(scheme: Any) -> tuple[Item, ...]:
    """What a scheme is for: the problems it was given, or the family that it names; empty for a whole class."""
    if scheme.problems:
        return items(scheme.problems)
    return items(scheme.systems) if scheme.systems in FAMILIES else ()


def problems_of(scheme: Any) -> tuple[Problem, ...] | None:
    """Its problems with an initial state, for laws about many steps; None where it is for a whole class.

    Raises
    ------
    Skipped
        Where none of them has one.
    """
    own = sources(scheme)
    if not own:
        return None
    found = tuple(problem for item in own for problem in item.problems)
    if not found:
        raise Skipped(NO_START)
    return found


def reach(problem: Problem) -> float:
    """A time of which steps of an eighth are as long, against the slope of f, as for the paper's problems.

    There |Δ| L stays below about 1.2 for increments of two standard deviations, L the slope of f = B∇H: T is the
    largest power of two, at most 1, for which L(h + 2√h Σc_j) ≤ 1.25 with h = T/8. A heuristic: nothing that a law
    judges depends on it, but whether all steps are solved.
    """
    y = np.array(problem.initial, dtype=np.float64)
    B, g, dB, H = _sizes(problem, y)
    L = float(np.max(np.sum(np.einsum("ijk,j->ik", dB, g) + B @ H, axis=1)))
    T = 1.0
    while T > 2.0**-20 and L * (T / 8 + 2 * np.sqrt(T / 8) * float(problem.c.sum())) > 1.25:
        T /= 2
    return T
