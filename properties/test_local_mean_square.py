"""(3.9): the rms error of one step is O(h^(p+1/2)) for a claimed mean-square order p, by quadrature over ΔW."""

from __future__ import annotations

from typing import Any

from sepv.law import Effort, Finding, Law, pathwise, require
from sepv.local_example import step_example
from sepv.local_orders import MARGIN, judge
from sepv.scheme import Scheme


def run(law: Law, scheme: Scheme, effort: Effort) -> Finding:
    """The slope against the claimed order, or against order 1 where none is claimed."""
    order = 1.0 if scheme.mean_square_order is None else scheme.mean_square_order
    least = order + 0.5 - MARGIN
    return judge(law, scheme, effort, lambda found: found.rms, lambda _: least, example=step_example)


def replay(law: Law, scheme: Scheme, _witness: dict[str, Any]) -> Finding:
    """Nothing is drawn: it is the same again."""
    return run(law, scheme, Effort())


law = Law(
    name="local-mean-square",
    statement="(E|y1 − φ|²)^½ after one step is O(h^(p+½)) for the claimed mean-square order p (else: 1)",
    source="(3.9)",
    unit="slope",
    cost=0.1,
    run=pathwise(run),
    replay=replay,
    level=2,
)


def test_local_mean_square(scheme: Scheme, effort: Effort) -> None:
    require(law, scheme, effort)
