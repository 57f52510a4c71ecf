"""(2.1) sees h and the increments only through the random step Δ = h + Σ_j c_jΔW_j."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from hypothesis import strategies as st

from sepv.errors import Skipped
from sepv.problem import Array, PolynomialSystem, Problem
from sepv.schemes import Scheme, ask
from sepv.verification import Case, Effort, Measurement, require, searched, state_ulp, step_residual
from sepv.verification._amplification import amplification
from sepv.verification._cases.fixed_cases import fixed_cases
from sepv.verification.strategies import casimir_systems, noises, paper_steps, poisson_systems, steps


@st.composite
def _noisy(draw: st.DrawFn) -> PolynomialSystem:
    """One to three noises, the first of c = 1."""
    system = draw(st.one_of(poisson_systems(), casimir_systems()))
    return replace(system, noise=(1.0, *draw(noises(least=0, most=2))))


def cases() -> st.SearchStrategy[Case]:
    """Steps of random systems with noise, and of the paper's problems."""
    return st.one_of(steps(_noisy()), steps(_noisy()), paper_steps())


def check(scheme: Scheme, case: Case) -> Measurement:
    """Distance between steps with one Δ, split into h and increments in different ways.

    All solve one equation, with residuals r1 and r2: their distance solves (I − ∂R/∂y1)e = r1 − r2. The rounding of Δ
    is part of r. Random systems are inside their contraction radius, where ‖(I − ∂R/∂y1)⁻¹‖ ≤ 1/(1 − CONTRACTION).
    """
    problem, y, h, dW = case.build()
    others = splits(problem, h, dW)
    if not others:
        raise Skipped("a problem without noise has one split of Δ only")
    y1 = ask(scheme, problem, y, h, dW)
    own = step_residual(problem, y, y1, h, dW, scheme)
    amplified = amplification(scheme, case)
    unit, worst = state_ulp(y, y1), Measurement(0.0, 0.0)
    for name, other_h, other_dW in others:
        answer = ask(scheme, problem, y, other_h, other_dW)
        residual = own + step_residual(problem, y, answer, other_h, other_dW, scheme)
        allowed = amplified * float(residual.max())
        distance = float(np.max(np.abs(answer - y1)))
        detail = (
            f"y1 = {y1.tolist()}; with {name}, h = {other_h!r}, dW = {other_dW.tolist()}: {answer.tolist()}"
        )
        worst = max(
            worst, Measurement(distance / unit, allowed / unit, detail), key=lambda m: (m.ratio, m.bound)
        )
    return worst


def splits(problem: Problem, h: float, dW: Array) -> list[tuple[str, float, Array]]:
    """(name, h, dW) with the same Δ up to its rounding and |h| + Σ|c_jΔW_j| no larger: h keeps its sign."""
    c = problem.c
    driven = np.flatnonzero(c)
    if not driven.size:
        return []
    j, delta, none = int(driven[-1]), float(problem.random_step(h, dW)), np.zeros_like(dW)
    found = []
    for name, share in (("half of h in the noise", 0.5), ("nearly all of h in the noise", 2.0**-10)):
        moved = dW.copy()
        moved[j] += (1 - share) * h / c[j]
        found.append((name, share * h, moved))
    if driven.size > 1:
        moved, i = dW.copy(), int(driven[0])
        moved[i] /= 2
        moved[j] += c[i] * moved[i] / c[j]
        found.append(("half of one noise in another", h, moved))
    if delta * h > 0:
        found.append(("all of Δ in h", delta, none))
    return [(name, a, b) for name, a, b in found if a != h or not np.array_equal(b, dW)]


law = searched(
    name="random-step",
    statement="h and the increments act only through Δ = h + Σ c_j ΔW_j",
    source="(2.1)",
    unit="ulp of y",
    cost=0.6,
    steps=336,
    cases=cases,
    check=check,
    fixed_cases=fixed_cases,
)


def test_random_step(scheme: Scheme, effort: Effort) -> None:
    require(law, scheme, effort)
