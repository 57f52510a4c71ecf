"""Δ = 0 gives y1 = y0 exactly, and so does ∇H(y0) = 0: read off (2.1)."""

from __future__ import annotations

import numpy as np
from hypothesis import strategies as st

from sepv.problem import HamiltoniansProblem, NamedProblem, PolynomialSystem
from sepv.problem._hamiltonians import is_several
from sepv.record import _polynomial as poly
from sepv.schemes import Scheme, ask
from sepv.verification import Case, Effort, Measurement, require, searched, state_ulp
from sepv.verification.strategies import components, hamiltonians, poisson_systems, skew_structures, steps


@st.composite
def no_step(draw: st.DrawFn) -> Case:
    """Noise that cancels h: Δ = h + c ΔW = 0, exactly, for c a power of two."""
    systems = poisson_systems().map(
        lambda s: PolynomialSystem(s.dimension, s.hamiltonian, s.structure, (0.5,))
    )
    case = draw(steps(systems))
    return Case(case.problem, case.y, case.h, (-2 * case.h,))


@st.composite
def at_rest(draw: st.DrawFn) -> Case:
    """A critical point of H: H depends on y through terms of degree ≥ 2 in the components that vanish there."""
    d = draw(st.integers(2, 6))
    still = draw(st.integers(1, d))  # components 1 … still are zero, the others are free and not in H
    H = poly.polynomial(
        d, [((*e, *(0,) * (d - still)), c) for e, c in draw(hamiltonians(still, 5, least=2)).terms]
    )
    system = PolynomialSystem(d, H, draw(skew_structures(d)), (1.0,))
    free = draw(st.lists(components(), min_size=d - still, max_size=d - still))
    return Case(system, (*(0.0,) * still, *free), draw(st.sampled_from([1.0, 0.25])), (draw(components()),))


def cases() -> st.SearchStrategy[Case]:
    """Both kinds, and the pendulum at rest."""
    pendulum = Case(NamedProblem("pendulum", (("noise", (1.0, 0.5)),)), (0.0, 0.0), 0.25, (0.5, -0.25))
    return st.one_of(no_step(), at_rest(), st.just(pendulum))


def check(scheme: Scheme, case: Case) -> Measurement:
    """Largest component of |y1 − y0|; nothing is allowed."""
    problem, y, h, dW = case.build()
    y1 = ask(scheme, problem, y, h, dW)
    moved = float(np.max(np.abs(y1 - y)))
    return Measurement(moved / state_ulp(y, y1), 0.0, f"y1 = {y1.tolist()}, expected y itself")


def admits(case: Case) -> bool:
    """Δ = 0, with several structures all its parts, or ∇H = 0."""
    problem, y, h, dW = case.build()
    others = problem.noise_gradients if isinstance(problem, HamiltoniansProblem) else ()
    if not any(gradient(y).any() for gradient in (problem.gradient, *others)):
        return True
    if is_several(problem):
        return h == 0 and not (problem.c * dW).any()
    return float(problem.random_step(h, dW)) == 0


law = searched(
    name="identity",
    statement="Δ = 0 gives y1 = y0 exactly, and so does ∇H(y0) = 0",
    source="(2.1)",
    unit="ulp of y",
    cost=0.4,
    steps=74,
    cases=cases,
    check=check,
    admits=admits,
)


def test_identity(scheme: Scheme, effort: Effort) -> None:
    require(law, scheme, effort)
