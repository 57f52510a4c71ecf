"""Moments of Wiener increments, with and without truncation,
in closed form (Remark 2.1, Lemma 3.1).
"""

from __future__ import annotations

from typing import Any

from sepv.reference.arithmetic import context


def bound(h: float, k: int, digits: int = 30) -> Any:
    """The bound A_h = √(2k|ln h|) at which a standard normal increment ξ is truncated to ζ."""
    ctx = context(digits)
    return ctx.sqrt(2 * k * abs(ctx.ln(ctx.mpf(h))))


def tail(a: Any, digits: int = 30) -> Any:
    """The tail probability P(ξ > a) for ξ ~ N(0, 1)."""
    ctx = context(digits)
    return ctx.erfc(a / ctx.sqrt(2)) / 2


def lost_variance(h: float, k: int, digits: int = 30) -> Any:
    """The variance lost by truncation at A = A_h, E[ξ² − ζ²] = 2∫_A^∞ (x² − A²)φ(x)dx = 2((1
    − A²)P(ξ > A) + Aφ(A)).
    """
    ctx = context(digits)
    A = bound(h, k, digits)
    density = ctx.exp(-A * A / 2) / ctx.sqrt(2 * ctx.pi)
    return 2 * ((1 - A * A) * tail(A, digits) + A * density)


def moment(p: int, digits: int = 30) -> Any:
    """The absolute moment E|ξ|^p = 2^(p/2) Γ((p + 1)/2)/√π of ξ ~ N(0, 1)."""
    ctx = context(digits)
    return ctx.mpf(2) ** (ctx.mpf(p) / 2) * ctx.gamma(ctx.mpf(p + 1) / 2) / ctx.sqrt(ctx.pi)


def truncated_moment(h: float, k: int, p: int, digits: int = 30) -> Any:
    """The moment E|ζ|^p = E|ξ|^p γ((p + 1)/2, A²/2)/Γ((p + 1)/2) + 2A^p P(ξ > A)
    of ξ truncated to ζ at A = A_h.
    """
    ctx = context(digits)
    A = bound(h, k, digits)
    inside = ctx.gammainc(ctx.mpf(p + 1) / 2, 0, A * A / 2, regularized=True)
    return moment(p, digits) * inside + 2 * A**p * tail(A, digits)
