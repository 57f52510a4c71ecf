"""The stochastic Lotka-Volterra system in three species, §4.4."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sepv.arguments import is_number
from sepv.errors import ProblemError
from sepv.nambu import Nambu
from sepv.problem import Array, Flow, Function, NamedProblem, Problem


def lotka_volterra(
    a: float = -2.0,
    b: float = -1.0,
    d: float = -0.5,
    nu: float = 1.0,
    mu: float = 2.0,
    noise: ArrayLike = 0.5,
) -> Problem:
    """B_12 = d y1y2, B_13 = bd y1y3, B_23 = −y2y3; H = ab y1 + y2 − a y3 + ν ln y2 − μ ln y3.

    From y = (1, 1.9, 0.5), in the octant y > 0. Its Casimir ln y1 + bd ln y2 − d ln y3 is not
    quadratic, so that (2.1) does not keep it. The defaults are those of §4.4: c = 0.5.
    """
    c = np.atleast_1d(np.asarray(noise, dtype=np.float64))
    if not all(is_number(v) for v in (a, b, d, nu, mu)):
        raise ProblemError(
            expected="finite parameters a, b, d, ν, μ",
            received=f"{(a, b, d, nu, mu)!r}",
            remedy="those of §4.4 are −2, −1, −0.5, 1, 2",
        )
    pairs = pairs_of(b, d)

    def structure(y: Array) -> Array:
        B = np.zeros((3, 3, *y.shape[1:]), dtype=y.dtype)
        for i, j, factor in pairs:
            B[i, j] = factor * y[i] * y[j]
            B[j, i] = -B[i, j]
        return B

    def structure_derivative(y: Array) -> Array:
        D = np.zeros((3, 3, 3, *y.shape[1:]), dtype=y.dtype)
        for i, j, factor in pairs:
            D[i, j, i], D[i, j, j] = factor * y[j], factor * y[i]
            D[j, i, i], D[j, i, j] = -D[i, j, i], -D[i, j, j]
        return D

    def hessian(y: Array) -> Array:
        H = np.zeros((3, 3, *y.shape[1:]), dtype=y.dtype)
        H[1, 1], H[2, 2] = -nu / (y[1] * y[1]), mu / (y[2] * y[2])
        return H

    def gradient(y: Array) -> Array:
        return np.stack([np.full_like(y[0], a * b), 1 + nu / y[1], -a - mu / y[2]])

    def mean_gradient(y0: Array, y1: Array) -> Array:
        mean_1, mean_2 = (_mean_reciprocal(y0[i], y1[i]) for i in (1, 2))
        return np.stack([np.full_like(y0[0], a * b), 1 + nu * mean_1, -a - mu * mean_2])

    # y_k ∂_kH, in which H = ab y1 + (y2 + ν ln y2) + (−a y3 − μ ln y3).
    slopes = (lambda x: a * b * x, lambda x: x + nu, lambda x: -a * x - mu)
    parameters = {"a": (a,), "b": (b,), "d": (d,), "nu": (nu,), "mu": (mu,), "noise": tuple(c.tolist())}
    return Problem(
        dimension=3,
        structure=structure,
        hamiltonian=lambda y: a * b * y[0] + y[1] - a * y[2] + nu * np.log(y[1]) - mu * np.log(y[2]),
        gradient=gradient,
        noise=c,
        hessian=hessian,
        structure_derivative=structure_derivative,
        mean_gradient=mean_gradient,
        domain=_positive,
        initial=(1.0, 1.9, 0.5),
        flows=tuple(exponential(k, pairs, slopes[k]) for k in range(3)),
        name="lotka-volterra",
        data=NamedProblem("lotka-volterra", tuple((k, tuple(map(float, v))) for k, v in parameters.items())),
        nambu=_nambu(b, d),
        check=False,
    )


def pairs_of(b: float = -1.0, d: float = -0.5) -> tuple[tuple[int, int, float], ...]:
    """(i, j, factor) with B_ij = factor · y_i · y_j."""
    return (0, 1, d), (0, 2, b * d), (1, 2, -1.0)


def exponential(k: int, pairs: tuple[tuple[int, int, float], ...], slope: Function) -> Flow:
    """The flow of the part H_k(y_k): y_k stays, and y_i′ = B_ik ∂_kH = ±factor y_i (y_k ∂_kH) is linear in y_i."""
    rates = [sum(f * (i == n and j == k) - f * (j == n and i == k) for i, j, f in pairs) for n in range(3)]

    def flow(y: Array, t: Array) -> Array:
        speed = t * slope(y[k])
        return np.stack([y[n] * np.exp(rates[n] * speed) if rates[n] else y[n] for n in range(3)])

    return flow


def _nambu(b: float, d: float) -> Nambu:
    """B(y)v = −y1y2y3 (v × ∇C) with C = ln y1 + bd ln y2 − d ln y3."""
    factors = (1.0, b * d, -d)

    def hessian(y: Array) -> Array:
        C = np.zeros((3, 3, *y.shape[1:]), dtype=y.dtype)
        for i, factor in enumerate(factors):
            C[i, i] = -factor / (y[i] * y[i])
        return C

    return Nambu(
        factor=lambda y: -y[0] * y[1] * y[2],
        casimir=lambda y: np.log(y[0]) + b * d * np.log(y[1]) - d * np.log(y[2]),
        gradient=lambda y: np.stack([1 / y[0], b * d / y[1], -d / y[2]]),
        hessian=hessian,
        mean_gradient=lambda y0, y1: np.stack(
            [f * _mean_reciprocal(y0[i], y1[i]) for i, f in enumerate(factors)]
        ),
    )


def _positive(y: Array) -> NDArray[np.bool_]:
    inside: NDArray[np.bool_] = np.all(y > 0, axis=0)
    return inside


def _mean_reciprocal(x0: Array, x1: Array) -> Array:
    """∫₀¹ dτ/(x0 + τδ) = log1p(δ/x0)/δ, which is (1/x0)(1 − δ/(2x0) + …) as δ → 0: no 0/0."""
    ratio = (x1 - x0) / x0
    moves = ratio != 0
    return np.where(moves, np.log1p(ratio) / np.where(moves, ratio, 1.0), 1.0) / x0
