"""Correct schemes other than (2.1), each with its own claims: compositions, the exact flow,
other formulas.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from benchmarks.right_schemes.mechanical import MECHANICAL, UNIT_MASSES
from benchmarks.right_schemes.solved_otherwise import CLAIMS_OF_THE_CORE, Refused, like_the_core, of_lanes
from sepv.core.formula import CountedFields, Fields
from sepv.errors import Skipped
from sepv.problem import Array, Problem, noise_field, uniform_damping, vector_field
from sepv.record import EPS
from sepv.schemes import (
    TABLEAUX,
    PathSolver,
    Scheme,
    StatefulStep,
    Step,
    Systems,
    as_lanes,
    by_name,
    collocation,
    conformal,
    drift_and_noise,
    drift_preserving,
    energy_preserving,
    explicit_formula,
    gauss,
    implicit,
    midpoint,
    undamped,
)

# Claims of (2.1) that a scheme with a similar structure but another formula does not make.
_NOT_ITSELF = {"midpoint", "reduction", "reference", "refusal"}
_YOSHIDA_SHARE = 1 / (2 - 2 ** (1 / 3))


def _trapezoidal(fields: Fields, y: Any, z: Any, step: Any) -> Any:
    """The increment ½h(f(y0) + f(y1)) + S f((y0 + y1)/2): exchanging y0, y1 and the signs of h,
    S changes nothing.
    """
    drift = 0.5 * (fields.field(y) + fields.field(y + z))
    return step[0] * drift + step[1] * fields.field(y + 0.5 * z)


def _substeps(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    """⌈4|Δ|⌉ equal steps of (2.1), but one at least and eight at most."""
    state, noise = as_lanes(problem, y, h, dW)
    y1 = state.copy()
    counts = np.clip(np.ceil(4 * np.abs(problem.random_step(h, noise))), 1, 8)
    for n in np.unique(counts):
        lanes = np.flatnonzero(counts == n)
        for _ in range(int(n)):
            y1[:, lanes] = energy_preserving.step(problem, y1[:, lanes], h / n, noise[:, lanes] / n)
    return y1.reshape(y.shape)


def _sra1(problem: Problem, y: Array, h: float, dW: Array, H: Array) -> Array:
    """One step of SRA1; I_(j,0) = h(½ΔW_j + H_j)."""
    first, noise, area = vector_field(problem, y), np.zeros_like(y), np.zeros_like(y)
    for j, c in enumerate(problem.c):
        g = c * noise_field(problem, j, y)
        noise, area = noise + g * dW[j], area + g * (0.5 * dW[j] + H[j])
    second = vector_field(problem, y + 0.75 * h * first + 1.5 * area)
    return y + h * (first / 3 + 2 / 3 * second) + noise


def _milstein_by_differences(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    """One step of Milstein's scheme, with ½f′f S² by a central difference of width √|h|."""
    f, S = vector_field(problem, y), problem.random_step(0.0, dW)
    width = abs(h) ** 0.5 or 2.0**-20
    change = vector_field(problem, y + width * f) - vector_field(problem, y - width * f)
    return y + (h + S) * f + 0.25 * S * S * change / width


def _composed(shares: Sequence[float]) -> Step:
    """Compose steps of (2.1) with these fractions of the step."""

    def step(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        for share in shares:
            y = energy_preserving.step(problem, y, share * h, share * dW)
        return y

    return step


# The tolerance that the exact flow states, because its errors have one sign. On the pendulum, in 60
# paths of 256 steps, the mean energy defect of a step was −0.024 and −0.032 of the rounding of a
# step, 3 and 4 standard errors from zero.
FLOW_TOLERANCE = EPS / 16


def flow(problem: Problem, y0: Array, delta: Array) -> Array:
    """The flow φ_Δ(y0), (d, M): order 8 in long floats with doubled substeps until two results
    agree, rounded once.
    """
    start: Any = y0.astype(np.longdouble)
    wide: Any = delta.astype(np.longdouble)
    value, open_ = start.copy(), np.arange(y0.shape[1])
    coarse = None
    with np.errstate(all="ignore"):
        for parts in (1, 2, 4, 8, 16, 32, 64, 128):
            y: Any = start[:, open_]
            for _ in range(parts):
                y = y + explicit_formula(
                    TABLEAUX[8], CountedFields(problem, y, y), y, None, wide[None, open_] / parts
                )
            value[:, open_] = y
            if coarse is not None:
                # The error of the finer result is about 2⁻⁸ of the difference of the two results.
                size = np.fmax(np.max(np.abs(start[:, open_]), axis=0), np.max(np.abs(y), axis=0))
                agree = np.max(np.abs(y - coarse), axis=0) <= FLOW_TOLERANCE * size
                open_, y = open_[~agree], y[:, ~agree]
            coarse = y
            if not open_.size:
                return value.astype(np.float64)
    raise Refused("128 parts of the step do not resolve the flow")


def _weak_two(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    """φ_Δ(y0) + ½f(y0)(S³ − 3c²hS), S = Σ c_jΔW_j, c² = Σ c_j².

    The added term has mean zero and a root mean square of h^{3/2}, so the mean-square order is 1.
    As a third Hermite polynomial it also has E(S³ − 3c²hS)S = 0, so it changes moments by O(h³),
    and the weak order is 2.
    """
    y0, noise = as_lanes(problem, y, h, dW)
    S = problem.random_step(0.0, noise)
    extra = 0.5 * (S**3 - 3 * float(np.sum(problem.c**2)) * h * S)
    y1 = flow(problem, y0, problem.random_step(h, noise)) + extra * vector_field(problem, y0)
    return y1.reshape(np.shape(y))


def _turned_about_axes(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    """Turn y about the axes 1, 2, 3, 2, 1 by the angular velocities ∂H/∂y_i:
    a splitting for the rigid body alone.
    """
    delta = float(problem.random_step(h, dW))
    for axis, share in ((0, 0.5), (1, 0.5), (2, 1.0), (1, 0.5), (0, 0.5)):
        angle, turned = -share * delta * problem.gradient(y)[axis], y.copy()
        i, j = (axis + 1) % 3, (axis + 2) % 3
        turned[i] = np.cos(angle) * y[i] - np.sin(angle) * y[j]
        turned[j] = np.sin(angle) * y[i] + np.cos(angle) * y[j]
        y = turned
    return y


def _turned_about_lines(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    """A splitting for rigid bodies with any inertia tensor: K = I⁻¹ is a sum of w vvᵀ,
    and each part turns y about v.

    The v are the axes e_i, with w = K_ii, and (e_i ± e_j)/√2, with w = ±K_ij, since y_i
    y_j = ½(v₊·y)² − ½(v₋·y)².
    """
    delta, axes = float(problem.random_step(h, dW)), np.eye(3)
    K = np.stack([problem.gradient(e) for e in axes], axis=1)
    parts = [(K[i, i], axes[i]) for i in range(3)]
    for i, j in ((0, 1), (0, 2), (1, 2)):
        parts += [(sign * K[i, j], np.sqrt(0.5) * (axes[i] + sign * axes[j])) for sign in (1.0, -1.0)]
    for weight, v in (*parts, *reversed(parts)):
        angle, along = -0.5 * delta * weight * (v @ y), (v @ y) * v
        across = np.array([v[1] * y[2] - v[2] * y[1], v[2] * y[0] - v[0] * y[2], v[0] * y[1] - v[1] * y[0]])
        y = y + np.sin(angle) * across - 2 * np.sin(0.5 * angle) ** 2 * (y - along)
    return y


def _taylor(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    """y0 + Δf + ½Δ²f′f with f′ = B′∇H + BH″ from the problem's own derivatives."""
    assert problem.structure_derivative is not None
    assert problem.hessian is not None
    delta, B, gradient = float(problem.random_step(h, dW)), problem.structure(y), problem.gradient(y)
    slope = np.einsum("ijk,j->ik", problem.structure_derivative(y), gradient) + B @ problem.hessian(y)
    f = B @ gradient
    return np.asarray(y + delta * f + 0.5 * delta**2 * (slope @ f))


def _pushed_at_once(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    """Add all of the additive noise, then take a step of (2.1) without noise.

    The step changes neither H nor C. Lie's composition has weak order 1, and for additive noise
    mean-square order 1.
    """
    y0, noise = as_lanes(problem, y, h, dW)
    return drift_preserving.step(problem, y0, h, noise, noise).reshape(np.shape(y))


def _damped_in_the_middle(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    """A symmetric composition: (2.1) for half of the step and its increments, all of the damping,
    and (2.1) again.
    """
    rate = uniform_damping(problem)
    if not rate:
        raise Skipped("for damped systems")
    y0, noise = as_lanes(problem, y, h, dW)
    first = undamped(problem, y0, 0.5 * h, 0.5 * noise)
    damped = np.exp(-h * rate) * first
    return undamped(problem, damped, 0.5 * h, 0.5 * noise).reshape(np.shape(y))


def _readme(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    """The midpoint rule of the README, which refuses a step that it cannot solve with an
    ArithmeticError.
    """
    delta = h + problem.c @ dW
    y1 = y.copy()
    for _ in range(200):
        middle = (y + y1) / 2
        before, y1 = y1, y + delta * problem.structure(middle) @ problem.gradient(middle)
        if np.abs(y1 - before).max() <= 1e-15 * np.abs(y1).max():
            return y1
    raise ArithmeticError("no convergence")


def _kept_force(problem: Problem, state: Any, h: float, dW: Array) -> Any:
    """Kick, drift, kick for H = T(p) + V(q), y = (p, q), with ∇V(q) from the step before."""
    y, slope = state
    n, delta = len(y) // 2, problem.random_step(h, dW)
    p = y[:n] - 0.5 * delta * slope[n:]
    q = y[n:] + delta * problem.gradient(np.concatenate([p, y[n:]]))[:n]
    slope = problem.gradient(np.concatenate([p, q]))
    return np.concatenate([p - 0.5 * delta * slope[n:], q]), slope


def _reversible_heun(problem: Problem, state: Any, h: float, dW: Array) -> Any:
    """Reversible Heun: z1 = 2y − z + Δf(z), y1 = y + ½Δ(f(z) + f(z1));
    z depends on the earlier states of the path.
    """
    y, z, f = state
    delta = problem.random_step(h, dW)
    z1 = 2 * y - z + delta * f
    f1 = vector_field(problem, z1)
    return y + 0.5 * delta * (f + f1), z1, f1


def _reversible_heun_paths(problem: Problem, y0: Array, h: float, dW: Array) -> Array:
    """The states (N + 1, d, M) of reversible Heun over increments (N, m, M)."""
    y = np.repeat(y0[:, None], dW.shape[2], axis=1)
    states = [(y, y, vector_field(problem, y))]
    for row in dW:
        states.append(_reversible_heun(problem, states[-1], h, row))
    return np.array([y for y, _, _ in states])


def _divided(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    """The step of explicit-4, or two half steps where |Δ| > ¼."""
    y0, noise = as_lanes(problem, y, h, dW)
    step = by_name("explicit-4").step
    whole = step(problem, y0, h, noise)
    halves = step(problem, step(problem, y0, h / 2, noise / 2), h / 2, noise / 2)
    y1 = np.where(np.abs(problem.random_step(h, noise)) > 0.25, halves, whole)
    if not np.isfinite(y1).all():
        raise ArithmeticError("the step overflows")
    return y1.reshape(np.shape(y))


OTHER_FORMULAS: tuple[Scheme, ...] = (
    *MECHANICAL,
    UNIT_MASSES,
    Scheme(
        name="kept-force",
        step=StatefulStep(
            lambda problem, y: (y.copy(), problem.gradient(y)), _kept_force, lambda state: state[0]
        ),
        claims=(
            "reproducibility",
            "noise-sum",
            "random-step",
            "identity",
            "poisson-map:constant",
            "symmetry",
            "expansion",
            "long-time-energy",
        ),
        mean_square_order=1.0,
        weak_order=1.0,
        source="leapfrog that keeps its force",
        systems=Systems.CANONICAL_SEPARABLE,
        batched=True,
    ),
    Scheme(
        name="reversible-heun",
        step=StatefulStep(
            lambda problem, y: (y.copy(), y.copy(), vector_field(problem, y)),
            _reversible_heun,
            lambda state: state[0],
        ),
        claims=("noise-sum", "random-step", "expansion", "equivariance"),
        mean_square_order=1.0,
        weak_order=1.0,
        source="reversible Heun (Kidger et al., NeurIPS 2021), whose path keeps a second copy of y",
    ),
    Scheme(
        name="reversible-heun-by-paths",
        step=PathSolver(_reversible_heun_paths),
        claims=("noise-sum", "random-step", "expansion", "equivariance"),
        mean_square_order=1.0,
        weak_order=1.0,
        source="reversible Heun as a solver that computes whole paths only",
    ),
    Scheme(
        name="sra1",
        step=_sra1,
        claims=("reproducibility",),
        mean_square_order=1.5,
        weak_order=2.0,
        source="SRA1 of A. Rößler, SIAM J. Numer. Anal. 48 (2010), for additive noise, with space-time areas",
        systems=Systems.ADDITIVE,
        asks="space-time",
        truncation=None,
        batched=True,
    ),
    Scheme(
        name="milstein-by-differences",
        step=_milstein_by_differences,
        claims=("reproducibility", "truncation", "noise-sum"),
        mean_square_order=1.0,
        weak_order=1.0,
        source="Milstein's scheme with a central difference in the place of f′f",
        batched=True,
    ),
    Scheme(
        name="divided-long-steps",
        step=_divided,
        claims=("reproducibility", "truncation", "identity", "noise-sum", "random-step"),
        mean_square_order=2.0,
        weak_order=2.0,
        truncation=4,
        source="explicit-4 in two half steps where |Δ| > ¼, so that its order shows at small steps only",
        batched=True,
    ),
    like_the_core(
        "equal-substeps",
        _substeps,
        "(2.1) in up to eight equal parts of |Δ| ≤ ¼, so that its limit shows at small steps only",
        claims=CLAIMS_OF_THE_CORE - _NOT_ITSELF,
    ),
    like_the_core(
        "two-half-steps",
        _composed((0.5, 0.5)),
        "(2.1) twice with half the step",
        claims=CLAIMS_OF_THE_CORE - _NOT_ITSELF,
    ),
    like_the_core(
        "triple-jump",
        _composed((_YOSHIDA_SHARE, 1 - 2 * _YOSHIDA_SHARE, _YOSHIDA_SHARE)),
        "(2.1) composed to order 4 (Suzuki 1990, Yoshida 1990), backward in the middle",
        claims=CLAIMS_OF_THE_CORE - _NOT_ITSELF,
        mean_square_order=2.0,
        weak_order=2.0,
        truncation=4,
    ),
    like_the_core(
        "exact-flow",
        of_lanes(flow),
        "φ_Δ(y0), the flow itself",
        claims=(CLAIMS_OF_THE_CORE - _NOT_ITSELF - {"truncation"}) | {"invariant:casimir"},
        truncation=None,
        solver_tolerance=FLOW_TOLERANCE,
    ),
    Scheme(
        name="trapezoidal-drift",
        step=implicit(_trapezoidal, parts=drift_and_noise),
        claims=("contract", "reproducibility", "noise-sum", "symmetry", "equivariance", "truncation"),
        mean_square_order=1.0,
        weak_order=1.0,
        source="trapezoidal drift, midpoint noise: symmetric, and not a function of Δ alone",
        batched=True,
    ),
    Scheme(
        name="weak-two",
        step=_weak_two,
        claims=("contract", "reproducibility", "equivariance"),
        mean_square_order=1.0,
        weak_order=2.0,
        source="the flow with a noise of mean-square order 1 that the mean does not see",
        truncation=None,
        batched=True,
        solver_tolerance=FLOW_TOLERANCE,
    ),
    replace(
        midpoint,
        name="refuses-by-arithmetic-error",
        step=_readme,
        claims=frozenset(midpoint.claims) - {"reproducibility"},
        solve=None,
        batched=False,
        solver_tolerance=1e-15,
        source="the midpoint rule of the README",
    ),
    replace(collocation(3), name="three-stages", source="collocation with three stages"),
    replace(
        drift_preserving,
        name="pushed-at-once",
        step=_pushed_at_once,
        claims=frozenset(drift_preserving.claims) - {"symmetry"},
        weak_order=1.0,
        asks="",
        truncation=2,
        source="additive noise, then (2.1): the trace formula with clipped increments, without halves of a step",
    ),
    Scheme(
        name="turned-about-axes",
        step=_turned_about_axes,
        claims=("casimir", "poisson-map", "volume", "symmetry", "noise-sum", "random-step"),
        mean_square_order=1.0,
        source="exact flows of the parts of H = Σ y_i²/2I_i, composed symmetrically, without a look at B",
        systems=Systems.PRINCIPAL_BODIES,
    ),
    Scheme(
        name="taylor-by-derivatives",
        step=_taylor,
        claims=("identity", "noise-sum", "random-step", "expansion"),
        mean_square_order=1.0,
        order=2,
        source="Taylor's series of the flow at the random time, with derivatives that the problem must give",
        needs=("hessian", "structure_derivative"),
    ),
    Scheme(
        name="turned-about-lines",
        step=_turned_about_lines,
        claims=(
            "casimir",
            "poisson-map",
            "volume",
            "symmetry",
            "noise-sum",
            "random-step",
            "long-time-energy",
        ),
        mean_square_order=1.0,
        order=2,
        source="exact flows of nine parts of H = ½ yᵀI⁻¹y, composed symmetrically",
        systems=Systems.RIGID_BODIES,
    ),
    replace(
        conformal,
        name="damped-in-the-middle",
        step=_damped_in_the_middle,
        solve=None,
        source="damping between two half steps of (2.1)",
    ),
    replace(gauss(2), name="gauss-two", source="the Gauss method with two stages"),
)
