"""Estimate (3.8): the mean error of one step is O(h^(p+1)) for a claimed mean-square order p,
by quadrature over ΔW.
"""

from __future__ import annotations

from typing import Any

from sepv.properties._orders.local_example import mean_example
from sepv.properties._orders.local_orders import judge, mean_slope, strong_order
from sepv.properties._sampled import FIRST_STEP, of_one_step, pathwise

from sepv.law import Effort, Finding, Law, Run, require
from sepv.schemes import Scheme


def run(law: Law, scheme: Scheme, this_run: Run) -> Finding:
    """Compare the mean error's slope for one step with the claimed order (default: 1, ½ for
    noncommuting noises).
    """
    return judge(
        law,
        scheme,
        this_run,
        lambda errors: errors.mean,
        lambda errors: strong_order(scheme, errors.column),
        mean_slope,
        0.5,
        example=mean_example,
    )


def replay(law: Law, scheme: Scheme, _witness: dict[str, Any]) -> Finding:
    """Run the law again, because it draws no random numbers that a witness would have to store."""
    return run(law, scheme, Run())


law = Law(
    name="local-mean",
    statement="the mean error of one step is O(h^(p+1)) for the claimed mean-square order p (default: 1 or ½)",
    source="(3.8)",
    unit="slope",
    cost=0.2,
    steps=9200,
    spared=4810,
    run=pathwise(of_one_step(run)),
    replay=replay,
    middle=FIRST_STEP,
)


def test_local_mean(scheme: Scheme, effort: Effort) -> None:
    require(law, scheme, effort)
