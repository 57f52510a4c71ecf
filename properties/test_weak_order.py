"""Weak order: E y_N against E y(T), coupled with the exact path so that a few thousand paths measure it."""

from __future__ import annotations

from typing import Any

from sepv.convergence import weak_slope
from sepv.law import Effort, Finding, Law, require
from sepv.scheme import Scheme
from sepv.sequential import at_the_floor, judge

# Weak orders of the schemes at hand are integers: half-way to the next lower one, with the room that the
# pre-asymptotic part of a slope needs.
MARGIN = 0.5


def run(law: Law, scheme: Scheme, effort: Effort) -> Finding:
    """The slope against the claimed weak order, or against 1 where none is claimed."""
    order = 1.0 if scheme.weak_order is None else scheme.weak_order
    return at_the_floor(law, scheme, effort) or judge(law, scheme, effort, weak_slope, order - MARGIN)


def replay(law: Law, scheme: Scheme, witness: dict[str, Any]) -> Finding:
    """The same paths again."""
    return run(law, scheme, Effort(seed=int(witness["seed"]), paths=int(witness["paths"])))


law = Law(
    name="weak-order",
    statement="the error of E y_N decreases with the claimed weak order (else: order 1)",
    source="§5",
    unit="slope",
    run=run,
    replay=replay,
)


def test_weak_order(scheme: Scheme, effort: Effort) -> None:
    require(law, scheme, effort)
