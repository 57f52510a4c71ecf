"""The same bits for a state whatever is computed beside it: any batch size, any place in it, any chunking."""

from __future__ import annotations

import numpy as np

from sepv.schemes import Scheme, ask
from sepv.verification import Case, Cases, Effort, Measurement, require, searched, state_ulp
from sepv.verification._cases.users_problems import may_ask

# Sizes of the parts of a batch, around the widths of vector registers and unrolled loops, where libraries change their
# code path, beside one of as many states as components. The cases of the design have further ones, up to thousands.
PARTS = (2, 7, 24)


def check(scheme: Scheme, case: Case) -> Measurement:
    """Batches of several sizes with the case's state in the middle: that one against it alone, all against its parts.

    Each state is asked about in the whole batch and in a part of it, where other vector registers and blocks end: what
    happens to the first or the last of a batch happens to others in the parts.
    """
    problem, y, h, dW = case.build()
    alone = ask(scheme, problem, y, h, dW)
    worst = Measurement(0.0, 0.0)
    third = max(1, case.batch // 3)
    for sizes in ((1,), (third, case.batch - third) if case.batch else (len(y), *PARTS)):
        size = sum(sizes)
        place = size // 2
        # The others are nearer to 0 and their noise is smaller, so that they can be solved too.
        factors = 1 - np.abs(np.arange(size) - place) % 17 / 128
        states, noise = y[:, None] * factors, dW[:, None] * factors
        if not may_ask(scheme, problem, states):
            states = np.repeat(y[:, None], size, axis=1)
        batch = ask(scheme, problem, states, h, noise)
        others = {"alone": ([place], alone[:, None])}
        if size > 1:
            ends = np.cumsum(sizes)
            cut = zip(np.split(states, ends[:-1], axis=1), np.split(noise, ends[:-1], axis=1), strict=True)
            parts = np.concatenate([ask(scheme, problem, part, h, some) for part, some in cut], axis=1)
            others[f"in batches of {', '.join(map(str, sizes))}"] = (list(range(size)), parts)
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
    cost=1.9,
    # Not its 140 000 steps of batches: they are of polynomial systems, and of schemes that take batches.
    cases=Cases(where={"batch": ("2–9", "33–129", "500–2000", "4097–9000")}),
    check=check,
    not_applicable=one_at_a_time,
)


def test_reproducibility(scheme: Scheme, effort: Effort) -> None:
    require(law, scheme, effort)
