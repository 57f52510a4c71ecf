"""Equations of schemes for special classes of systems,
to be passed to `sepv.reference.steps.reference_step`.
"""

from __future__ import annotations

from sepv.reference.arithmetic import Vector
from sepv.reference.equations import Equation, Step
from sepv.reference.problem import ExactProblem

from sepv.errors import UsageError
from sepv.problem import Systems


def _both_invariants(problem: ExactProblem, y0: Vector, step: Step, y1: Vector) -> Vector:
    """The residual y1 − y0 − Δ g((y0 + y1)/2) (∇̄H × ∇̄C), both gradients averaged,
    for B(y)v = g(y)(v × ∇C(y)).
    """
    if problem.factor is None or problem.mean_casimir_gradient is None:
        raise UsageError(
            expected="a problem with a Casimir and a factor in dimension 3",
            received=f"{problem.data!r:.80}",
            remedy="describe it with sepv.problems.nambu_system",
        )
    half = problem.number(0.5)
    u, v = problem.mean_gradient(y0, y1), problem.mean_casimir_gradient(y0, y1)
    product = [u[i] * v[j] - u[j] * v[i] for i, j in ((1, 2), (2, 0), (0, 1))]
    factor = step.delta * problem.factor([half * (a + b) for a, b in zip(y0, y1, strict=True)])
    return [b - a - factor * p for a, b, p in zip(y0, y1, product, strict=True)]


def _several_structures(problem: ExactProblem, y0: Vector, step: Step, y1: Vector) -> Vector:
    """The residual y1 − y0 − [h B(ȳ) + Σ c_j ΔW_j G_j(ȳ)] ∇̄H, ȳ = (y0 + y1)/2;
    G_j = B if there is one structure.
    """
    half = problem.number(0.5)
    middle = [half * (a + b) for a, b in zip(y0, y1, strict=True)]
    B, mean = problem.structure(middle), problem.mean_gradient(y0, y1)
    if problem.noise_structures is None:
        factors, structures = [step.delta], [B]
    else:
        factors, structures = [step.h, *step.dW], [B, *problem.noise_structures(middle)]
    moved = list(y0)
    for factor, G in zip(factors, structures, strict=True):
        moved = [a + factor * b for a, b in zip(moved, problem.turned(G, mean), strict=True)]
    return [b - a for a, b in zip(moved, y1, strict=True)]


def equation_for(systems: Systems, stages: int = 1) -> str | Equation:
    """The reference equation of a scheme with `stages` stages for the class of systems
    `systems`.
    """
    if systems is Systems.NAMBU:
        return BOTH_INVARIANTS
    if systems is Systems.SEVERAL:
        return SEVERAL_STRUCTURES
    return "energy-preserving" if stages == 1 else f"collocation-{stages}"


SEVERAL_STRUCTURES = Equation(
    "several-structures", "§1", _several_structures, lambda _problem, _y0, _step, y1: y1
)
BOTH_INVARIANTS = Equation(
    "both-invariants", "(2.1) with ∇C averaged too", _both_invariants, lambda _problem, _y0, _step, y1: y1
)
