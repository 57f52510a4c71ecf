"""A step changes a function I with LI = σ − λI as the exact flow does, or in the mean,
where L is the generator.

If no noise moves I, then I(y1) = e^(−λh) I(y0) + σ(1 − e^(−λh))/λ on each path, and I(y1) = I(y0)
for σ = λ = 0. Otherwise this is true of the mean E[I(y1)], which a quadrature over the increments
gives (`sepv.properties._trace_formula`). The law is about the functions that a problem states
(`Problem.invariants`). Its parts are about those that the classes of systems state, H and Casimirs
(`sepv.properties._stated_functions`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import partial
from random import Random
from zlib import crc32

import numpy as np
from sepv.properties._decay import LARGEST_DECAY
from sepv.properties._decay import residual as damped_residual
from sepv.properties._stated_functions import (
    StatedFunction,
    by_problem,
    casimirs,
    energies,
    polynomial_data,
    with_noises,
)
from sepv.properties._trace_formula import Quantity, measured, nodes, short
from sepv.reference.arithmetic import context
from sepv.reference.given_functions import in_many_digits

from sepv.errors import Skipped, Unasked
from sepv.law import Case, Cases, Effort, Measurement, require, searched, step_residual
from sepv.law.cases import random_parts as some
from sepv.law.cases import strata
from sepv.law.cases.clipped import clips
from sepv.law.cases.of_law import Adapt
from sepv.law.cases.random_cases import placed
from sepv.law.cases.users_problems import sources
from sepv.law.tolerance import majorant_over
from sepv.problem import (
    Array,
    Function,
    PolynomialSystem,
    Problem,
    Systems,
    damping_of,
    energy_changes,
    same_structure,
    without_friction,
)
from sepv.problems import build, planes
from sepv.record import EPS, TINY, poly
from sepv.schemes import Scheme, ask

MEAN_DIGITS = 40
# The most steps of a quadrature for a scheme that takes one state a call, and the number above
# which noises are left out. A mean has two rules, and the law about a hundred means: 6,400 steps,
# or eight minutes for steps of 76 ms, where a law may take ten.
MEAN_MAX_STEPS, MEAN_MAX_NOISES = 1000, 32
# The number of fixed systems of dimension 4 and 5 on which each scheme for (1.1) is tested, with
# every seed.
FIXED_SYSTEMS = 12
NONE_STATED = "no problem states a function: Problem(…, invariants={'momentum': lambda y: …}), then -p NAME"
# Schemes for these classes may rely on ∇C = 2Ay or b of their Casimirs.
OF_DEGREE_TWO = (Systems.DAMPED, Systems.ADDITIVE)

FRICTION = {without_friction: "friction and noise change H and Casimirs at no constant rate: see equilibrium"}

Functions = Callable[[Case], list[StatedFunction]]


def about(functions: Functions) -> Adapt:
    """Keep a case with such functions. Half of the cases become those of a mean if noise moves a
    function.

    Cases of a mean have dW = 0 and a step as long as `short` allows.
    """

    def adapt(case: Case) -> Case | None:
        found = functions(case)
        if not found or abs(damping_of(build(case.problem)) * case.h) > LARGEST_DECAY:
            return None
        moved = [bool(I.relation.moved) for I in found]
        return short(case) if all(moved) or (any(moved) and not case.dW[0] > 0) else case

    return adapt


def check(scheme: Scheme, case: Case) -> Measurement:
    """Measure the functions that the problem states."""
    case = affordable(scheme, case)
    return furthest(scheme, case, by_problem(case))


def check_energy(scheme: Scheme, case: Case) -> Measurement:
    """Measure the change of H in a step, or that of its mean."""
    case = affordable(scheme, case)
    return furthest(scheme, case, energies(case))


def check_casimir(scheme: Scheme, case: Case) -> Measurement:
    """Measure the changes of Casimirs in a step, or those of their means."""
    case = affordable(scheme, case)
    found = casimirs(case)
    kept = not any(I.relation.decay or I.relation.moved for I in found)
    if kept and scheme.systems in OF_DEGREE_TWO:
        raise Unasked(
            "without friction and additive noise the scheme's class states no other Casimirs: see casimir"
        )
    return furthest(scheme, case, found)


def furthest(scheme: Scheme, case: Case, functions: list[StatedFunction]) -> Measurement:
    """Measure the function I whose value, or mean, is furthest from the right one,
    relative to its bound.
    """
    problem, y, h, dW = case.build()
    measurements = []
    if paths := [I for I in functions if not I.relation.moved]:
        y1 = ask(scheme, problem, y, h, dW)
        r = residual(scheme, problem, y, y1, h, dW)
        measurements = [on_path(problem, I, y, y1, h, r) for I in paths]
    if not dW.any() and h > 0:
        measurements += [in_mean(scheme, case, I) for I in functions if I.relation.moved]
    if not measurements:
        raise Skipped("noise moves every stated function, and the case has increments or h ≤ 0")
    return max(measurements, key=lambda m: m.ratio)


def affordable(scheme: Scheme, case: Case) -> Case:
    """Leave noises out of a mean, but not the last two,
    until a rule has at most MEAN_MAX_NOISES steps of a scheme that takes single states.

    The noises that are left are neighbours, from one that depends on y: different cases ask
    different noises. For 20 noises the two rules of a mean have 160 steps, and 33,600 with Lévy
    areas.
    """
    m = len(case.dW)
    if (
        scheme.batched
        or not m
        or any(case.dW)
        or nodes(scheme, build(case.problem), case.h) <= MEAN_MAX_NOISES
    ):
        return case
    first = crc32(repr(case.y).encode()) % m
    for count in range(m - 1, 1, -1):
        fewer = with_noises(case, [(first + j) % m for j in range(count)])
        if fewer is not None and (
            count == 2 or nodes(scheme, build(fewer.problem), case.h) <= MEAN_MAX_NOISES
        ):
            return fewer
    return case


def residual(scheme: Scheme, problem: Problem, y: Array, y1: Array, h: float, dW: Array) -> Array:
    """Twice a bound (d,) of the step's residual: a step may evaluate an averaged ∇I as well as ∇H.

    Twice the residual also covers LI, which is σ − λI up to a few roundings of its terms
    (`sepv.problem`).
    """
    if damping_of(problem):
        return 2 * damped_residual(scheme, problem, y, y1, h, dW)
    return 2 * step_residual(problem, y, y1, h, dW, scheme)


def on_path(
    problem: Problem, function: StatedFunction, y: Array, y1: Array, h: float, r: Array
) -> Measurement:
    """Measure I(y1) − e^(−λh) I(y0) − σ(1 − e^(−λh))/λ with MEAN_DIGITS digits;
    the bound is Σ_i |∂_iI| r_i on the segment.

    Damping moves the state by the factor e^(−γh/2) before and after the step that has the residual
    r, so the box of the segment is enlarged by the largest such change.
    """
    name, I, slope, curve, known = function
    ctx, exact = context(MEAN_DIGITS), in_many_digits(I, problem.dimension, MEAN_DIGITS)
    if exact is None:
        raise Skipped(f"{name} cannot be recorded")
    before, after = (exact([ctx.mpf(float(v)) for v in state]) for state in (y, y1))
    sigma, decay = ctx.mpf(known.sigma), ctx.mpf(known.decay)
    grown = -ctx.expm1(-decay * h) / decay if decay else ctx.mpf(h)
    expected = before + (sigma - decay * before) * grown
    beyond = np.expm1(0.5 * abs(damping_of(problem) * h)) * max(np.max(np.abs(v)) for v in (y, y1))
    M = majorant_over(slope, curve, (y, y1), beyond, I)
    # The roundings of σ and λ to binary64.
    bound = float(M @ r) + EPS * abs(float((sigma - decay * before) * grown)) + TINY
    unit = unit_of(slope, y, y1)
    detail = (
        f"I = {name}: I(y1) = {float(after)!r}, expected {float(expected)!r}, I(y0) = {float(before)!r}, "
        f"{known.words}; y1 = {y1.tolist()}"
    )
    return Measurement(abs(float(after - expected)) / unit, bound / unit, detail)


def in_mean(scheme: Scheme, case: Case, function: StatedFunction) -> Measurement:
    """Measure the mean of I by a quadrature, as far as its number of steps is affordable.

    A step may leave the box of y0 and y1, because noises of parts of it may cancel. No state of a
    step is taken to be further from y0 than twice the farthest y1 of the rule.

    Raises
    ------
    Skipped
        If the scheme clips its increments, and the mean would need more of them than E[ζ²]: if λ ≠
        0, or if the drift moves I.
    """
    problem, y, h, _ = case.build()
    name, known, own = function.name, function.relation, scheme
    if not clips(scheme, [replace(case, dW=(1.0,) * problem.noises)]):
        own = replace(scheme, truncation=None)  # its increments may then be those of a Wiener process
    elif known.decay or known.drifts:
        raise Skipped(
            "with clipped increments the mean of I is known only if LI is a constant of the noise alone"
        )
    if not scheme.batched and nodes(own, problem, h) > MEAN_MAX_STEPS:
        raise Skipped(f"a mean needs more than {MEAN_MAX_STEPS} steps of single states")
    found = measured(own, problem, y, h, quantity(function, y))
    return Measurement(found.defect, found.bound, f"I = {name}: {found.detail}; {known.words}")


def quantity(function: StatedFunction, y: Array) -> Quantity:
    """The function, with the bound of its change by a residual and with its unit at y,
    for the trace formula.
    """
    name, I, slope, curve, known = function

    def moved(y0: Array, y1: Array, r: Array) -> Array:
        reach = 2 * np.max(np.abs(y1 - y0), axis=1, keepdims=True)
        return np.asarray(np.sum(majorant_over(slope, curve, (y0, y1), reach, I) * 2 * r, axis=0))

    return Quantity(name, I, partial(_size, I, slope), moved, known.sigma, unit_of(slope, y), known.decay)


def _size(I: Function, slope: Function, y: Array) -> Array:
    return majorant_over(I, slope, (y,))


def unit_of(slope: Function, *states: Array) -> float:
    """The unit of defects of I: eps |∇I||y|, the effect of one rounding of y on I."""
    return EPS * max(TINY, *(float(np.linalg.norm(slope(y)) * np.linalg.norm(y)) for y in states))


def beyond_three() -> Iterable[Case]:
    """Make steps of at least half the contraction radius for systems (1.1)
    with d = 4 or 5 and d − 2 given Casimirs.
    """
    made = (_step(Random(seed), 4 + seed % 2) for seed in range(4 * FIXED_SYSTEMS))
    return [case for case in made if case is not None][:FIXED_SYSTEMS]


def of_casimirs(d: int, random: Random) -> PolynomialSystem:
    """A system (1.1) with d − 2 Casimirs C_1, … of degree one to four, not all quadratic:
    B_ij = Σ ε_ijk… ∂_kC_1 ….
    """
    own = [some.polynomial(d, 1, 4, 4, random) for _ in range(d - 3)]
    own.append(some.polynomial(d, 3, 4, 4, random))
    B = some.contracted(d, [list(poly.gradient(C)) for C in own], random)
    H = some.polynomial(d, 2, 4, 6, random)
    return PolynomialSystem(d, H, B, (1.0,), polynomial_casimirs=tuple(own))


def _step(random: Random, d: int) -> Case | None:
    axes = (strata.STEP, strata.SIGN, strata.SHARE, strata.GIVEN)
    levels = {axis.name: axis.strata[0] for axis in axes}
    y = tuple(random.choice([1.0, -1.0]) * random.randint(1, 8) / 8 for _ in range(d))
    return placed(of_casimirs(d, random), y, levels, random)


def by_degree() -> Iterator[Case]:
    """Long steps for H = ½p² + aq^n, y = (p, q), with additive noise on p.
    Random cases seldom have such long steps.

    The noise is weak, because a strong noise would shorten the step.
    """
    for degree in (3, 4, 5, 6, 8, 10):
        a = 2.0 ** -round(math.log2(degree * (degree - 1)))
        H = poly.polynomial(2, {(2, 0): 0.5, (0, degree): a})
        system = PolynomialSystem(2, H, planes(2), (2.0**-5,), noise_vectors=((1.0, 0.0),))
        yield Case(system, (1.0, 0.75), 0.25, (0.0,))


def as_data(case: Case) -> Case | None:
    """Keep a case whose H friction or noise moves at a known rate, with its problem as data."""
    data = polynomial_data(case)
    return None if data is None else about(energies)(replace(case, problem=data))


law = searched(
    name="invariant",
    statement="a stated function I with LI = σ − λI changes as along the exact flow, or in the mean if noise moves it",
    source="(1.1), trace formula",
    unit="ulp of I",
    preserves=True,
    cost=0.3,
    steps=75,
    cases=Cases(
        adapt=about(by_problem), why="the problems state no function: Problem(…, invariants={…})", damped=True
    ),
    not_applicable=lambda scheme: "" if sources(scheme) else NONE_STATED,
    check=check,
)
for_energy = searched(
    name="invariant:energy",
    statement="H decays by e^(−pγh) if it is homogeneous of degree p, with friction −γy; "
    "with noise E[H(y1)] = H(y0) + hσ if LH = σ",
    source="trace formula",
    unit="ulp of H",
    preserves=True,
    steps=5000,
    cases=Cases(
        adapt=as_data,
        why="LH is not σ − λH, or the problems are not given as polynomial data",
        needs={energy_changes: "the exact flow keeps H: see the law energy", **FRICTION},
        instead={Systems.HAMILTONIANS: Systems.SEPARABLE_HAMILTONIANS},
        fixed={Systems.ADDITIVE: by_degree},
        damped=True,
    ),
    check=check_energy,
)
for_casimirs = searched(
    name="invariant:casimir",
    statement="Casimirs of any degree are kept; yᵀAy decays by e^(−2γh) with friction −γy, bᵀy by e^(−γh); "
    "with additive noise E[C(y1)] = C(y0) + hσ",
    source="§5, trace formula",
    unit="ulp of C",
    preserves=True,
    cost=0.3,
    steps=4000,
    cases=Cases(
        where={"matrices": ("su(3)",), "Casimirs": ("linear", "quadratic", "two")},
        instead={Systems.SINGLE: Systems.NAMBU, Systems.HAMILTONIANS: Systems.MATRIX_HAMILTONIANS},
        blind={"degree of C": ("1", "2")},
        adapt=about(casimirs),
        why="the problems name no Casimir of friction or additive noise, and none as data that is not quadratic",
        needs={same_structure: "its cases have one structure: see casimir", **FRICTION},
        fixed={Systems.SINGLE: beyond_three},
        damped=True,
    ),
    check=check_casimir,
)
laws = (law, for_energy, for_casimirs)


def test_invariant(scheme: Scheme, effort: Effort) -> None:
    require(law, scheme, effort)


def test_invariant_energy(scheme: Scheme, effort: Effort) -> None:
    require(for_energy, scheme, effort)


def test_invariant_casimir(scheme: Scheme, effort: Effort) -> None:
    require(for_casimirs, scheme, effort)
