"""The scheme converges to the Stratonovich solution of (1.1), and not to another, such as the Itô one."""

from __future__ import annotations

import math
from typing import Any

from sepv.convergence import Estimate, StrongErrors, log_decay
from sepv.law import Effort, Finding, Law, require
from sepv.scheme import Scheme
from sepv.sequential import judge, setups_for, steps_for


def threshold(scheme: Scheme) -> float:
    """√(n^½), where h falls by n from the coarsest to the finest step: half-way.

    The rms error falls by n^p ≥ n^½ for every mean-square order p ≥ ½, and not at all where the limit is another.
    """
    spans = [steps_for(s, scheme.truncation, scheme.mean_square_order) for s in setups_for(scheme)]
    return float(min(steps[-1] / steps[0] for steps in spans) ** 0.25)


def fall(errors: StrongErrors, alpha: float) -> Estimate:
    """ln of the factor by which the error falls."""
    decay = log_decay(errors, alpha)
    return Estimate(-decay.value, decay.half, decay.alpha)


def run(law: Law, scheme: Scheme, effort: Effort) -> Finding:
    """The factor by which the error falls, on every problem."""
    return judge(law, scheme, effort, fall, math.log(threshold(scheme)), math.exp)


def replay(law: Law, scheme: Scheme, witness: dict[str, Any]) -> Finding:
    """The same paths again."""
    return run(law, scheme, Effort(seed=int(witness["seed"]), paths=int(witness["paths"])))


law = Law(
    name="right-limit",
    statement="the rms error against the Stratonovich solution vanishes with h",
    source="(1.1)",
    unit="fall",
    run=run,
    replay=replay,
)


def test_right_limit(scheme: Scheme, effort: Effort) -> None:
    require(law, scheme, effort)
