"""E[H_0(y1)] = H_0(y0) + hσ where LH_0 = ½ Σ_j c_j² {{H_0, H_j}, H_j} is a constant σ: the trace formula.

L is the generator. Where LH_0 = σ everywhere, d/dt E[H_0] = σ for the exact solution, over any time: additive noise
along which H_0 is quadratic, σ = ½ Σ c_j² f_jᵀH_0″f_j (D. Cohen and G. Vilmart, Int. J. Comput. Math. 99, 2022). The
expectation is by quadrature over the increments; nothing is sampled.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sepv import problems
from sepv.errors import Skipped
from sepv.problem import Array, GivenProblem, HamiltoniansProblem, PolynomialSystem, Problem, Systems
from sepv.problems._polynomial_system import drift_of_energy
from sepv.record import PolynomialMap
from sepv.record._binary64 import EPS, TINY
from sepv.schemes import Scheme, ask
from sepv.verification import (
    Case,
    Cases,
    Effort,
    Measurement,
    energy_bound,
    energy_ulp,
    require,
    searched,
    step_residual,
)
from sepv.verification._contraction import contraction_ball
from sepv.verification._orders.gaussian import rule_for
from sepv.verification._tolerance import operations


def steady(case: Case) -> Case | None:
    """Shorten the step of a system with constant drift of E[H_0] to h + 4√h Σ c_j inside the contraction radius."""
    data = case.problem
    if isinstance(data, GivenProblem) and isinstance(data.problem.data, PolynomialSystem):
        data = data.problem.data
    if not isinstance(data, PolynomialSystem) or not isinstance(problems.build(data), HamiltoniansProblem):
        return None
    if drift_of_energy(data) is None:
        return None
    problem, y, _, _ = case.build()
    radius, noise = min(contraction_ball(problems.build(data), y)[0], 1.0), 4 * float(problem.c.sum())
    root = (-noise + (noise * noise + 4 * radius) ** 0.5) / 2
    return replace(case, problem=data, h=root * root, dW=(0.0,) * problem.noises)


def check(scheme: Scheme, case: Case) -> Measurement:
    """|E[H_0(y1)] − H_0(y0) − hσ|, against the sum of energy's bound at each node, H_0's rounding and the quadrature's.

    The quadrature's error is estimated by a rule with one node less in each variable. It is zero where H_0(y1) is a
    polynomial of the noise, as for schemes that obey this law. h > 0.
    """
    problem, y, h, _ = case.build()
    if (
        not isinstance(case.problem, PolynomialSystem)
        or not isinstance(problem, HamiltoniansProblem)
        or h <= 0
    ):
        raise Skipped("the law needs several Hamiltonians as data, and h > 0")
    rate = drift_of_energy(case.problem)
    if rate is None:
        raise Skipped("LH_0 is not constant")
    found, allowed = _mean(scheme, problem, y, h, 0)
    coarser, _ = _mean(scheme, problem, y, h, 1)
    start = float(problem.hamiltonian(y))
    defect = abs(found - start - h * rate)
    rounding = EPS * (operations(problem) * float(_size(problem, y)) + abs(h * rate))
    unit = float(energy_ulp(problem, y, y)) + EPS * (float(_size(problem, y)) + abs(h * rate)) + TINY
    bound = allowed + rounding + 2 * abs(found - coarser)
    detail = f"E[H(y1)] − H(y0) = {found - start!r}, expected hσ = {h * rate!r} with σ = {rate!r}"
    return Measurement(defect / unit, bound / unit, detail)


def _mean(scheme: Scheme, problem: Problem, y: Array, h: float, fewer: int) -> tuple[float, float]:
    """E[H_0(y1)], and a bound of its rounding error."""
    nodes = rule_for(scheme, problem, h, 4, fewer)
    noise = np.sqrt(h) * nodes.zeta
    states = np.repeat(y[:, None], noise.shape[1], axis=1)
    if scheme.batched:
        ends = ask(scheme, problem, states, h, noise)
    else:
        ends = np.stack([ask(scheme, problem, y, h, w) for w in noise.T], axis=1)
    dW = noise[: problem.noises]
    residual = step_residual(problem, states, ends, h, dW, scheme)
    wrong = energy_bound(problem, states, ends, residual) + EPS * operations(problem) * _size(problem, ends)
    weights = nodes.weights
    return float(problem.hamiltonian(ends)[nodes.index] @ weights), float(wrong[nodes.index] @ weights)


def _size(problem: Problem, y: Array) -> Array:
    """Σ |terms| of H_0, the scale of its rounding."""
    assert isinstance(problem.hamiltonian, PolynomialMap)
    return problem.hamiltonian.majorant(y)


_KEPT = "the exact flow keeps H: see the law energy"
law = searched(
    name="energy-drift",
    statement="E[H(y1)] = H(y0) + hσ where the generator makes of H a constant σ (trace formula)",
    source="trace formula",
    unit="ulp of H",
    cases=Cases(
        adapt=steady,
        why="the generator makes no constant of H_0, or the problems are not given as data",
        not_of=dict.fromkeys((Systems.SINGLE, Systems.NAMBU, Systems.SEVERAL), _KEPT),
        instead={Systems.HAMILTONIANS: Systems.SEPARABLE_HAMILTONIANS},
    ),
    check=check,
)


def test_energy_drift(scheme: Scheme, effort: Effort) -> None:
    require(law, scheme, effort)
