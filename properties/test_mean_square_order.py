"""Theorems 3.3 and 3.4: mean-square order, measured against the exact flow at the random time."""

from __future__ import annotations

from typing import Any

from sepv.convergence import slope
from sepv.law import Effort, Finding, Law, require
from sepv.scheme import Scheme
from sepv.sequential import at_the_floor, judge

# Orders of one-step methods for (1.1) are multiples of ½: the next lower one is rejected by the slope's
# interval lying above the point half-way to it. That point also absorbs the pre-asymptotic part of a
# slope, which for the schemes of the paper at these step sizes is below 0.06.
MARGIN = 0.25


def run(law: Law, scheme: Scheme, effort: Effort) -> Finding:
    """The slope against the claimed order, or against 1 where none is claimed."""
    order = 1.0 if scheme.mean_square_order is None else scheme.mean_square_order
    return at_the_floor(law, scheme, effort) or judge(law, scheme, effort, slope, order - MARGIN)


def replay(law: Law, scheme: Scheme, witness: dict[str, Any]) -> Finding:
    """The same paths again."""
    return run(law, scheme, Effort(seed=int(witness["seed"]), paths=int(witness["paths"])))


law = Law(
    name="mean-square-order",
    statement="the rms error against the exact flow decreases with the claimed order (else: order 1)",
    source="Thm 3.3, 3.4",
    unit="slope",
    run=run,
    replay=replay,
)


def test_mean_square_order(scheme: Scheme, effort: Effort) -> None:
    require(law, scheme, effort)
