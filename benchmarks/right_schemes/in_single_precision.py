"""Schemes that compute their step in single precision,
with the claims of binary64 that they can keep.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from benchmarks.right_schemes.solved_otherwise import Refused
from sepv.problem import Problem
from sepv.record import gauss_legendre
from sepv.schemes import Scheme, energy_preserving, leapfrog, midpoint

# Laws whose orders are hidden by rounding, and laws that hold for (2.1) in binary64 only.
_HIDDEN_BY_ROUNDING = {"local-mean", "local-mean-square", "local-weak", "reproducibility"}
_SINGLE_SWEEPS, _SINGLE_NODES = 700, 10


def _swept(problem: Problem, y: Any, delta: Any, average: bool) -> Any:
    """(2.1) or the midpoint rule by sweeps to stagnation; every array is of single precision."""
    z, last = np.zeros_like(y), np.inf
    points = gauss_legendre(_SINGLE_NODES) if average else (np.array([0.5]), np.array([1.0]))
    with np.errstate(all="ignore"):
        for _ in range(_SINGLE_SWEEPS):
            g = np.zeros_like(y)
            for t, w in zip(*points, strict=True):
                g += np.float32(w) * np.float32(problem.gradient(y + np.float32(t) * z))
            new = delta * (np.float32(problem.structure(y + np.float32(0.5) * z)) @ g)
            move = float(np.max(np.abs(new - z)))
            z, before, last = new, last, move
            if not np.isfinite(move):
                break
            if move == 0 or (move >= before and move <= 1e-6 * float(np.max(np.abs(y) + np.abs(z)))):
                return y + z
    raise Refused("no convergence")


def _step(average: bool) -> Any:
    def step(problem: Problem, y: Any, h: float, dW: Any) -> Any:
        return _swept(problem, y, np.float32(problem.random_step(h, dW)), average)

    return step


def _kicked(problem: Problem, y: Any, h: float, dW: Any) -> Any:
    """Kick, drift, kick for H = T(p) + V(q), y = (p, q), of a state or a batch,
    in the precision of the arguments.
    """
    n, delta = problem.dimension // 2, problem.random_step(h, dW).astype(dW.dtype)
    p = y[:n] - np.float32(0.5) * delta * np.float32(problem.gradient(y)[n:])
    q = y[n:] + delta * np.float32(problem.gradient(np.concatenate([p, y[n:]]))[:n])
    return np.concatenate(
        [p - np.float32(0.5) * delta * np.float32(problem.gradient(np.concatenate([p, q]))[n:]), q]
    )


SINGLE_PRECISION_SCHEMES: tuple[Scheme, ...] = (
    Scheme(
        "leapfrog-in-single-precision",
        _kicked,
        claims=["contract", "symmetry", "poisson-map:constant", "volume", "noise-sum"],
        source=f"{leapfrog.source}, in single precision",
        batched=True,
        systems="canonical-separable",
        dtype="float32",
    ),
    *(
        replace(
            scheme,
            name=f"{scheme.name}-in-single-precision",
            step=_step(average),
            claims=frozenset(scheme.claims) - _HIDDEN_BY_ROUNDING,
            mean_square_order=None,
            weak_order=None,
            solve=None,
            batched=False,
            dtype="float32",
            source=f"{scheme.source}, in single precision",
        )
        for scheme, average in ((energy_preserving, True), (midpoint, False))
    ),
)
