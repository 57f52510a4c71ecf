"""The schemes as equations, in the form in which papers print them, for numbers of any arithmetic.

An implicit scheme is residual(x) = 0 in its unknown x, and y1 = result(x); an explicit scheme has
no unknown. The equations are independent of the code of `sepv.schemes`, which this module does not
import.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

from sepv.reference.arithmetic import Number, Vector, total
from sepv.reference.problem import ExactProblem
from sepv.reference.tableau import stage_table, weighted_rule


class Step(NamedTuple):
    """One step: its size h, the noise S = Σ c_j ΔW_j and the random step Δ = h + S,
    in the problem's arithmetic.
    """

    h: Number
    S: Number
    delta: Number
    dW: tuple[Number, ...] = ()


# The default number of quadrature nodes if H is not a polynomial: enough for a first guess.
FEWEST_NODES = 24

Residual = Callable[[ExactProblem, Vector, Step, Vector], Vector]


@dataclass(frozen=True)
class Equation:
    """A one-step method as an equation residual(x) = 0 for its unknowns x,
    with the step's end y1 = result(x).

    Attributes
    ----------
    residual : (problem, y0, step, x) -> numbers, or None
        None for an explicit method.
    result : (problem, y0, step, x) -> y1
    blocks : int
        x has blocks · d components. blocks is 1, or the number of stages, or 0 for an explicit
        method.
    of_increments : bool
        True if x holds increments, which vanish with Δ; False if x is y1.
    nodes : int
        The number of quadrature nodes of a method with stages if H is not a polynomial; 0 if the
        rule is exact.
    """

    name: str
    source: str
    residual: Residual | None
    result: Residual
    blocks: int = 1
    of_increments: bool = False
    nodes: int = 0


def make_step(problem: ExactProblem, h: float, dW: tuple[float, ...]) -> Step:
    """The `Step` with the size h and the noise increments dW, each converted exactly from
    binary64.
    """
    exact = problem.number(h)
    S = total([problem.number(0.0), *(c * problem.number(w) for c, w in zip(problem.noise, dW, strict=True))])
    return Step(exact, S, exact + S, tuple(problem.number(w) for w in dW))


def _middle(problem: ExactProblem, y0: Vector, y1: Vector) -> Vector:
    half = problem.number(0.5)
    return [half * (a + b) for a, b in zip(y0, y1, strict=True)]


def _one_step(right: Residual) -> Residual:
    """The equation of a one-step method y1 = y0 + right(y1): its residual is y1 − y0
    − right(y1).
    """
    return lambda problem, y0, step, y1: [
        b - a - r for a, b, r in zip(y0, y1, right(problem, y0, step, y1), strict=True)
    ]


def _times(factor: Number, v: Vector) -> Vector:
    return [factor * w for w in v]


def _plus(*vectors: Vector) -> Vector:
    return [total(components) for components in zip(*vectors, strict=True)]


def _energy_preserving(problem: ExactProblem, y0: Vector, step: Step, y1: Vector) -> Vector:
    """The increment y1 − y0 of scheme (2.1): Δ B((y0 + y1)/2) ∫₀¹∇H(y0 + τ(y1 − y0))dτ."""
    B = problem.structure(_middle(problem, y0, y1))
    return _times(step.delta, problem.turned(B, problem.mean_gradient(y0, y1)))


def _averaged_vector_field(problem: ExactProblem, y0: Vector, step: Step, y1: Vector) -> Vector:
    """The increment y1 − y0 of scheme (2.2), for constant B: Δ B(y0) ∫₀¹∇H(y0 + τ(y1 − y0))dτ."""
    return _times(step.delta, problem.turned(problem.structure(y0), problem.mean_gradient(y0, y1)))


def _midpoint(problem: ExactProblem, y0: Vector, step: Step, y1: Vector) -> Vector:
    """The increment y1 − y0 of the midpoint rule (3.4): Δ f((y0 + y1)/2)."""
    return _times(step.delta, problem.field(_middle(problem, y0, y1)))


def coordinate_increments(problem: ExactProblem, y0: Vector, y1: Vector) -> Vector:
    """The discrete gradient ∇̄₁H(y0, y1): entry i averages ∂_iH as y_i moves,
    with earlier components already at y1.
    """
    corners = [[*y1[:i], *y0[i:]] for i in range(len(y0) + 1)]
    return [problem.mean_gradient(corners[i], corners[i + 1])[i] for i in range(len(y0))]


def _discrete_gradient(problem: ExactProblem, y0: Vector, step: Step, y1: Vector) -> Vector:
    """The increment of §4's discrete gradient method: (h B(y0) + S B((y0 + y1)/2))
    ½(∇̄₁H(y0, y1) + ∇̄₁H(y1, y0)).

    ∇̄₁H is that of `coordinate_increments`, and S = Σ c_j ΔW_j.
    """
    mean = _middle(problem, coordinate_increments(problem, y0, y1), coordinate_increments(problem, y1, y0))
    drift = problem.turned(problem.structure(y0), mean)
    noise = problem.turned(problem.structure(_middle(problem, y0, y1)), mean)
    return _plus(_times(step.h, drift), _times(step.S, noise))


def _euler_heun(problem: ExactProblem, y0: Vector, step: Step, _: Vector) -> Vector:
    """One step of Euler-Heun, §4: y0 + h f(y0) + ½ S (f(ŷ) + f(y0)), ŷ = y0 + (h + S) f(y0),
    S = Σ c_j ΔW_j.
    """
    f0 = problem.field(y0)
    predicted = _plus(y0, _times(step.delta, f0))
    return _plus(y0, _times(step.h, f0), _times(step.S, _middle(problem, problem.field(predicted), f0)))


def _milstein(problem: ExactProblem, y0: Vector, step: Step, _: Vector) -> Vector:
    """Milstein, S = Σc_jΔW_j: y0 + f Δ + ½ f′f S², in Itô form y0 + (f + ½Σc_j² f′f)h + f S + ½ f′f
    (S² − Σc_j² h).
    """
    f0 = problem.field(y0)
    half_S2 = problem.number(0.5) * step.S * step.S
    return _plus(y0, _times(step.delta, f0), _times(half_S2, problem.field_slope(y0, f0)))


def _euler_maruyama(problem: ExactProblem, y0: Vector, step: Step, _: Vector) -> Vector:
    """One step of Euler-Maruyama, §4, in Itô form: y0 + (f + ½Σc_j² f′f)h + f S with S = Σ c_j
    ΔW_j.
    """
    f0 = problem.field(y0)
    correction = problem.number(0.5) * total([problem.number(0.0), *(c * c for c in problem.noise)]) * step.h
    return _plus(y0, _times(step.delta, f0), _times(correction, problem.field_slope(y0, f0)))


def in_blocks(x: Vector, stages: int) -> list[Vector]:
    """Cut a vector of unknowns into blocks of d numbers, one block for each stage."""
    d = len(x) // stages
    return [x[i * d : (i + 1) * d] for i in range(stages)]


def combined(y0: Vector, weights: Vector, K: list[Vector]) -> Vector:
    """The state y0 + Σ_j weights_j K_j, with the K_j of a Runge-Kutta method."""
    return _plus(y0, *(_times(a, v) for a, v in zip(weights, K, strict=True)))


@cache
def gauss(stages: int) -> Equation:
    """The s-stage Gauss Runge-Kutta method with step Δ: K_i = Δ f(y0 + Σ a_ij K_j),
    y1 = y0 + Σ b_j K_j.
    """

    def residual(problem: ExactProblem, y0: Vector, step: Step, x: Vector) -> Vector:
        table, K = stage_table(stages, problem.arithmetic), in_blocks(x, stages)
        residuals: Vector = []
        for row, stage in zip(table.a, K, strict=True):
            right = _times(step.delta, problem.field(combined(y0, row, K)))
            residuals += [k - r for k, r in zip(stage, right, strict=True)]
        return residuals

    return Equation(
        f"gauss-{stages}", "Hairer, Nørsett, Wanner, II.7", residual, _stage_result(stages), stages, True
    )


@cache
def collocation(stages: int, nodes: int = 0) -> Equation:
    """The s-stage energy-preserving collocation method with Gauss nodes c_i and step Δ.

    Cohen and Hairer (BIT 51, 2011): u is the polynomial of degree s with u(0) = y0 and u′(c_i) = Δ
    B(u(c_i)) ∫₀¹ (ℓ_i(τ)/b_i) ∇H(u(τ))dτ, where ℓ_i is the Lagrange basis; y1 = u(1). The unknowns
    are K_i = u′(c_i). If H has degree ν, the integrand has degree sν − 1; if H is not a polynomial,
    `nodes` quadrature nodes are used.
    """

    def residual(problem: ExactProblem, y0: Vector, step: Step, x: Vector) -> Vector:
        table, K = stage_table(stages, problem.arithmetic), in_blocks(x, stages)
        if stages == 1:
            return _one_stage(problem, y0, step, x)
        count = (
            (nodes or FEWEST_NODES) if problem.degree is None else max(1, -(-stages * problem.degree // 2))
        )
        slopes = [
            (weights, problem.gradient(combined(y0, integrals, K)))
            for weights, integrals in weighted_rule(stages, count, problem.arithmetic)
        ]
        residuals: Vector = []
        for i, stage in enumerate(K):
            mean = _plus(*(_times(weights[i], g) for weights, g in slopes))
            B = problem.structure(combined(y0, table.a[i], K))
            residuals += [
                k - r for k, r in zip(stage, _times(step.delta, problem.turned(B, mean)), strict=True)
            ]
        return residuals

    return Equation(
        f"collocation-{stages}",
        "Cohen and Hairer (2011)",
        residual,
        _stage_result(stages),
        stages,
        True,
        nodes,
    )


def _one_stage(problem: ExactProblem, y0: Vector, step: Step, K: Vector) -> Vector:
    """The residual for one stage: scheme (2.1) with y1 = y0 + K,
    whose averaged gradient has a closed form.
    """
    right = _energy_preserving(problem, y0, step, _plus(y0, K))
    return [k - r for k, r in zip(K, right, strict=True)]


def _stage_result(stages: int) -> Residual:
    def result(problem: ExactProblem, y0: Vector, _: Step, x: Vector) -> Vector:
        return combined(y0, stage_table(stages, problem.arithmetic).b, in_blocks(x, stages))

    return result


def _implicit(name: str, source: str, right: Residual) -> Equation:
    return Equation(name, source, _one_step(right), lambda _problem, _y0, _step, y1: y1)


def _explicit(name: str, source: str, update: Residual) -> Equation:
    return Equation(name, source, None, update, blocks=0)


EQUATIONS: dict[str, Equation] = {
    e.name: e
    for e in (
        _implicit("energy-preserving", "(2.1)", _energy_preserving),
        _implicit("averaged-vector-field", "(2.2)", _averaged_vector_field),
        _implicit("midpoint", "(3.4)", _midpoint),
        _implicit("discrete-gradient", "§4", _discrete_gradient),
        _explicit("euler-heun", "§4", _euler_heun),
        _explicit("milstein", "§4, Itô form", _milstein),
        _explicit("euler-maruyama", "§4, Itô form", _euler_maruyama),
        *(gauss(s) for s in range(1, 7)),
        *(collocation(s) for s in range(1, 7)),
    )
}
