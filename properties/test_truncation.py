"""Remark 2.1 and Lemma 3.1: |ζ| ≤ A_h exactly, the moment bounds by exact integrals, and k large enough.

The bound of Remark 2.1 is printed with "=" in the paper; it is "≤", as here.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from sepv.reference.increments import lost_variance, moment, truncated_moment

from sepv import wiener
from sepv.law import Effort, Finding, Law, Verdict, require
from sepv.scheme import Scheme

STEPS = tuple(2.0**-n for n in range(1, 21))


def run(law: Law, scheme: Scheme, effort: Effort) -> Finding:
    """Increments truncated with the scheme's k, for h from 1/2 to 2⁻²⁰."""
    k = scheme.truncation
    if k is None:
        return law.finding(Verdict.NOT_APPLICABLE, message="the scheme takes its increments untruncated")
    order = scheme.mean_square_order
    if order is not None and k < 2 * order:
        # E|ξ − ζ|² ≤ C h^k |ln h|^½ makes a local rms error h^((k+1)/2), and order p needs h^(p + 1/2).
        return law.finding(
            Verdict.VIOLATED,
            defect=float(k),
            bound=2 * order,
            at_least=True,
            message=f"truncation k = {k} costs the claimed mean-square order {order:g}: it needs k ≥ {2 * order:g}",
            witness={"truncation": k},
        )
    worst, checks = (0.0, 1.0, ""), 0
    for h in STEPS:
        for ratio, text in _ratios(h, k, effort.seed):
            checks += 1
            if not ratio <= worst[0]:
                worst = (ratio, 1.0, text)
    verdict = Verdict.VIOLATED if not worst[0] <= 1 else Verdict.HOLDS
    message = worst[2] if verdict is Verdict.VIOLATED else ""
    return law.finding(
        verdict, defect=worst[0], bound=1.0, checks=checks, message=message, witness={"truncation": k}
    )


def _ratios(h: float, k: int, seed: int) -> list[tuple[float, str]]:
    """Each quantity over its bound."""
    raw = wiener.increments(seed, T=h, steps=1, noises=1, paths=512)
    # Draws alone would hardly reach A_h: multiples of them do.
    zeta = wiener.truncate(np.concatenate([raw, 8 * raw]), h, k) / math.sqrt(h)
    bound = wiener.truncation_bound(h, k)
    loss = float(lost_variance(h, k))
    allowed = (1 + 2 * math.sqrt(2 * k * abs(math.log(h)))) * h**k
    found = [
        # One rounding each of √h, the product and the quotient.
        (
            float(np.max(np.abs(zeta))) / (bound * (1 + 4 * 2.0**-53)),
            f"|ζ| exceeds A_h = {bound!r} at h = {h!r}",
        ),
        (loss / allowed, f"E[ξ² − ζ²] = {loss:.6g} exceeds {allowed:.6g} at h = {h!r}"),
    ]
    for p in (1, 2, 3, 4, 8):
        ratio = float(truncated_moment(h, k, p) / moment(p))
        found.append((ratio, f"E|ζ|^{p} exceeds E|ξ|^{p} by the factor {ratio!r} at h = {h!r}"))
    return found


def replay(law: Law, scheme: Scheme, _witness: dict[str, Any]) -> Finding:
    """The law has no cases: it is the same again."""
    return run(law, scheme, Effort())


law = Law(
    name="truncation",
    statement="|ζ| ≤ A_h, the moment bounds, and k ≥ 2p for mean-square order p",
    source="Rem. 2.1",
    unit="share",
    run=run,
    replay=replay,
)


def test_truncation(scheme: Scheme, effort: Effort) -> None:
    require(law, scheme, effort)
