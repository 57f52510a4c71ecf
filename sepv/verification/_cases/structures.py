"""Hypothesis strategies for the other classes of systems, and from which of them each law draws its cases.

Random Nambu systems g(y), C(y), H(y) in dimension three; random structures G_j, those with a common Casimir,
commuting families, and commuting Hamiltonians. Coefficients are small dyadic rationals, as in
`sepv.verification.strategies`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import combinations

import numpy as np
from hypothesis import assume
from hypothesis import strategies as st

from sepv import problems
from sepv.problem import Array, NamedProblem, PolynomialSystem, Problem, StructuresProblem, Systems
from sepv.problem._problem import Structure
from sepv.problems._several import commuting_actions, rotating_planes
from sepv.record import Polynomial
from sepv.record import _polynomial as poly
from sepv.verification import strategies as some
from sepv.verification._cases.case import Case
from sepv.verification._contraction import contraction_ball

# ½|y|² in three variables.
SPHERE = poly.squares((1.0,) * 3)
Cases = Callable[[], st.SearchStrategy[Case]]


@st.composite
def factors(draw: st.DrawFn) -> Polynomial:
    """g of degree 0 to 2. Examples shrink towards 1."""
    if draw(st.booleans()):
        return draw(some.polynomials(3, 2, least=0, terms=2))
    return poly.constant(3, 1.0)


@st.composite
def nambu_systems(
    draw: st.DrawFn, *, degree: int = 6, casimirs: st.SearchStrategy[Polynomial] | None = None,
    factor: st.SearchStrategy[Polynomial] | None = None, noise: st.SearchStrategy[tuple[float, ...]] | None = None,
) -> PolynomialSystem:  # fmt: skip
    """B(y)v = g(y)(v × ∇C(y)), H of degree 1 to `degree`, C of degree 1 to 4 by default.

    Examples shrink towards H = C = ½|y|² and g = 1.
    """
    C = draw(some.hamiltonians(3, 4) if casimirs is None else casimirs)
    g = draw(factors() if factor is None else factor)
    return problems.nambu_system(
        draw(some.hamiltonians(3, degree)), g, C, draw(some.noises() if noise is None else noise)
    )


def quadratic_casimirs() -> st.SearchStrategy[Polynomial]:
    """Homogeneous quadratic C, which (2.1) keeps too. Examples shrink towards ½|y|²."""
    more = some.polynomials(3, 2, least=2).filter(lambda p: p.terms)  # terms may cancel
    return st.one_of(st.just(SPHERE), more, more.map(lambda p: poly.add(SPHERE, p)).filter(lambda p: p.terms))


def linear_casimirs() -> st.SearchStrategy[Polynomial]:
    """C = bᵀy: a constant B where g is one."""
    return some.polynomials(3, 1, least=1).filter(lambda p: p.terms)


def nambu_paper_steps() -> st.SearchStrategy[Case]:
    """Steps of the rigid body and of Lotka-Volterra."""
    names = ("rigid-body", "lotka-volterra")
    return some.paper_steps().filter(
        lambda c: isinstance(c.problem, NamedProblem) and c.problem.name in names
    )


def nambu_steps() -> st.SearchStrategy[Case]:
    """Steps of random Nambu systems and of the paper's two."""
    return st.one_of(some.steps(nambu_systems()), nambu_paper_steps())


def _noisy() -> st.SearchStrategy[Case]:
    """With c_1 = 1, as the way back of the law "symmetry" needs."""
    first = some.noises(least=1).map(lambda c: (1.0, *c[1:]))
    return st.one_of(some.steps(nambu_systems(noise=first)), nambu_paper_steps())


@st.composite
def _no_step(draw: st.DrawFn) -> Case:
    """Noise that cancels h exactly: Δ = h + c ΔW = 0."""
    case = draw(some.steps(nambu_systems(noise=st.just((0.5,)))))
    return Case(case.problem, case.y, case.h, (-2 * case.h,))


@st.composite
def _at_rest(draw: st.DrawFn) -> Case:
    """∇H(0) = 0: H has terms of degree ≥ 2 only."""
    H = draw(some.hamiltonians(3, 5, least=2))
    system = problems.nambu_system(H, draw(factors()), draw(some.hamiltonians(3, 4)))
    return Case(system, (0.0, 0.0, 0.0), draw(st.sampled_from([1.0, 0.25])), (draw(some.components()),))


@st.composite
def _at_origin(draw: st.DrawFn) -> Case:
    """y0 = 0, with the linear and quadratic terms of H and C and the constant and linear ones of g."""

    def function() -> Polynomial:
        linear = poly.linear([draw(some.coefficients()) for _ in range(3)])
        more = draw(some.polynomials(3, 4, least=2)) if draw(st.booleans()) else poly.polynomial(3, {})
        return poly.add(linear, SPHERE, more)

    g = poly.add(poly.constant(3, 1.0), draw(some.polynomials(3, 2, least=1, terms=3)))
    system = problems.nambu_system(function(), g, function())
    radius = contraction_ball(problems.build(system), np.zeros(3))[0]
    step = some.ORIGIN_SHARE * min(radius, 1.0)
    return Case(system, (0.0, 0.0, 0.0), step, (draw(st.sampled_from([0.0, 0.5, -0.25])) * step,))


def _constant_structure() -> st.SearchStrategy[Case]:
    """Constant B with noise; any B with noise of size zero."""
    one = st.just(poly.constant(3, 1.0))
    constant = nambu_systems(casimirs=linear_casimirs(), factor=one, noise=some.noises(least=1))
    return st.one_of(some.steps(constant), some.steps(nambu_systems(noise=st.just((0.0, 0.0)))))


def _several_noises() -> st.SearchStrategy[Case]:
    return some.steps(nambu_systems(noise=some.noises(least=1, most=2).map(lambda c: (1.0, *c))))


def _small() -> st.SearchStrategy[Case]:
    """Small enough that a substitution stays readable."""
    return some.steps(nambu_systems(degree=4, casimirs=some.hamiltonians(3, 3)))


NAMBU: dict[str, Cases] = {
    **dict.fromkeys(("contract", "reproducibility", "energy", "reference"), nambu_steps),
    "casimir": lambda: some.steps(nambu_systems(casimirs=st.one_of(quadratic_casimirs(), linear_casimirs()))),
    "any-casimir": nambu_steps,
    "poisson-map": lambda: nambu_steps().map(some.halved),
    "identity": lambda: st.one_of(_no_step(), _at_rest()),
    "midpoint": lambda: some.steps(nambu_systems(degree=2, casimirs=quadratic_casimirs())),
    "reduction": _constant_structure,
    "noise-sum": _several_noises,
    "random-step": _several_noises,
    "expansion": _at_origin,
    "symmetry": _noisy,
    "equivariance": _small,
}


def families() -> st.SearchStrategy[PolynomialSystem]:
    """Several structures: any, with a Casimir common to all, commuting, and several Hamiltonians that commute."""
    return st.one_of(random_structures(), common_casimir_systems(), commuting_families())


@st.composite
def random_structures(draw: st.DrawFn, *, degree: int = 6, largest: int = 5) -> PolynomialSystem:
    """Skew B, G_1, …, G_m of degree 0 to 2, any polynomial H. Examples shrink towards one G = B = J, H = ½|y|²."""
    d = draw(st.integers(2, largest))
    m = draw(st.integers(1, 3))
    B, *G = (draw(some.skew_structures(d, 2)) for _ in range(m + 1))
    c = draw(some.noises(least=m, most=m))
    return PolynomialSystem(d, draw(some.hamiltonians(d, degree)), B, c, noise_structures=tuple(G))


@st.composite
def common_casimir_systems(draw: st.DrawFn) -> PolynomialSystem:
    """B and all G_j contracted from totally antisymmetric tensors with one Ay, so that yᵀAy is a Casimir of each.

    In dimension three they are g_j(y) times one matrix; in four the tensors differ.
    """
    d, m = draw(st.sampled_from([3, 4])), draw(st.integers(1, 2))
    A = draw(some.symmetric_matrices(d))
    v = some.linear_forms(A)
    B, *G = (some.contracted(draw, d, [v]) for _ in range(m + 1))
    c = draw(some.noises(least=m, most=m))
    H = draw(some.hamiltonians(d, 4))
    if not B or not all(G):  # a tensor of zeros
        return draw(random_structures())
    return PolynomialSystem(d, H, B, c, (A,), noise_structures=tuple(G))


def action_polynomials(n: int, degree: int) -> st.SearchStrategy[Polynomial]:
    """Polynomials in the actions I_1, …, I_n without constant term."""
    return some.polynomials(n, degree, least=1, terms=3)


@st.composite
def commuting_families(draw: st.DrawFn) -> PolynomialSystem:
    """Planes that turn at rates given by their actions. Examples shrink towards one plane, H = G = I_1."""
    n, m = draw(st.integers(1, 2)), draw(st.integers(1, 2))
    alpha = [[draw(some.polynomials(n, 1, least=0, terms=2)) for _ in range(n)] for _ in range(m)]
    return rotating_planes(draw(action_polynomials(n, 2)), alpha, draw(some.noises(least=m, most=m)))


@st.composite
def commuting_hamiltonian_steps(draw: st.DrawFn) -> Case:
    """Steps with several Hamiltonians, functions of the actions of one or two planes, away from the rest points.

    S_j is singular where ∇H_0 = 0 and has no majorant near it: the step is a sixteenth of what the slopes of the
    fields at y allow, which is measured and not derived.
    """
    n, m = draw(st.integers(1, 2)), draw(st.integers(1, 2))
    H = poly.add(poly.linear((1.0,) * n), draw(action_polynomials(n, 2)))
    others = [draw(action_polynomials(n, 2)) for _ in range(m)]
    system = commuting_actions(H, others, draw(some.noises(least=m, most=m)))
    y = tuple(draw(st.sampled_from([0.5, 1.0, -0.75])) for _ in range(2 * n))
    problem, state = problems.build(system), np.array(y)
    assume(float(np.linalg.norm(problem.gradient(state))) > 0.25)
    part = 1 / (16 * (1 + _steepest(problem, state))) / (m + 1)
    shares = [draw(st.sampled_from([1.0, 0.5, -0.5, 2.0**-10])) for _ in range(m)]
    dW = tuple(part * s / (c or 1.0) for s, c in zip(shares, system.noise, strict=True))
    return Case(system, y, part, dW)


@st.composite
def critical_hamiltonian_steps(draw: st.DrawFn) -> Case:
    """Steps with several Hamiltonians from a critical point of H_0 at which some B∇H_j is not zero: to be refused.

    Either a plane that rests beside one that a noise turns, or a circle of critical points, H_0 = ½I² − I_0 I.
    """
    a, b = draw(st.sampled_from([(1.0, 0.0), (0.5, 0.5), (1.0, -2.0), (-0.25, 0.5)]))
    y: tuple[float, ...]
    if draw(st.booleans()):
        n, kept, y = 2, 1, (0.0, 0.0, a, b)
        H = poly.polynomial(
            2, {(1, 0): 1.0, (2, 0): draw(some.coefficients()), (1, 1): draw(some.coefficients())}
        )
    else:
        # I_0 is a sum of squares of few bits: ∇H_0 = (I − I_0) y is exactly zero.
        n, kept, y = 1, 0, (a, b)
        H = poly.polynomial(1, [((2,), 0.5), ((1,), -0.5 * (a * a + b * b))])
    m = draw(st.integers(1, 2))
    others = [poly.variable(n, kept)]
    others += [draw(action_polynomials(n, 2)) for _ in range(m - 1)]
    system = commuting_actions(H, others, (1.0, 0.5)[:m])
    h = draw(st.sampled_from([2.0**-3, 2.0**-6, 2.0**-10]))
    dW = [draw(st.sampled_from([1.0, -1.0, 0.5])) * h**0.5 for _ in range(m)]
    return Case(system, y, h, tuple(dW))


def _steepest(problem: Problem, y: Array) -> float:
    """The largest slope of the fields h B∇H and c_j G_j∇H at y, by differences, and their largest size."""
    assert isinstance(problem, StructuresProblem)
    worst = 0.0
    for c, G in zip((1.0, *problem.c), (problem.structure, *problem.noise_structures), strict=True):
        for k in range(y.size):
            at = y.copy()
            at[k] += 1e-6
            field, moved = G(y) @ problem.gradient(y), G(at) @ problem.gradient(at)
            sizes = np.max(np.abs(moved - field)) / 1e-6, np.max(np.abs(field))
            worst = max(worst, c * float(max(sizes)))
    return worst


def several_steps() -> st.SearchStrategy[Case]:
    """Steps of all kinds of systems with several structures."""
    return st.one_of(some.steps(families()), commuting_hamiltonian_steps())


@st.composite
def still(draw: st.DrawFn, systems: st.SearchStrategy[PolynomialSystem]) -> Case:
    """h = 0 and no increments, or all gradients zero at y."""
    case = draw(some.steps(systems))
    if draw(st.booleans()):
        return Case(case.problem, case.y, 0.0, (0.0,) * len(case.dW))
    assert isinstance(case.problem, PolynomialSystem)
    d = case.problem.dimension
    others = tuple(draw(some.hamiltonians(d, 4, least=2)) for _ in case.problem.noise_hamiltonians)
    H = draw(some.hamiltonians(d, 5, least=2))
    system = replace(case.problem, hamiltonian=H, noise_hamiltonians=others, casimirs=(), linear_casimirs=())
    return Case(system, (0.0,) * d, draw(st.sampled_from([1.0, 0.25])), case.dW)


def _scaled_copies() -> st.SearchStrategy[Case]:
    """G_j = B for all j: (2.1)."""

    def copied(system: PolynomialSystem) -> PolynomialSystem:
        return replace(system, noise_structures=(system.structure,) * len(system.noise))

    with_noise = some.poisson_systems(degree=4, largest=4, structure_degree=2).filter(
        lambda s: s.noise and s.structure
    )
    return some.steps(with_noise.map(copied))


@st.composite
def _several_at_origin(draw: st.DrawFn) -> Case:
    """y0 = 0 with all terms that the fields and their slopes need there, inside the radius of the whole step."""
    d, m = draw(st.integers(2, 4)), draw(st.integers(1, 2))
    H = poly.add(poly.linear([draw(some.coefficients()) for _ in range(d)]), poly.squares((1.0,) * d))

    def entry() -> Polynomial:
        return poly.add(
            poly.constant(d, draw(some.coefficients())), draw(some.polynomials(d, 2, least=1, terms=2))
        )

    def structure() -> Structure:
        pairs = combinations(range(d), 2)
        return tuple((i, j, entry()) for i, j in pairs if j == i + 1 or draw(st.booleans()))

    G = tuple(structure() for _ in range(m))
    return from_origin(draw, PolynomialSystem(d, H, structure(), (1.0,) * m, noise_structures=G))


def from_origin(draw: st.DrawFn, system: PolynomialSystem) -> Case:
    """A step from y0 = 0 with a share of the radius for h and for each noise."""
    d, m = system.dimension, len(system.noise)
    radius = contraction_ball(problems.build(system), np.zeros(d))[0]
    part = some.ORIGIN_SHARE * min(radius, 1.0) / (m + 1)
    signs = [draw(st.sampled_from([1.0, -0.5, 0.25])) for _ in range(m)]
    return Case(system, (0.0,) * d, part, tuple(s * part for s in signs))


SEVERAL: dict[str, Cases] = {
    **dict.fromkeys(("contract", "reproducibility", "energy", "symmetry"), several_steps),
    "reference": lambda: st.one_of(several_steps(), critical_hamiltonian_steps()),
    "casimir": lambda: some.steps(common_casimir_systems().filter(lambda s: s.casimirs)),
    "identity": lambda: still(families()),
    "reduction": _scaled_copies,
    "noise-sum": lambda: some.steps(families()),
    "expansion": _several_at_origin,
    "equivariance": lambda: some.steps(random_structures(degree=4, largest=4)),
}

# For each class of systems other than all of (1.1): where a law draws its cases.
CASES: dict[Systems, dict[str, Cases]] = {Systems.NAMBU: NAMBU, Systems.SEVERAL: SEVERAL}
