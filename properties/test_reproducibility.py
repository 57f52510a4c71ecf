"""The same bits for a state whatever is computed beside it: any batch size, any place in it, any chunking."""

from __future__ import annotations

import numpy as np

from sepv.schemes import Scheme, ask
from sepv.verification import Case, Effort, Measurement, require, searched, state_ulp
from sepv.verification._cases.fixed_cases import fixed_cases
from sepv.verification._cases.given import may_ask
from sepv.verification.strategies import any_steps

# Around the widths of vector registers and unrolled loops, where libraries change their code path; further sizes, up to
# thousands, come with the cases of the design.
SIZES = (1, 2, 7, 33)


def check(scheme: Scheme, case: Case) -> Measurement:
    """Batches of several sizes with the case's state in the middle: that one against it alone, all against two parts.

    Each state is asked about in the whole batch and in one cut in two, where no vector register and no block ends: what
    happens to the first or the last of a batch happens to others in the parts.
    """
    problem, y, h, dW = case.build()
    alone = ask(scheme, problem, y, h, dW)
    worst = Measurement(0.0, 0.0)
    for size in (1, case.batch) if case.batch else SIZES:
        place = size // 2
        # The others are nearer to 0 and their noise is smaller, so that they can be solved too.
        factors = 1 - np.abs(np.arange(size) - place) % 17 / 128
        states, noise = y[:, None] * factors, dW[:, None] * factors
        if not may_ask(scheme, problem, states):
            states = np.repeat(y[:, None], size, axis=1)
        batch = ask(scheme, problem, states, h, noise)
        others = {"alone": ([place], alone[:, None])}
        if size > 1:
            cut = max(1, size // 3)
            parts = [
                ask(scheme, problem, states[:, part], h, noise[:, part])
                for part in (slice(cut), slice(cut, None))
            ]
            others[f"in batches of {cut} and {size - cut}"] = (
                list(range(size)),
                np.concatenate(parts, axis=1),
            )
        for name, (places, answers) in others.items():
            apart = np.max(np.abs(batch[:, places] - answers), axis=0)
            k = int(np.argmax(apart))
            detail = f"in a batch of {size}: {batch[:, places[k]].tolist()}, {name}: {answers[:, k].tolist()}"
            unit = state_ulp(states[:, places[k]], answers[:, k])
            worst = max(worst, Measurement(float(apart[k]) / unit, 0.0, detail), key=lambda m: m.defect)
    return worst


def one_at_a_time(scheme: Scheme) -> str:
    """Why the law does not apply."""
    return "" if scheme.batched else "the scheme takes one state at a time: there is no batch to depend on"


law = searched(
    name="reproducibility",
    statement="the same bits for any batch size and any place in the batch",
    source="contract",
    unit="ulp of y",
    cost=3.0,
    cases=any_steps,
    check=check,
    fixed_cases=fixed_cases,
    not_applicable=one_at_a_time,
    level=1,
    needed=True,
)


def test_reproducibility(scheme: Scheme, effort: Effort) -> None:
    require(law, scheme, effort)
