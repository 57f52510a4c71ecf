"""Closed forms of the exact flow: rotation, and Jacobi's elliptic functions, at any precision.

These formulas evaluate no B or ∇H, and share with the Taylor series of `sepv.reference.flow` only
the problem.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from sepv.reference.arithmetic import Number, Vector, context
from sepv.reference.problem import Description
from sepv.reference.steps import require_digits

from sepv.errors import UsageError
from sepv.problem import NamedProblem

Parameters = Mapping[str, Vector]
Form = Callable[[Any, Parameters, Vector, Number], Vector]


def closed_form(data: Description, y: Sequence[float], theta: float, digits: int = 50) -> Vector:
    """The exact flow φ_θ(y) from its formula, to `digits` digits of the largest component.

    Near a separatrix, where the parameter m of the elliptic functions is near 1, the formulas lose
    digits. They are then evaluated with 2 log10(1/|1 − m|) digits more.

    Raises
    ------
    UsageError
        If the problem has no closed form, θ is not finite, or digits is out of range.
    """
    require_digits(digits)
    if not isinstance(data, NamedProblem) or data.name not in _ELLIPTIC_FORMS:
        raise UsageError(
            expected=f"a problem with a closed form: {', '.join(_ELLIPTIC_FORMS)}",
            received=f"{data!r:.60}",
            remedy="sepv.reference.flow.taylor follows the flow of any problem",
        )
    if not math.isfinite(theta):
        raise UsageError(expected="a finite θ", received=repr(theta), remedy="θ = t + Σ c_j W_j(t)")
    form, guard = _ELLIPTIC_FORMS[data.name], 20 + int(math.log10(1 + abs(theta)))
    ctx = context(digits + guard)
    distance = _to_separatrix(ctx, data, y)
    if distance:
        ctx = context(digits + guard + 2 * max(0, -int(ctx.log10(distance))))
    parameters = {k: [ctx.mpf(v) for v in values] for k, values in data.parameters}
    state = form(ctx, parameters, [ctx.mpf(float(v)) for v in y], ctx.mpf(float(theta)))
    return [context(digits + 15).mpf(v) for v in state]


def has_closed_form(data: Description) -> bool:
    """True if this module has a closed form of the problem's exact flow."""
    if not isinstance(data, NamedProblem) or data.name not in _ELLIPTIC_FORMS:
        return False
    inertia = dict(data.parameters).get("inertia", (1.0, 2.0, 3.0))
    return len(set(inertia)) == 3


def _to_separatrix(ctx: Any, data: NamedProblem, y: Sequence[float]) -> Number:
    """The distance |1 − m| of the elliptic parameter m from the separatrix, m = 1,
    on which the formulas hold too.
    """
    state, parameters = [ctx.mpf(float(v)) for v in y], dict(data.parameters)
    if data.name == "pendulum":
        return abs(1 - _pendulum_modulus(ctx, state[0], state[1]))
    if data.name == "rigid-body":
        body = _Body(ctx, [ctx.mpf(v) for v in parameters["inertia"]], state)
        return 1 - body.m
    return ctx.one


def _oscillator(ctx: Any, _: Parameters, y: Vector, theta: Number) -> Vector:
    """The exact flow of the oscillator, dp = −x dθ, dx = p dθ: a rotation."""
    cos, sin = ctx.cos(theta), ctx.sin(theta)
    return [y[0] * cos - y[1] * sin, y[0] * sin + y[1] * cos]


def _amplitude(ctx: Any, u: Number, m: Number) -> tuple[Number, Number, Number, Number]:
    """Jacobi's elliptic functions sn, cn, dn and the amplitude am at (u, m), for 0 ≤ m ≤ 1."""
    sn, cn, dn = (ctx.ellipfun(kind, u, m=m) for kind in ("sn", "cn", "dn"))
    turns = 0 if m == 1 else ctx.floor(u / (4 * ctx.ellipk(m)) + ctx.mpf(1) / 2)
    return sn, cn, dn, ctx.atan2(sn, cn) + 2 * ctx.pi * turns


def _pendulum_modulus(ctx: Any, p: Number, q: Number) -> Number:
    """The square of the pendulum's modulus at (p, q): k² = sin²(q/2) + p²/4 = (H + 1)/2."""
    return ctx.sin(q / 2) ** 2 + p * p / 4


def _pendulum(ctx: Any, _: Parameters, y: Vector, theta: Number) -> Vector:
    """The exact flow of the pendulum by elliptic functions.

    Libration, k ≤ 1: sin(q/2) = k sn(θ + u0, k²), p = 2k cn. Rotation, k > 1, with s the sign of p:
    q = 2s am(kθ + u0, 1/k²), p = 2sk dn. The modulus k and the phase u0 follow from the initial
    state.
    """
    p, q = y
    turns = ctx.nint(q / (2 * ctx.pi))
    half = q / 2 - ctx.pi * turns
    k2 = _pendulum_modulus(ctx, p, 2 * half)
    k = ctx.sqrt(k2)
    if not k2:
        return [p, q]
    if k2 <= 1:
        u0 = ctx.ellipf(ctx.atan2(ctx.sin(half), p / 2), k2)
        sn, cn, dn, _angle = _amplitude(ctx, theta + u0, k2)
        return [2 * k * cn, 2 * ctx.atan2(k * sn, dn) + 2 * ctx.pi * turns]
    s = ctx.sign(p)
    _sn, _cn, dn, angle = _amplitude(ctx, k * theta + ctx.ellipf(s * half, 1 / k2), 1 / k2)
    return [2 * s * k * dn, 2 * s * angle + 2 * ctx.pi * turns]


class _Body:
    """A rigid body with the axes sorted so that I_a < I_b < I_c, and the invariants of its motion.

    y_a′ = −σA_a y_b y_c, y_b′ = σA_b y_a y_c, y_c′ = −σA_c y_a y_b with A_a = 1/I_b
    − 1/I_c, A_b = 1/I_a − 1/I_c, A_c = 1/I_a − 1/I_b, and σ is the sign of the permutation.
    K_a = y_a²/A_a + y_b²/A_b and K_c = y_c²/A_c + y_b²/A_b are conserved. If K_a > K_c, a
    and c are exchanged, so that the elliptic parameter m = K_a/K_c ≤ 1.
    """

    def __init__(self, ctx: Any, inertia: Vector, y: Vector) -> None:
        a, b, c = sorted(range(3), key=lambda i: inertia[i])
        self.sigma = 1 if (a, b, c) in ((0, 1, 2), (1, 2, 0), (2, 0, 1)) else -1
        A = {i: abs(1 / inertia[j] - 1 / inertia[k]) for i, j, k in ((a, b, c), (b, a, c), (c, a, b))}
        if not all(A.values()):
            raise UsageError(
                expected="three different moments of inertia for the closed form of the rigid body",
                received=", ".join(ctx.nstr(v, 6) for v in inertia),
                remedy="sepv.reference.flow.taylor follows the flow of a symmetric body",
            )
        K = {i: y[i] ** 2 / A[i] + y[b] ** 2 / A[b] for i in (a, c)}
        if K[a] > K[c]:
            a, c = c, a
        self.a, self.b, self.c, self.A, self.K = a, b, c, A, K
        self.m = K[a] / K[c] if K[c] else ctx.zero


def _rigid_body(ctx: Any, parameters: Parameters, y: Vector, theta: Number) -> Vector:
    """The exact flow of the rigid body by elliptic functions, with the symbols of `_Body`.

    y_c = s√(A_cK_c) dn, y_a = √(A_aK_a) cn, y_b = σs√(A_bK_a) sn of (λθ + u0, m),
    λ² = A_aA_bA_cK_c, s the sign of y_c.
    """
    body = _Body(ctx, parameters["inertia"], y)
    a, b, c, A, K, m = body.a, body.b, body.c, body.A, body.K, body.m
    if not K[c]:
        return y
    s = 1 if y[c] > 0 else -1
    rate = ctx.sqrt(A[a] * A[b] * A[c] * K[c])
    # σ gives the phase its sign, because A_aA_bA_c > 0 in either order of a and c.
    phase = ctx.atan2(body.sigma * s * y[b] / ctx.sqrt(A[b]), y[a] / ctx.sqrt(A[a]))
    sn, cn, dn, _angle = _amplitude(ctx, rate * theta + ctx.ellipf(phase, m), m)
    y1 = list(y)
    y1[a] = ctx.sqrt(A[a] * K[a]) * cn
    y1[b] = body.sigma * s * ctx.sqrt(A[b] * K[a]) * sn
    y1[c] = s * ctx.sqrt(A[c] * K[c]) * dn
    return y1


_ELLIPTIC_FORMS: dict[str, Form] = {
    "harmonic-oscillator": _oscillator,
    "pendulum": _pendulum,
    "rigid-body": _rigid_body,
}
