"""Right ports: two programs of one method that differ in loops, order of summation, solver,
precision or memory.

The law *agreement* must hold for each pair. `ports` has the pairs;
tests/verification/test_agreement.py measures them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from benchmarks.right_schemes import RIGHT_SCHEMES
from benchmarks.right_schemes.solved_otherwise import OTHERWISE_SOLVED
from sepv import schemes
from sepv.problem import Array, Problem
from sepv.schemes import Scheme, Twin

# The tolerance that the port of the midpoint rule states.
PORT_TOLERANCE = 1e-11
_DERIVATIVES = ("hessian", "structure_derivative")


def _noise(problem: Problem, dW: Array) -> float:
    """Σ c_j ΔW_j as a loop."""
    return sum(float(c) * float(w) for c, w in zip(problem.c, dW, strict=True))


def _field(problem: Problem, y: Array) -> Array:
    """B∇H as two loops over floats, each sum from the last term to the first."""
    B, slopes = problem.structure(y).tolist(), problem.gradient(y).tolist()
    rows = [sum((b * g for b, g in zip(row[::-1], slopes[::-1], strict=True)), 0.0) for row in B]
    return np.array(rows, dtype=np.float64)


def _derivative(problem: Problem, y: Array) -> Array:
    """The matrix f′ of f = B∇H."""
    assert problem.structure_derivative is not None
    assert problem.hessian is not None
    turns = np.einsum("ijk,j->ik", problem.structure_derivative(y), problem.gradient(y))
    return np.asarray(turns + problem.structure(y) @ problem.hessian(y))


def _euler_heun(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    S, f = _noise(problem, dW), _field(problem, y)
    return np.asarray(y + h * f + 0.5 * S * f + 0.5 * S * _field(problem, y + h * f + S * f))


def _euler_maruyama(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    f, correction = _field(problem, y), 0.5 * float(problem.c @ problem.c)
    return np.asarray(y + h * (f + correction * (_derivative(problem, y) @ f)) + _noise(problem, dW) * f)


def _milstein(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    """Milstein's scheme as textbooks have it: the Itô drift, and ½f′f(S² − Σc²h)."""
    f, square, S = _field(problem, y), float(problem.c @ problem.c), _noise(problem, dW)
    curve = _derivative(problem, y) @ f
    return np.asarray(y + h * (f + 0.5 * square * curve) + S * f + 0.5 * curve * (S * S - square * h))


def _runge_kutta(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    delta = h + _noise(problem, dW)
    k1 = _field(problem, y)
    k2 = _field(problem, y + delta / 2 * k1)
    k3 = _field(problem, y + delta / 2 * k2)
    k4 = _field(problem, y + delta * k3)
    return np.asarray(y + (delta * k1 / 6 + delta * k2 / 3 + delta * k3 / 3 + delta * k4 / 6))


def _midpoint(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    """The midpoint rule by sweeps that stop at a tolerance."""
    delta, z = h + _noise(problem, dW), np.zeros_like(y)
    for _ in range(200):
        z, before = delta * _field(problem, y + 0.5 * z), z
        if np.max(np.abs(z - before)) <= PORT_TOLERANCE * max(np.max(np.abs(y)), np.max(np.abs(y + z))):
            return np.asarray(y + z)
    raise ArithmeticError("no convergence")


def _pair(first: Scheme, second: Scheme) -> Scheme:
    return replace(first, twin=Twin(second), claims=frozenset(first.claims) | {"agreement"})


def ports() -> dict[str, Scheme]:
    """Schemes by name, each with its twin."""
    loops: Sequence[tuple[Scheme, Scheme]] = [
        (schemes.euler_heun, Scheme("euler-heun-loops", _euler_heun)),
        (schemes.euler_maruyama, Scheme("euler-maruyama-loops", _euler_maruyama, needs=_DERIVATIVES)),
        (schemes.milstein, Scheme("milstein-textbook", _milstein, needs=_DERIVATIVES)),
        (schemes.explicit(4), Scheme("runge-kutta-loops", _runge_kutta)),
        (schemes.midpoint, Scheme("midpoint-sweeps", _midpoint, solver_tolerance=PORT_TOLERANCE)),
        (Scheme("midpoint-sweeps", _midpoint, solver_tolerance=PORT_TOLERANCE), schemes.midpoint),
        (schemes.gauss(2), RIGHT_SCHEMES["gauss-two"]),
        (RIGHT_SCHEMES["stored-force"], RIGHT_SCHEMES["stored-force-reversed"]),
        (RIGHT_SCHEMES["adams-bashforth-2"], RIGHT_SCHEMES["adams-bashforth-2-by-paths"]),
        (RIGHT_SCHEMES["reversible-heun-by-paths"], RIGHT_SCHEMES["reversible-heun"]),
        (schemes.energy_preserving, RIGHT_SCHEMES["compensated"]),
        (schemes.energy_preserving, RIGHT_SCHEMES["energy-preserving-in-single-precision"]),
        (RIGHT_SCHEMES["energy-preserving-in-single-precision"], schemes.energy_preserving),
        *((schemes.energy_preserving, other) for other in OTHERWISE_SOLVED),
    ]
    return {f"{a.name} and {b.name}": _pair(a, b) for a, b in loops}
