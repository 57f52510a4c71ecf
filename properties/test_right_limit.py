"""The scheme converges to the Stratonovich solution of (1.1), and not to another, such as the Itô one."""

from __future__ import annotations

import math
from typing import Any

from sepv.convergence import Estimate, StrongErrors, log_decay
from sepv.law import Effort, Finding, Law, require
from sepv.scheme import Scheme
from sepv.sequential import SETUPS, judge

# From the coarsest to the finest of these step sizes h falls by 16. The rms error then falls by 16^p ≥ 4
# for every mean-square order p ≥ ½, and not at all where the limit is another: 2 is half-way.
THRESHOLD = 2.0


def fall(errors: StrongErrors, alpha: float) -> Estimate:
    """ln of the factor by which the error falls."""
    decay = log_decay(errors, alpha)
    return Estimate(-decay.value, decay.half, decay.alpha)


def run(law: Law, scheme: Scheme, effort: Effort) -> Finding:
    """The factor by which the error falls, on every problem."""
    assert all(s.steps[-1] == 16 * s.steps[0] for s in SETUPS)
    return judge(law, scheme, effort, fall, math.log(THRESHOLD), math.exp)


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
