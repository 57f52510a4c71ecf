"""Lemma 3.2: y1 − y0 = aΔ + bΔ² + O(Δ³) with the random step Δ, f = B∇H, a = f and b = f′f/2.

If a scheme has mean-square order p > 1, it agrees with the flow up to Δ^2p, so that the local error
is O(h^{p+1}) in the mean and O(h^{p+1/2}) in the root mean square. So the coefficients of Δ³ … Δ^2p
are measured too, up to Δ⁸.

All cases have y0 = 0. If y0 had size 1, y1 would have a rounding error of eps, and b an error of
eps/Δ². With y0 = 0, y1 itself is the increment, with relative precision eps, so that b has an error
of eps/Δ. The polynomial systems have all the terms that f(0) and f′(0) need.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import lru_cache, partial
from typing import Any

import mpmath
import numpy as np
from sepv.reference.flow import flow_series

from sepv.errors import SepvError
from sepv.law import Case, Cases, Effort, Measurement, require, searched, step_residual
from sepv.law.cases.random_cases import ORIGIN_SHARE
from sepv.law.contraction import contraction_ball
from sepv.problem import (
    Array,
    PolynomialSystem,
    Problem,
    combined,
    combined_slope,
    derivative_along,
    hessian,
    one_field,
    one_hamiltonian,
    vector_field,
)
from sepv.record import TINY
from sepv.schemes import Scheme, ask

# The number of nodes of the interpolation, and the last power of Δ whose coefficient is judged.
# With 24 or more nodes in |Δ| ≤ ϱ/2, the coefficient of Δ⁸ has an error of 2e-6 r/ϱ⁸ (r, ϱ: see
# `_on`), and is 1e-7 to 1e-2 of r/ϱ⁸.
INTERPOLATION_NODES, LAST_POWER = 24, 8


# A function of a share s of the case's step that gives the arguments h and ΔW of a step with s Δ.
Arguments = Callable[[float], tuple[float, Array]]


def check(scheme: Scheme, case: Case) -> Measurement:
    """Measure the coefficients from steps with h > 0. If some are wrong,
    measure them along two lines of (h, ΔW) too.

    The steps with −Δ have the same h and another ΔW. If a scheme treats h and ΔW apart, its error
    may then be c|Δ|⁵, which is not analytic. The error is analytic on each line through (0, 0). One
    line has the steps with Δ, the other those with −Δ. The law holds if the coefficients are right
    on both lines.
    """
    problem, _, h, dW = case.build()
    if not one_field(problem):  # no noise reverses the drift: h changes its sign too
        return _on(scheme, case, lambda s: (s * h, s * dW))
    other = turned(problem, h, dW)

    def forward(s: float) -> tuple[float, Array]:
        return (s * h, s * dW) if s > 0 else (-s * h, -s * other)

    found = _on(scheme, case, forward)
    if found.violates:
        with suppress(SepvError):  # a scheme may refuse h < 0
            lines: list[Arguments] = [lambda s: (s * h, s * dW), lambda s: (-s * h, -s * other)]
            return max((_on(scheme, case, line) for line in lines), key=lambda m: m.ratio)
    return found


def _on(scheme: Scheme, case: Case, arguments: Arguments) -> Measurement:
    """Measure a and b of y1 = aΔ + bΔ² + c3Δ³ + … from steps with ±Δ and ±Δ/2,
    by parity and extrapolation.

    Here y0 = 0. Let ϱ be the contraction radius. For |Δ| ≤ ϱ, y1(Δ) is analytic and |y1| ≤ r, so
    that |c_k| ≤ r/ϱ^k (Cauchy). The odd part over Δ is a + c3Δ² + c5Δ⁴ + …, the even part over Δ²
    is b + c4Δ² + c6Δ⁴ + …. One Richardson step removes the terms in Δ². With x = Δ/ϱ, at most
    (r/ϱ)x⁴/(1 − x²) remains in a and (r/ϱ²)x⁴/(1 − x²) in b. A step's rounding is multiplied by at
    most 4/Δ in a and 16/Δ² in b (weights 4/3 and 1/3 at Δ/2 and Δ). If h stays positive and ΔW sets
    the sign of Δ, a scheme that weighs h and ΔW differently is detected.
    """
    problem, y, h, dW = case.build()
    radius, r = contraction_ball(problem, y)
    radius = min(radius, 1.0)
    values, rounding = {}, 0.0
    field, delta = (
        frozen(problem, h, dW) if not one_field(problem) else (problem, float(problem.random_step(h, dW)))
    )
    for share in (1.0, 0.5):
        for sign in (1.0, -1.0):
            step, noise = arguments(sign * share)
            y1 = ask(scheme, problem, y, step, noise)
            values[share, sign] = y1
            residual = step_residual(problem, y, y1, step, noise, scheme)
            rounding = max(rounding, float(residual.max()))
    x = delta / radius
    tail = x**4 / (1 - x * x)
    # Units are r/ϱ^k, from the largest field r/ϱ that the ball allows, because the field may vanish
    # at y0.
    measurements = []
    for name, power, parity, expected in (
        ("a = f", 1, -1.0, vector_field(field, y)),
        ("b = f′f/2", 2, 1.0, 0.5 * derivative_along(field, y, vector_field(field, y))),
    ):
        parts = [(values[s, 1.0] + parity * values[s, -1.0]) / (2 * (s * delta) ** power) for s in (1.0, 0.5)]
        measured = (4 * parts[1] - parts[0]) / 3
        unit = r / radius**power
        error = float(np.max(np.abs(measured - expected)))
        bound = unit * tail + 2 * 4**power / 2 * rounding / abs(delta) ** power + TINY
        detail = f"{name}: measured {measured.tolist()}, expected {expected.tolist()}"
        measurements.append(Measurement(error / unit, bound / unit, detail))
    return max(
        [*measurements, *higher_coefficients(scheme, case, radius / 2, r, arguments)], key=lambda m: m.ratio
    )


def turned(problem: Problem, h: float, dW: Array) -> Array:
    """Return increments that give −Δ with the same h: all are negated,
    and then c_1ΔW_1 is reduced by 2h.
    """
    noise = -dW
    noise[0] -= 2 * h / problem.c[0]
    return noise


def frozen(problem: Problem, h: float, dW: Array) -> tuple[Problem, float]:
    """Combine several structures, for fixed increments, into one system (1.1);
    return it and Δ = |h| + Σ|c_j ΔW_j|.

    Several Hamiltonians become one system with the structure B and the Hamiltonian (hH_0 + Σ c_j
    ΔW_j H_j)/Δ.
    """
    parts = np.array([h, *(problem.c * dW)])
    length = float(np.abs(parts).sum())
    if not one_hamiltonian(problem):
        weights, second = parts / length, [partial(hessian, problem, channel=F) for F in problem.channels]

        def summed(functions: Sequence[Any]) -> Any:
            return lambda y: sum(w * f(y) for w, f in zip(weights, functions, strict=True))

        return Problem(
            problem.dimension, problem.structure, problem.hamiltonian, summed(problem.gradients),
            hessian=summed(second), structure_derivative=problem.structure_derivative, check=False,
        ), length  # fmt: skip

    slope: Any = None
    if problem.structure_derivatives is not None:
        slope = lambda y: combined_slope(problem, y, parts / length)  # noqa: E731
    return Problem(
        problem.dimension,
        lambda y: combined(problem, y, parts / length),
        problem.hamiltonian,
        problem.gradient,
        hessian=problem.hessian,
        structure_derivative=slope,
        check=False,
    ), length


def higher_coefficients(
    scheme: Scheme, case: Case, radius: float, r: float, arguments: Arguments
) -> list[Measurement]:
    """Compare the coefficients of Δ³ … Δ^2p with those of the flow,
    for a scheme that claims mean-square order p.

    `radius` is ϱ, half the contraction radius, which allows for Lebesgue constants of stages (≤ 1.7
    for six stages). c_k is computed as Σ_j w_kj y1(Δ_j) from values at Chebyshev points, exactly
    for polynomials without constant term. Its error is bounded by the rest of the series, |c_m|
    ≤ r/ϱ^m (Cauchy), and by the rounding of each value.
    """
    last = min(LAST_POWER, round(2 * (scheme.mean_square_order or 1.0)))
    if last < 3:
        return []
    problem, y, h, dW = case.build()
    assert isinstance(case.problem, PolynomialSystem)
    points, weights, tails = interpolation()
    delta = float(problem.random_step(h, dW))
    values, rounding = [], []
    for x in points:
        step, noise = arguments(x * radius / delta)
        y1 = ask(scheme, problem, y, step, noise)
        values.append(y1)
        residual = step_residual(problem, y, y1, step, noise, scheme)
        rounding.append(float(residual.max()))
    exact = flow_series(case.problem, case.y, last)
    coefficients = []
    for k in range(3, last + 1):
        # `measured` and `expected` are coefficients in units of r/ϱ^k.
        measured = weights[k - 1] @ np.array(values) / r
        expected = np.array([float(v) * radius**k for v in exact[k]]) / r
        bound = tails[k - 1] + np.abs(weights[k - 1]) @ np.array(rounding) / r + TINY
        detail = f"coefficient of Δ^{k}: measured {(measured * r / radius**k).tolist()}, "
        detail += f"expected {(expected * r / radius**k).tolist()}"
        coefficients.append(Measurement(float(np.max(np.abs(measured - expected))), float(bound), detail))
    return coefficients


@lru_cache(maxsize=1)
def interpolation() -> tuple[Array, Array, Array]:
    """Return Chebyshev points x_j (n,), weights w_kj (k, n) for coefficients,
    and Σ_{m>n} |Σ_j w_kj x_j^m| (k,).
    """
    ctx = mpmath.mp.clone()
    ctx.dps = 50
    n = INTERPOLATION_NODES
    x = [ctx.cos(ctx.pi * (2 * j + 1) / (2 * n)) / 2 for j in range(n)]
    inverse = ctx.matrix([[xj ** (k + 1) for k in range(n)] for xj in x]) ** -1
    tails = [
        sum(abs(ctx.fsum(inverse[k, j] * x[j] ** m for j in range(n))) for m in range(n + 1, n + 60))
        for k in range(LAST_POWER)
    ]
    weights = [[float(inverse[k, j]) for j in range(n)] for k in range(LAST_POWER)]
    return np.array([float(v) for v in x]), np.array(weights), np.array([float(v) for v in tails])


def admits(case: Case) -> bool:
    """True if y0 = 0, c_1 = 1, h > 0, and h + Σ|c_jΔW_j| is at most 2·ORIGIN_SHARE of the
    contraction radius.
    """
    if not isinstance(case.problem, PolynomialSystem):
        return False
    problem, y, h, dW = case.build()
    if y.any() or not dW.size or problem.c[0] != 1 or h <= 0:
        return False
    radius = min(contraction_ball(problem, y)[0], 1.0)
    return h + float(np.abs(problem.c * dW).sum()) <= 2 * ORIGIN_SHARE * radius


law = searched(
    name="expansion",
    statement="y1 − y0 = fΔ + ½f′fΔ² + O(Δ³); for a claimed order p > 1 the series is the flow's up to Δ^2p",
    source="Lemma 3.2",
    unit="r/ϱ^k",
    cost=0.5,
    steps=156,
    middle="the coefficients of a step in the middle depend on the steps before: orders are those of whole paths",
    cases=Cases(
        where={
            "state": ("0",),
            "m": ("1", "2", "3–4", "5–20"),
            "|y|": ("1",),
            "|Δ|": ("1e-5–1e-2", "1e-14–1e-5"),
            "h": ("> 0",),
            "step/radius": ("½–1",),
        },
        adapt=lambda case: case if admits(case) else None,
        stays=False,
    ),
    check=check,
)


def test_expansion(scheme: Scheme, effort: Effort) -> None:
    require(law, scheme, effort)
