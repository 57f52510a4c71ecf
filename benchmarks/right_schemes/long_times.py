"""Methods whose energy stays near H(y_0) over long times for other reasons than that of usual
symplectic methods.

Reversible methods need not be symplectic, processed methods need not be symmetric, and high orders
reach rounding.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from benchmarks.right_schemes.solved_otherwise import Refused
from sepv.problem import Array, Problem, Systems, vector_field
from sepv.record import EPS
from sepv.schemes import (
    Explicit,
    KicksAndDrifts,
    Scheme,
    Step,
    composed_leapfrogs,
    energy_preserving,
    leapfrog,
)

# The most sweeps of a fixed-point iteration, and the size of corrections relative to |y| at which
# it may end.
_LOBATTO_MAX_SWEEPS, _LOBATTO_TOLERANCE = 200, 16 * EPS


def _runge_kutta(A: Sequence[Sequence[float]], b: Sequence[float]) -> Step:
    """An implicit Runge-Kutta method for problems without noise,
    by fixed-point iteration to stagnation.
    """

    def step(problem: Problem, y: Array, h: float, _dW: Array) -> Array:
        y0 = y.reshape(len(y), -1)
        k = np.repeat(vector_field(problem, y0)[None], len(b), axis=0)
        before = np.inf
        for _ in range(_LOBATTO_MAX_SWEEPS):
            new = np.array([vector_field(problem, y0 + h * np.tensordot(row, k, 1)) for row in A])
            move, k = abs(h) * float(np.max(np.abs(new - k))), new
            if move == 0 or (move >= before and move <= _LOBATTO_TOLERANCE * np.max(np.abs(y0))):
                return (y0 + h * np.tensordot(b, k, 1)).reshape(y.shape)
            before = move
        raise Refused("the fixed-point iteration does not converge")

    return step


def _processed(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    """The step π⁻¹, a leapfrog, π, where π = id + O(h³)
    is drift-kick-drift by h/3 after kick-drift-kick by −h/3.
    """
    third = h / 3
    y = leapfrog.step(problem, _other.step(problem, y, -third, dW), third, dW)
    y = leapfrog.step(problem, y, h, dW)
    return _other.step(problem, leapfrog.step(problem, y, -third, dW), third, dW)


def _projected(problem: Problem, y: Array, h: float, _dW: Array) -> Array:
    """Symmetric projection of the trapezoidal rule: ỹ = y + λ∇H(y), ỹ1 = Φ(ỹ), y1 = ỹ1 + λ∇H(y1),
    H(y1) = H(y).

    E. Hairer, BIT 40 (2000). The secant method from Newton's first step gives λ, and fixed-point
    iteration gives y1.
    """
    shape, y = y.shape, y.reshape(len(y), -1)
    g, H = problem.gradient(y), problem.hamiltonian(y)

    def end(share: Array) -> Array:
        start = _trapezoidal(problem, y + share * g, h, _dW)
        y1 = start
        for _ in range(_LOBATTO_MAX_SWEEPS):
            new = start + share * problem.gradient(y1)
            if np.max(np.abs(new - y1)) <= EPS * np.max(np.abs(y)):
                return new
            y1 = new
        raise Refused("the projection does not converge")

    last = np.zeros(y.shape[1])
    y1 = end(last)
    off, steepness = problem.hamiltonian(y1) - H, 2 * np.sum(g * g, axis=0)
    share = -off / np.where(steepness == 0, 1.0, steepness)
    for _ in range(20):
        y1 = end(share)
        new = problem.hamiltonian(y1) - H
        change = np.where(new == off, 0.0, -new * (share - last) / np.where(new == off, 1.0, new - off))
        if np.max(np.abs(new)) <= 4 * EPS * np.max(np.abs(H) + np.abs(y)) or not np.any(change):
            return y1.reshape(shape)
        last, off, share = share, new, share + change
    return y1.reshape(shape)


def _method(name: str, step: Any, order: float, source: str, *more: str, **facts: Any) -> Scheme:
    claims = ("long-time-energy", *more)
    return Scheme(name, step, claims, source, order=order, batched=True, noise=False, **facts)


# The fractions of a step in the composition by H. Yoshida, Phys. Lett. A 150 (1990), solution A of
# order 6.
_YOSHIDA_6 = (0.784513610477560, 0.235573213359357, -1.17767998417887)
_trapezoidal = _runge_kutta([[0, 0], [1 / 2, 1 / 2]], [1 / 2, 1 / 2])
_other = Scheme("drift, kick, drift", Explicit(KicksAndDrifts((0.0, 1.0, 0.0), (0.5, 0.5))))
_lobatto: Callable[..., Scheme] = lambda name, A, source: _method(  # noqa: E731 - one tableau a line
    name, _runge_kutta(A, [1 / 6, 2 / 3, 1 / 6]), 4, source, "symmetry"
)
LONG_TIME_SCHEMES = (
    _lobatto("lobatto-iiia", [[0, 0, 0], [5 / 24, 1 / 3, -1 / 24], [1 / 6, 2 / 3, 1 / 6]],
             "Lobatto IIIA with three stages: symmetric, not symplectic"),
    _lobatto("lobatto-iiib", [[1 / 6, -1 / 6, 0], [1 / 6, 1 / 3, 0], [1 / 6, 5 / 6, 0]],
             "Lobatto IIIB with three stages: symmetric, not symplectic"),
    _method("trapezoidal", _trapezoidal, 2, "the trapezoidal rule: conjugate to the midpoint rule", "symmetry"),
    _method("symmetric-projection", _projected, 2, "E. Hairer, BIT 40 (2000)", solver_tolerance=8 * EPS),
    _method("order-without-noise", energy_preserving.step, 2, "(2.1) for c = (): Quispel and McLaren (2008)", "energy"),
    _method("processed-leapfrog", _processed, 2, "a leapfrog between a corrector and its inverse: not symmetric",
            "poisson-map:constant", systems=Systems.MECHANICAL),
    _method("yoshida-6", Explicit(composed_leapfrogs((*_YOSHIDA_6, 1 - 2 * sum(_YOSHIDA_6), *_YOSHIDA_6[::-1]))), 6,
            "H. Yoshida (1990), order 6", "poisson-map:constant", "symmetry", systems=Systems.MECHANICAL),
)  # fmt: skip
