"""Ball arithmetic by python-flint's Arb: each computed ball contains the exact value.
It needs the extra `certify`.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from typing import Any

from sepv.reference.arithmetic import Arithmetic, Function, Number

from sepv.errors import UsageError


def available() -> bool:
    """True if python-flint is installed."""
    return importlib.util.find_spec("flint") is not None


def require_flint() -> Any:
    """Import the module flint.

    Raises
    ------
    UsageError
        If python-flint is not installed; the message says what works without it.
    """
    if not available():
        raise UsageError(
            expected="python-flint for certificates by ball arithmetic",
            received="an environment without it",
            remedy="pip install python-flint; without it references are computed by mpmath, not proved",
        )
    import flint

    return flint


@contextmanager
def precision(bits: int) -> Iterator[Any]:
    """Run a `with` block in which Arb works with this many bits;
    flint's earlier setting is restored at its end.
    """
    flint = require_flint()
    with flint.ctx.workprec(bits):
        yield flint


def from_mpf(x: Any) -> Any:
    """Convert an mpmath number to a ball; its radius is 0 if Arb's precision holds all bits of the
    number.
    """
    flint = require_flint()
    sign, man, exp, _ = x._mpf_
    return flint.arb(flint.fmpz(-int(man) if sign else int(man))) * flint.arb(2) ** int(exp)


def ball(radius: Any) -> Any:
    """The ball [−radius, radius]; the radius may be a ball itself."""
    flint = require_flint()
    return flint.arb(0).union(abs(radius).upper()).union(-abs(radius).upper())


@lru_cache(maxsize=8)
def real_balls(bits: int) -> Arithmetic:
    """The arithmetic of real balls, for use within `precision(bits)`;
    ε is the variable of a power series cut after ε.

    The arithmetic is cached for each number of bits, so that its tables of quadrature nodes are
    computed once.
    """
    del bits
    flint = require_flint()
    arb, series = flint.arb, flint.arb_series

    def lifted(f: Function, derivative: Function) -> Function:
        def of(x: Number) -> Number:
            if isinstance(x, series):
                return series([f(x[0]), derivative(x[0]) * x[1]], 2)
            return f(x)

        return of

    def log1p_ratio(x: Number) -> Number:
        """Enclose log(1 + x)/x for a ball x by the values at both ends of x,
        because the function decreases.
        """
        ends = [e.log1p() / e if e != 0 else arb(1) for e in (x.lower(), x.upper())]
        return ends[0].union(ends[1])

    def gauss(n: int) -> list[tuple[Number, Number]]:
        rule = [arb.legendre_p_root(n, k, weight=True) for k in range(n)]
        return [((1 + node) / 2, weight / 2) for node, weight in reversed(rule)]

    return Arithmetic(
        number=lambda x: arb(float(x)),
        sin=lifted(lambda x: x.sin(), lambda x: x.cos()),
        cos=lifted(lambda x: x.cos(), lambda x: -x.sin()),
        log=lifted(lambda x: x.log(), lambda x: 1 / x),
        sinc=lifted(lambda x: x.sinc(), _sinc_slope),
        log1p_ratio=lifted(log1p_ratio, lambda x: _log1p_ratio_slope(x, log1p_ratio(x))),
        gauss=gauss,
        nudged=lambda value, slope: series([value, slope], 2),
        slope=lambda x: x[1] if isinstance(x, series) else arb(0),
    )


@lru_cache(maxsize=8)
def complex_balls(bits: int) -> Arithmetic:
    """The arithmetic of complex balls, to bound ∇H and B off the real axis,
    with only the functions that these need.
    """
    acb = require_flint().acb
    nodes = real_balls(bits).gauss

    def missing(*_: Any) -> Any:
        raise NotImplementedError("not needed off the real axis")

    return Arithmetic(
        number=lambda x: acb(float(x)),
        sin=lambda x: x.sin(),
        cos=lambda x: x.cos(),
        log=lambda x: x.log(),
        sinc=missing,
        log1p_ratio=missing,
        gauss=lambda n: [(acb(node), acb(weight)) for node, weight in nodes(n)],
        nudged=missing,
        slope=missing,
    )


def _sinc_slope(x: Any) -> Any:
    """Enclose sinc′(x): −x/3 ± |x|³/30 (a series) if x is small, else ±1/2 if 0 is in x,
    else (cos x − sinc x)/x.
    """
    size = abs(x).upper()
    if size < 1e-3:
        return -x / 3 + ball(size * size * size / 30)
    return (x.cos() - x.sinc()) / x if not x.contains(0) else ball(require_flint().arb(0.5))


def _log1p_ratio_slope(x: Any, value: Any) -> Any:
    """Enclose q′(x) = −∫₀¹τ(1 + τx)⁻²dτ, q = log(1 + x)/x: −½ ± (2/3)|x|(1 − |x|)⁻³ near 0,
    else (1/(1 + x) − q)/x.
    """
    size = abs(x).upper()
    if size < 1e-3 or (x.contains(0) and size < 1):
        return ball(size * 2 / 3 / (1 - size) ** 3) - require_flint().arb(0.5)
    return (1 / (1 + x) - value) / x
