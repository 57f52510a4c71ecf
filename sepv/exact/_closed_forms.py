"""Closed forms of the flow of y′ = B(y)∇H(y) for the oscillator, the rigid body and the pendulum.

Each function gets the parameters, y0 (d,) and times θ (M,), and returns the states (d, M) and the
method's name. It returns None where its formula degenerates (equal moments of inertia, near a
separatrix): the flow is then numerical.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from sepv.exact._jacobi import argument, jacobi
from sepv.problem import Array

Parameters = Mapping[str, tuple[float, ...]]
Result = tuple[Array, str] | None

# The least |m − 1| for the parameter m of elliptic functions. On the separatrix m = 1, and near it
# they lose digits.
SEPARATRIX = 1e-4
_JACOBI = "Jacobi elliptic functions"


def oscillator(_: Parameters, y0: Array, theta: Array) -> Result:
    """The exact flow of the oscillator, dp = −x dθ, dx = p dθ: a rotation by θ."""
    cos, sin = np.cos(theta), np.sin(theta)
    return np.stack([y0[0] * cos - y0[1] * sin, y0[0] * sin + y0[1] * cos]), "rotation"


def pendulum(_: Parameters, y0: Array, theta: Array) -> Result:
    """The exact flow of the pendulum by elliptic functions, with k² = sin²(q/2) + p²/4 = (H + 1)/2.

    Libration, k < 1: sin(q/2) = k sn, p/2 = k cn, cos(q/2) = dn at (θ + u0, k²), with u0 from y0 at
    θ = 0. Rotation, k > 1, with s the sign of p: q/2 = s am, p/2 = s k dn at (kθ + u0, 1/k²).
    """
    p, q = y0
    turns = np.round(q / (2 * np.pi))
    half = 0.5 * (q - 2 * np.pi * turns)
    k2 = np.sin(half) ** 2 + 0.25 * p * p
    k = np.sqrt(k2)
    if abs(k2 - 1) < SEPARATRIX:
        return None
    if k2 < 1:
        u0 = argument(np.arctan2(np.sin(half), 0.5 * p), k2)
        sn, cn, dn, _angle = jacobi(theta + u0, k2)
        return np.stack([2 * k * cn, 2 * np.arctan2(k * sn, dn) + 2 * np.pi * turns]), _JACOBI
    s = np.sign(p)
    _sn, _cn, dn, angle = jacobi(k * theta + argument(s * half, 1 / k2), 1 / k2)
    return np.stack([2 * s * k * dn, 2 * s * angle + 2 * np.pi * turns]), _JACOBI


def rigid_body(parameters: Parameters, y0: Array, theta: Array) -> Result:
    """The exact flow of the rigid body, y′ = y × (y/I), by elliptic functions;
    axes are sorted by I_a < I_b < I_c.

    y_a′ = −σA_a y_b y_c, y_b′ = σA_b y_a y_c, y_c′ = −σA_c y_a y_b with A_a = 1/I_b
    − 1/I_c, A_b = 1/I_a − 1/I_c, A_c = 1/I_a − 1/I_b and σ the sign of the permutation.
    K_a = y_a²/A_a + y_b²/A_b and K_c = y_c²/A_c + y_b²/A_b are conserved. For K_a
    ≤ K_c: y_c = Y_c dn, y_a = Y_a cn, y_b = Y_b sn at (λθ + u0, m), λ² = A_aA_bA_cK_c,
    m = K_a/K_c. y0 gives u0 and the amplitudes Y. For K_a > K_c, a and c are exchanged.
    """
    inertia = np.array(parameters["inertia"])
    a, b, c = np.argsort(inertia)
    sigma = 1.0 if (a, b, c) in ((0, 1, 2), (1, 2, 0), (2, 0, 1)) else -1.0
    A_a, A_b, A_c = (1 / inertia[i] - 1 / inertia[j] for i, j in ((b, c), (a, c), (a, b)))
    if min(A_a, A_c) <= SEPARATRIX * A_b:
        return None
    K_a = y0[a] ** 2 / A_a + y0[b] ** 2 / A_b
    K_c = y0[c] ** 2 / A_c + y0[b] ** 2 / A_b
    if K_a > K_c:
        a, c, A_a, A_c, K_a, K_c = c, a, A_c, A_a, K_c, K_a
    if K_c == 0 or 1 - K_a / K_c < SEPARATRIX:
        return None
    m, rate = K_a / K_c, np.sqrt(A_a * A_b * A_c * K_c)
    s = 1.0 if y0[c] > 0 else -1.0
    phase = np.arctan2(sigma * s * y0[b] / np.sqrt(A_b), y0[a] / np.sqrt(A_a))
    sn, cn, dn, _ = jacobi(rate * theta + argument(phase, m), m)
    y = np.empty((3, theta.size))
    y[a] = np.sqrt(A_a * K_a) * cn
    y[b] = sigma * s * np.sqrt(A_b * K_a) * sn
    y[c] = s * np.sqrt(A_c * K_c) * dn
    return y, _JACOBI


CLOSED_FORMS: dict[str, Callable[[Parameters, Array, Array], Result]] = {
    "harmonic-oscillator": oscillator,
    "pendulum": pendulum,
    "rigid-body": rigid_body,
}
