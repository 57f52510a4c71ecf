"""The same bits for a state whatever is computed beside it: any batch size, any place in it, any chunking."""

from __future__ import annotations

import numpy as np

from sepv.candidate import ask
from sepv.case import Case
from sepv.corners import corners
from sepv.law import Effort, Measurement, require
from sepv.scheme import Scheme
from sepv.search import searched
from sepv.strategies import any_steps
from sepv.tolerance import state_ulp

# Around the widths of vector registers and unrolled loops, where libraries change their code path; further sizes, up to
# thousands, come with the cases of the design.
SIZES = (1, 2, 7, 33)


def check(scheme: Scheme, case: Case) -> Measurement:
    """Batches of several sizes with the case's state among others, against the state alone."""
    problem, y, h, dW = case.build()
    alone = ask(scheme, problem, y, h, dW)
    worst = Measurement(0.0, 0.0)
    for size in (1, case.batch) if case.batch else SIZES:
        place = size // 2
        # The others are nearer to 0 and their noise is smaller, so that they can be solved too.
        factors = 1 - np.abs(np.arange(size) - place) % 17 / 128
        batch = ask(scheme, problem, y[:, None] * factors, h, dW[:, None] * factors)
        distance = float(np.max(np.abs(batch[:, place] - alone)))
        detail = f"in a batch of {size}: {batch[:, place].tolist()}, alone: {alone.tolist()}"
        worst = max(worst, Measurement(distance / state_ulp(y, alone), 0.0, detail), key=lambda m: m.defect)
    return worst


def one_at_a_time(scheme: Scheme) -> str:
    """Why the law does not apply."""
    return "" if scheme.batched else "the scheme takes one state at a time: there is no batch to depend on"


law = searched(
    name="reproducibility",
    statement="the same bits for any batch size and any place in the batch",
    source="contract",
    unit="ulp of y",
    cases=any_steps,
    check=check,
    corners=corners,
    not_applicable=one_at_a_time,
)


def test_reproducibility(scheme: Scheme, effort: Effort) -> None:
    require(law, scheme, effort)
