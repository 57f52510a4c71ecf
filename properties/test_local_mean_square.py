"""Estimate (3.9): the rms error of one step is O(h^(p+1/2)) for a claimed mean-square order p,
by quadrature over ΔW.

The slope is measured at step sizes at which it is asymptotic. Further step sizes h are drawn from
the whole range, with noises of several sizes. At these h no error may be of a lower order
(`sepv.properties._orders.any_step`).
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from sepv.properties._orders.any_step import lower_order
from sepv.properties._orders.local_errors import LocalErrors
from sepv.properties._orders.local_example import step_example
from sepv.properties._orders.local_orders import LOCAL_MARGIN, judge, strong_order
from sepv.properties._sampled import FIRST_STEP, of_one_step, pathwise

from sepv.law import Effort, Finding, Law, Run, Verdict, require
from sepv.schemes import Scheme, Systems, order_of


def run(law: Law, scheme: Scheme, this_run: Run) -> Finding:
    """Compare the rms error's slope, at random h too, with the claimed order (default 1, ½ for
    noncommuting noises).
    """
    claimed = scheme.mean_square_order

    def needs(_: LocalErrors, order: float) -> float:
        return order + 0.5 - LOCAL_MARGIN

    known = 1.5 if scheme.asks == "space-time" else 1.0
    if (
        claimed is not None
        and order_of(claimed, "additive") > known
        and scheme.systems == Systems.HAMILTONIANS
    ):
        text = f"of several Hamiltonians the reference of this law is known up to order {known:g}"
        return law.finding(Verdict.NOT_APPLICABLE, message=text)
    finding = judge(
        law, scheme, this_run, lambda errors: errors.rms, lambda errors: strong_order(scheme, errors.column),
        needs, 0.5, example=step_example,
    )  # fmt: skip
    if finding.verdict is not Verdict.HOLDS:
        return finding
    wrong, steps = lower_order(scheme, this_run)
    finding = replace(finding, checks=finding.checks + steps)
    if wrong is None:
        return finding
    slope, needed, text = wrong
    return replace(
        finding, verdict=Verdict.VIOLATED, defect=slope, bound=needed, message=f"{text}\n{finding.message}",
        witness={**(finding.witness or {}), "seed": this_run.effort.seed},
        replay=f"--law {law.name} --seed {this_run.effort.seed}",
    )  # fmt: skip


def replay(law: Law, scheme: Scheme, witness: dict[str, Any]) -> Finding:
    """Run the law again with the seed of a witness (a stored counterexample),
    so that it draws the same steps.
    """
    return run(law, scheme, Run(Effort(seed=int(witness.get("seed", 0)))))


law = Law(
    name="local-mean-square",
    statement="the rms error of one step is O(h^(p+½)) for the claimed mean-square order p (default: 1 or ½)",
    source="(3.9)",
    unit="slope",
    cost=0.1,
    steps=288,
    run=pathwise(of_one_step(run)),
    replay=replay,
    middle=FIRST_STEP,
)


def test_local_mean_square(scheme: Scheme, effort: Effort) -> None:
    require(law, scheme, effort)
