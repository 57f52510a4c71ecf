"""A state's bits do not depend on the states computed beside it: any batch size, any place, any chunking."""

from __future__ import annotations

import numpy as np

from sepv.schemes import Scheme, ask
from sepv.verification import Case, Cases, Effort, Measurement, require, searched, state_ulp
from sepv.verification._cases.users_problems import may_ask

# Sizes of the parts of a batch: libraries change their code path near the widths of vector registers and unrolled
# loops, and one part has as many states as components. The cases of the design have further sizes, up to thousands.
PARTS = (2, 7, 24)


def check(scheme: Scheme, case: Case) -> Measurement:
    """Compare a state in the middle of batches with its result alone, and all states with those of parts of the batch.

    Each state is stepped in the whole batch and in a part of it, where other vector registers and blocks end: the
    first or last state of a part is an inner one of the whole.
    """
    problem, y, h, dW = case.build()
    alone = ask(scheme, problem, y, h, dW)
    worst = Measurement(0.0, 0.0)
    third = max(1, case.batch // 3)
    for sizes in ((1,), (third, case.batch - third) if case.batch else (len(y), *PARTS)):
        size = sum(sizes)
        place = size // 2
        # The others are nearer to 0 with smaller noise, so that their steps have solutions too.
        factors = 1 - np.abs(np.arange(size) - place) % 17 / 128
        states, noise = y[:, None] * factors, dW[:, None] * factors
        if not may_ask(scheme, problem, states):
            states = np.repeat(y[:, None], size, axis=1)
        batch = ask(scheme, problem, states, h, noise)
        others = {"alone": ([place], alone[:, None])}
        if size > 1:
            ends = np.cumsum(sizes)
            cut = zip(np.split(states, ends[:-1], axis=1), np.split(noise, ends[:-1], axis=1), strict=True)
            parts = np.concatenate([ask(scheme, problem, part, h, dW_part) for part, dW_part in cut], axis=1)
            others[f"in batches of {', '.join(map(str, sizes))}"] = (list(range(size)), parts)
        for name, (places, answers) in others.items():
            apart = np.max(np.abs(batch[:, places] - answers), axis=0)
            k = int(np.argmax(apart))
            detail = f"in a batch of {size}: {batch[:, places[k]].tolist()}, {name}: {answers[:, k].tolist()}"
            unit = state_ulp(states[:, places[k]], answers[:, k])
            worst = max(worst, Measurement(float(apart[k]) / unit, 0.0, detail), key=lambda m: m.defect)
    return worst


def one_at_a_time(scheme: Scheme) -> str:
    """The reason why the law does not apply to a scheme without batches, or ""."""
    return "" if scheme.batched else "the scheme takes one state at a time: there is no batch to depend on"


law = searched(
    name="reproducibility",
    statement="the same bits for any batch size and any place in the batch",
    source="contract",
    unit="ulp of y",
    cost=1.9,
    # The 140 000 steps of batches are not counted: they are of polynomial systems, and of schemes that take batches.
    cases=Cases(damped=True, where={"batch": ("2–9", "33–129", "500–2000", "4097–9000")}),
    check=check,
    not_applicable=one_at_a_time,
)


def test_reproducibility(scheme: Scheme, effort: Effort) -> None:
    require(law, scheme, effort)
