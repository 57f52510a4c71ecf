"""Maps for charges in a magnetic field b(x), which keep volume and are not symplectic: y = (x, v),
H = ½|v|² + φ(x).

B(y) = ((0, I), (−I, W(x))),    Wv = v × b
"""

from __future__ import annotations

import numpy as np

from sepv.problem import Array, PolynomialSystem, Problem
from sepv.record import poly
from sepv.schemes import Scheme


def _field() -> PolynomialSystem:
    """The system with b = (x_2/2, −x_3/4, 1 + x_1²/2), whose divergence is 0,
    and φ = ½|x|² + x_1x_2x_3/4.
    """
    d, one = 6, poly.constant(6, 1.0)
    b = (
        poly.scale(0.5, poly.variable(d, 1)),
        poly.scale(-0.25, poly.variable(d, 2)),
        poly.add(one, poly.polynomial(d, {(2, 0, 0, 0, 0, 0): 0.5})),
    )
    turning = ((3, 4, b[2]), (3, 5, poly.scale(-1.0, b[1])), (4, 5, b[0]))
    B = (*((k, 3 + k, one) for k in range(3)), *turning)
    H = poly.add(poly.squares((1.0,) * d), poly.polynomial(d, {(1, 1, 1, 0, 0, 0): 0.25}))
    return PolynomialSystem(d, H, B, (0.5,))


def _boris(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    """The step of J. P. Boris (1970): drift, half a kick, rotation by Cayley's transform,
    half a kick, drift.
    """
    delta = problem.random_step(h, dW)
    x = y[:3] + 0.5 * delta * y[3:]
    middle = np.concatenate([x, 0 * x])
    kick, W = -0.5 * delta * problem.gradient(middle)[:3], 0.5 * delta * problem.structure(middle)[3:, 3:]
    v = np.linalg.solve(np.eye(3) - W, (np.eye(3) + W) @ (y[3:] + kick)) + kick
    return np.concatenate([x + 0.5 * delta * v, v])


CHARGE_SCHEMES = (
    Scheme(
        name="boris",
        step=_boris,
        claims=("volume", "symmetry", "noise-sum", "random-step"),
        source="the Boris pusher with the random step",
        problems=(_field(),),
    ),
)
