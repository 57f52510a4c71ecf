"""Errors of one step by quadrature over ΔW at small step sizes,
from which orders follow without sampling or seed.

Milstein's theorem (§3) concludes a mean-square order p from two conditions on one step,

    |E[y1 − φ]| ≤ C h^(p+1)  (3.8)    and    (E|y1 − φ|²)^½ ≤ C h^(p+½)  (3.9),

and a weak order q from |E g(y1 − y0) − E g(φ − y0)| ≤ C h^(q+1) for monomials g of degree 1, …,
2q + 1. Here φ is the exact solution after the step from the same state. For (1.1) φ is the flow
at the time h + Σ c_jΔW_j. For several structures φ is the problem's closed form; if there is
none, only moments of φ are known, by the generator's series. The scheme gets increments truncated
as it declares, the exact solution untruncated ones. If the scheme declares increments with a few
values, its expectation is a finite sum, and the quadrature is for the exact solution alone.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache, partial
from itertools import combinations_with_replacement
from math import factorial

import numpy as np
from sepv.properties._failed_step import first_failed
from sepv.properties._orders.gaussian import GaussianRule, point_rule, rule_for
from sepv.properties._orders.gaussian_step import gaussian_step, is_gaussian
from sepv.properties._orders.local_moments import (
    FULL_DEGREE,
    SPLITTING_POWER,
    exponents,
    moments_at,
    moments_of,
)
from sepv.properties._orders.log_ode import field, log_flow, runge_kutta
from sepv.properties._problems_of import as_taken, problems_of, units_for
from sepv.properties._sampled import sparing

from sepv import problems
from sepv.exact import FlowFailure, exact_flow
from sepv.law import Run
from sepv.law.tolerance import from_positions
from sepv.problem import (
    Array,
    PolynomialSystem,
    Problem,
    Systems,
    column,
    commutes,
    one_field,
    one_hamiltonian,
    sample_states,
    uniform_damping,
)
from sepv.problems import started
from sepv.record import EPS, poly
from sepv.schemes import CLASSICAL, Scheme, guarded, order_of, point_law
from sepv.simulate import advance

STEP_LEVELS = 10


def five_noises(c: tuple[float, ...] = (0.5, 0.25, 0.375, 0.75, 0.3125)) -> Problem:
    """Build a Nambu system in dimension three: quartic H, Casimir |y|², non-constant factor g,
    five different c_j.
    """
    H = poly.add(poly.squares((1.0, 2.0, 0.5)), poly.polynomial(3, {(2, 2, 0): 0.25, (0, 1, 3): 0.125}))
    g = poly.polynomial(3, {(0, 0, 0): 1.0, (1, 0, 0): 0.25})
    return started(problems.nambu_system(H, g, poly.squares((1, 1, 1)), c), "quartic-top", (0.75, -0.5, 0.5))


@lru_cache(maxsize=1)
def two_noises() -> Problem:
    """Build the Nambu system of `five_noises` with two noises alone,
    for paths of schemes that take no batches.
    """
    return five_noises((0.75, 0.5))


@lru_cache(maxsize=1)
def three_inertias() -> Problem:
    """Build the rigid body with random inertia in all three directions, with different c_j."""
    return problems.random_inertia(noise_inertia=(1.0, 0.5, 0.75), noise=(0.5, 0.375, 0.25))


def unequal_twists() -> Problem:
    """Build the rigid body with two noises that commute and have different c_j."""
    return problems.commuting_twists((0.5, 0.375))


STEP_PROBLEMS: dict[Systems, tuple[Callable[[], Problem], ...]] = {
    Systems.SINGLE: (problems.rigid_body, problems.pendulum, five_noises),
    Systems.NAMBU: (problems.rigid_body, problems.lotka_volterra, five_noises),
    Systems.SEVERAL: (
        problems.commuting_rotations, problems.commuting_oscillators, problems.noncommuting_tops
    ),
    # General noises, commuting noises, additive noises, and one noise that does not commute with
    # the drift. None of these problems has a symmetry that makes errors of a step vanish.
    Systems.HAMILTONIANS: (
        three_inertias, unequal_twists, problems.pushed_henon_heiles, problems.twisted_top
    ),
}  # fmt: skip


@lru_cache(maxsize=8)
def cases(systems: Systems) -> tuple[Problem, ...]:
    """Return the problems on which schemes for a class of systems are judged. They are built
    once.
    """
    return tuple(make() for make in STEP_PROBLEMS[systems])


def problems_for(scheme: Scheme) -> tuple[Problem, ...]:
    """Return the scheme's own problems, else its class's.
    Raise `Skipped` if none of its own has an initial state.
    """
    own = problems_of(scheme)
    return as_taken(scheme, cases(scheme.systems)) if own is None else own


@dataclass(frozen=True)
class LocalErrors:
    """Errors of one step from several states of a problem, at L falling step sizes.

    Let φ be the exact solution. `mean`, `rms` and `weak` (L,) are |E[y1 − φ]|, (E|y1 − φ|²)^½ and
    |E g(y1) − E g(φ)|, the largest over states and polynomials g, in the problem's unit of length.
    If only moments of φ are known, `rms` is NaN. For several Hamiltonians that do not commute,
    `rms` is the distance of y1 from the solution of the log-ODE of step two
    (`sepv.properties._orders.log_ode`), which is within O(h^{3/2}) of φ, unless φ is Gaussian
    (`coupled_rms`).
    """

    problem: str
    h: Array
    mean: Array
    rms: Array
    weak: Array
    exact_order: (
        int  # the power of h in the quadrature's error of `mean` and `weak`; larger slopes are not visible
    )
    scale: float | Array  # the largest component of a state, (L,) if it differs
    flow: float  # the error of the exact solution
    steps: int  # the number of steps that the scheme made
    failed: tuple[
        tuple[float, str], ...
    ]  # other h with a description of a failed step: not solved, not finite or out of the domain
    column: str = "one"  # the kind of noise (`sepv.schemes._order_claims.COLUMNS`)
    rounding: float | Array = 0.0  # a derived bound (L,) of further roundings


def step_sizes(order: float) -> Array:
    """Return STEP_LEVELS step sizes, coarse to fine, at which local errors of a scheme of this
    order are above rounding.

    The local rms error is about h^(p+½). At the finest h this is 2⁻⁴⁰. For high orders it is 2⁻⁴⁷,
    because their constants are small and their range of h would else be short. For low orders the
    coarsest h is small, because steps with large |ΔW| are not asymptotic at larger h.
    """
    coarse = 6.0 if order <= 1 else 4.0 if order <= 2 else 2.0
    fine = (40.0 if order <= 2 else 47.0) / (order + 0.5)
    return np.asarray(2.0 ** -np.round(np.linspace(coarse, max(fine, coarse + 4.5), STEP_LEVELS), 1))


def _sizes(strong: float, weak: float) -> list[float]:
    """Return step sizes for the mean-square order `strong`,
    and larger ones too if `weak` is higher by more than ½.
    """
    found: list[float] = []
    more = step_sizes(weak).tolist() if weak > strong + 0.5 else []
    for h in sorted({*step_sizes(strong).tolist(), *more}, reverse=True):
        if not found or h < 0.75 * found[-1]:  # slopes over neighbouring sizes are inaccurate
            found.append(h)
    return found


def local_errors(scheme: Scheme, problem: Problem, run: Run) -> LocalErrors:
    """Return the errors of one step on a problem, computed once for all laws of a run.

    Raise `Skipped` if the scheme refuses the problem, or if no exact solution or moments of a step
    are known.
    """
    if problem not in run.steps:
        run.steps[problem] = _measure(scheme, problem, sparing(scheme, run.effort))
    found: LocalErrors = run.steps[problem]
    return found


def _measure(scheme: Scheme, problem: Problem, spared: bool) -> LocalErrors:
    kind = column(problem)
    strong, weak = order_of(scheme.mean_square_order, kind), order_of(scheme.weak_order, kind)
    asked, m = guarded(scheme), problem.noises
    units = units_for(scheme, problem)
    states, length = local_states(scheme, problem), units.length
    if spared and m > 1:  # quadrature over several noises has hundreds of nodes
        states = states[:, :1]
    sizes = [h * units.time for h in _sizes(strong, weak)]
    rules = [(h, step_rule(scheme, problem, h)) for h in sizes]
    law = point_law(scheme.increments)
    known = moments_only(problem)
    top = max(FULL_DEGREE, int(2 * weak + 1)) if not one_hamiltonian(problem) else FULL_DEGREE
    exact, flow = solutions_at(problem, states, rules, top)
    seen = (rules[0][1].degree + 1) // 2
    if known and not isinstance(problem.data, PolynomialSystem):
        seen = min(seen, SPLITTING_POWER)
    rules = rules[len(rules) - len(exact) :]
    rows: list[tuple[float, float, float, float]] = []
    failed, steps = [], 0
    for (h, nodes), ends in zip(rules, exact, strict=True):
        taken = nodes if law is None else point_rule(m, law)
        y, stuck = one_step(asked, problem, states, h, taken)
        steps += taken.zeta.shape[1] * states.shape[1]
        moved = (y - states[..., None]) / length
        if stuck:
            failed.append((h, stuck))
            rows = []  # only step sizes below all failures are used
        elif known:
            first, _, second = against_moments(moved, ends, taken.weights, top, length)
            rows.append((h, first, coupled_rms(problem, states, h, taken, y, scheme.asks) / length, second))
        elif law is not None:
            rows.append(
                (h, *apart(moved, taken.weights, (ends - states[..., None]) / length, nodes.weights, weak))
            )
        else:
            rows.append((h, *_norms(moved, (ends - states[..., None]) / length, nodes.weights, weak)))
    kept, mean, rms, weakly = np.array(rows).reshape(-1, 4).T
    return LocalErrors(
        problem.name, kept, mean, rms, weakly, seen, float(np.max(np.abs(states))) / length, flow / length, steps,
        tuple(failed), kind, from_positions(problem, states, kept) / length,
    )  # fmt: skip


def moments_only(problem: Problem) -> bool:
    """True if a problem's exact solution has no formula, so that only its moments are known,
    from the generator.
    """
    if one_field(problem) or uniform_damping(problem) or getattr(problem, "closed_form", None):
        return False
    return one_hamiltonian(problem) or not commutes(problem)


def coupled_rms(problem: Problem, states: Array, h: float, nodes: GaussianRule, y: Array, asks: str) -> float:
    """Return the largest (E|y1 − φ|²)^½ over states; NaN if there is no φ.

    With additive noise and an affine drift φ is the exact solution, and E|y1 − φ|² the mean over
    the nodes of |y1 − E[φ | rows]|², plus the variance of φ given the rows. Else φ solves the
    log-ODE of step two. It is computed by one step of order four, with an error of the order of
    h^{5/2}. Its distance
    from the exact solution is O(h^{3/2}). For commuting noises with space-time areas the brackets
    with the drift make the distance O(h²).
    """
    if is_gaussian(problem):
        step = gaussian_step(problem, h, asks)
        rows = np.sqrt(h) * np.concatenate([nodes.xi, nodes.zeta[problem.noises :, nodes.index]])
        apart = np.sum((y - step.mean(states, rows)) ** 2, axis=0) @ nodes.weights
        return float(np.sqrt(np.max(apart) + step.variance()))
    general = column(problem) == "general"
    if one_hamiltonian(problem) or (general and nodes.areas is None):
        return float("nan")
    n = nodes.weights.size
    areas = h * nodes.areas if general and nodes.areas is not None else np.zeros((0, n))
    parts = np.concatenate([np.full((1, n), h), problem.c[:, None] * np.sqrt(h) * nodes.xi])
    bridges = None if general or nodes.bridges is None else np.sqrt(h) * nodes.bridges
    right_side, worst = partial(field, problem, parts=parts, areas=areas, bridges=bridges), 0.0
    for s, start in enumerate(states.T):
        found = runge_kutta(right_side, np.repeat(start[:, None], n, axis=1), 1, CLASSICAL)
        worst = max(worst, float(np.sum((y[:, s] - found) ** 2, axis=0) @ nodes.weights))
    return float(np.sqrt(worst))


def local_states(scheme: Scheme, problem: Problem) -> Array:
    """Return the states (d, S) of a problem from which single steps are made: three,
    or two for several noises.
    """
    states = sample_states(problem, units_for(scheme, problem).length)
    return np.array(list(states)[: 3 if problem.noises <= 1 else 2]).T


def step_rule(scheme: Scheme, problem: Problem, h: float) -> GaussianRule:
    """Return the quadrature over ΔW for a step h of the problem,
    with truncation A_h in the problem's unit of time.
    """
    return rule_for(scheme, problem, h, rule_degree(scheme), unit=units_for(scheme, problem).time)


def rule_degree(scheme: Scheme) -> int:
    """Return the degree of polynomials of ΔW that the quadrature must integrate exactly to show the
    claimed orders.
    """
    return int(2 * max(order_of(p, "additive") for p in (scheme.mean_square_order, scheme.weak_order)) + 2)


def one_step(
    scheme: Scheme, problem: Problem, states: Array, h: float, nodes: GaussianRule
) -> tuple[Array, str]:
    """Return y1 (d, S, n) from S states at the n nodes, and a description of the first failed step,
    or "".
    """
    d, S = states.shape
    asked = nodes.zeta.shape[1]
    y0, dW = np.repeat(states, asked, axis=1), np.tile(np.sqrt(h) * nodes.zeta, S)
    y, status, *_ = advance(scheme, problem, y0, h, dW)
    failed = first_failed(scheme, problem, y0, h, dW, status)
    return y.reshape(d, S, asked)[:, :, nodes.index], failed


def solutions_at(
    problem: Problem, states: Array, rules: list[tuple[float, GaussianRule]], degree: int = FULL_DEGREE
) -> tuple[list[Array], float]:
    """Return exact solutions at each step size, or moments up to `degree` if no more is known;
    also their error.
    """
    if moments_only(problem):
        return moments_at(problem, states, [h for h, _ in rules], degree)
    return ends_at(problem, states, rules)


def ends_at(
    problem: Problem, states: Array, rules: list[tuple[float, GaussianRule]]
) -> tuple[list[Array], float]:
    """Return exact solutions (d, S, n) at step sizes for which the flow exists from all states,
    and their error.
    """
    form = getattr(problem, "closed_form", None)
    if not one_hamiltonian(problem) and form is None:
        return _flows_at(problem, states, rules)
    if form is not None:
        scale = float(np.max(np.abs(states)))
        found = [np.stack([form(y, h, np.sqrt(h) * r.xi) for y in states.T], axis=1) for h, r in rules]
        return found, 8 * EPS * scale
    times = [problem.random_step(h, np.sqrt(h) * r.xi) for h, r in rules]
    while times:
        try:
            # The dense solution is exact at θ = 0, where closed forms have an error of some
            # roundings.
            flows = [exact_flow(problem, np.concatenate(times), y, dense=True) for y in states.T]
        except FlowFailure:
            times = times[1:]
            continue
        ends = np.stack([f.y for f in flows], axis=1)
        cuts = np.cumsum([t.size for t in times])[:-1]
        return np.split(ends, cuts, axis=2), max(f.error for f in flows)
    return [], 0.0


def _flows_at(
    problem: Problem, states: Array, rules: list[tuple[float, GaussianRule]]
) -> tuple[list[Array], float]:
    """Return exact solutions for commuting Hamiltonians, and an estimate of their error.

    The solution is the flow of h f_0 + Σ c_j ΔW_j f_j at time 1, with the fields f_j = B∇H_j.
    """
    found, worst = [], 0.0
    for h, nodes in rules:
        n = nodes.weights.size
        parts = np.concatenate([np.full((1, n), h), problem.c[:, None] * np.sqrt(h) * nodes.xi])
        ends = [
            log_flow(problem, np.repeat(y[:, None], n, axis=1), parts, np.zeros((0, n))) for y in states.T
        ]
        found.append(np.stack([y for y, _ in ends], axis=1))
        worst = max(worst, *(error for _, error in ends))
    return found, worst


def against_moments(
    moved: Array, exact: Array, weights: Array, degree: int = FULL_DEGREE, length: float = 1.0
) -> tuple[float, float, float]:
    """Return errors (mean, rms = NaN, weak) of `moved`, in units of `length`,
    against exact moments `exact` (A, S).
    """
    asked = exponents(moved.shape[0], degree)
    over, unit = np.array([(factorial(sum(alpha)), length ** sum(alpha)) for alpha in asked]).T
    differences = (moments_of(moved, weights, asked) - exact / unit[:, None]) / over[:, None]
    mean = np.sqrt(np.max(np.sum(differences[: moved.shape[0]] ** 2, axis=0)))
    return float(mean), float("nan"), float(np.max(np.abs(differences)))


def _norms(moved: Array, exact: Array, weights: Array, weak: float) -> tuple[float, float, float]:
    """Return the largest |E e|, (E|e|²)^½, |E g(moved) − E g(exact)| over states and all g,
    with e = moved − exact.
    """
    error = moved - exact
    mean = np.sqrt(np.max(np.sum((error @ weights) ** 2, axis=0)))
    rms = np.sqrt(np.max(np.sum(error**2, axis=0) @ weights))
    differences = [np.abs((g(moved) - g(exact)) @ weights) for g in polynomials(moved.shape[0], weak)]
    return float(mean), float(rms), float(np.max(differences))


def apart(
    moved: Array, weights: Array, exact: Array, rule_weights: Array, weak: float
) -> tuple[float, float, float]:
    """Return errors (mean, rms = NaN, weak) if the nodes and `weights` of `moved` are not those of
    `exact`.
    """
    mean = np.sqrt(np.max(np.sum((moved @ weights - exact @ rule_weights) ** 2, axis=0)))
    tests = polynomials(moved.shape[0], weak)
    found = max(np.max(np.abs(g(moved) @ weights - g(exact) @ rule_weights)) for g in tests)
    return float(mean), float("nan"), float(found)


def polynomials(dimension: int, weak: float) -> list[Callable[[Array], Array]]:
    """Return monomials in y − y0 of degree k ≤ 3 and kth powers of linear forms for 3 < k
    ≤ 2·`weak` + 1, all over k!.

    The factor 1/k! is that of Taylor's series. Without it errors of high powers would hide those of
    low powers.
    """

    def monomial(indices: tuple[int, ...]) -> Callable[[Array], Array]:
        return lambda x: np.prod(x[list(indices)], axis=0) / factorial(len(indices))

    def power(k: int, direction: Array) -> Callable[[Array], Array]:
        return lambda x: np.tensordot(direction, x, 1) ** k / factorial(k)

    products = (combinations_with_replacement(range(dimension), k) for k in range(1, FULL_DEGREE + 1))
    found = [monomial(indices) for own in products for indices in own]
    forms = np.cos(np.outer(np.arange(1, dimension + 2), np.arange(1, dimension + 1)))  # generic directions
    forms /= np.linalg.norm(forms, axis=1, keepdims=True)
    return found + [power(k, form) for k in range(FULL_DEGREE + 1, int(2 * weak + 1) + 1) for form in forms]
