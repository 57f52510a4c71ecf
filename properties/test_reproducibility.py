"""The bits of y1 do not depend on the batch: on other states, their number, the state's place,
or a division.
"""

from __future__ import annotations

import numpy as np
from sepv.properties._problems_of import may_ask

from sepv.law import Case, Cases, Effort, Measurement, Middle, require, searched, state_ulp
from sepv.problem import PolynomialSystem
from sepv.schemes import Scheme, ask

# Sizes of parts of a batch. Libraries change their code path near the widths of vector registers
# and unrolled loops, so these sizes differ; a further part has as many states as y has components.
# Some cases have batches of thousands.
BATCH_PARTS = (2, 7, 24)
# In these batches every second state is multiplied by a power of two, down to 2⁻²⁰: iterations that
# stop by the largest state of a batch then stop too early for small states.
SCALE_EXPONENTS = 21
# From this d on NumPy sums a single row in another order than the rows of a batch. Newton's last
# correction hides most of the differences, so STEPS_ALONE states are stepped alone.
LONG_SUMS, STEPS_ALONE = 9, 16


def check(scheme: Scheme, case: Case) -> Measurement:
    """Compare the middle state's step in a batch with its step alone,
    and all steps with those in smaller batches.

    The batch is cut in parts, and each part is stepped too. Vector registers and blocks then end at
    other states: the first or last state of a part is an inner state of the whole batch.
    """
    problem, y, h, dW = case.build()
    alone = ask(scheme, problem, y, h, dW)
    worst = Measurement(0.0, 0.0)
    first = _beside_a_power(case.batch)
    for sizes in ((1,), (first, case.batch - first) if case.batch else (len(y), *BATCH_PARTS)):
        size = sum(sizes)
        place = size // 2
        # Other states are nearer to 0 than y, with smaller noise, so that their steps have
        # solutions too.
        apart = np.abs(np.arange(size) - place)
        factors = 1 - apart % 17 / 128
        if not case.batch and isinstance(case.problem, PolynomialSystem):
            factors = factors * np.where(apart % 2, 2.0 ** -(apart % SCALE_EXPONENTS), 1.0)
        states, noise = y[:, None] * factors, dW[:, None] * factors
        if not may_ask(scheme, problem, states):
            states = np.repeat(y[:, None], size, axis=1)
        batch = ask(scheme, problem, states, h, noise)
        others = {"alone": ([place], alone[:, None])}
        if size > 1 and len(y) >= LONG_SUMS:
            single = [
                ask(scheme, problem, states[:, k], h, noise[:, k]) for k in range(min(STEPS_ALONE, size))
            ]
            others["alone, one by one"] = list(range(len(single))), np.stack(single, axis=1)
        if size > 1:
            ends = np.cumsum(sizes)
            cut = zip(np.split(states, ends[:-1], axis=1), np.split(noise, ends[:-1], axis=1), strict=True)
            parts = np.concatenate([ask(scheme, problem, part, h, dW_part) for part, dW_part in cut], axis=1)
            others[f"in batches of {', '.join(map(str, sizes))}"] = (list(range(size)), parts)
        for name, (places, answers) in others.items():
            off = np.max(np.abs(batch[:, places] - answers), axis=0)
            k = int(np.argmax(off))
            detail = f"in a batch of {size}: {batch[:, places[k]].tolist()}, {name}: {answers[:, k].tolist()}"
            unit = state_ulp(states[:, places[k]], answers[:, k])
            worst = max(worst, Measurement(float(off[k]) / unit, 0.0, detail), key=lambda m: m.defect)
    return worst


def _beside_a_power(size: int) -> int:
    """Return the size of the first part of a batch: 2^k − 1, 2^k or 2^k + 1,
    where 2^k is about half of `size`.

    Code that computes blocks of 2^k states has other formulas for the states left over, which these
    sizes reach.
    """
    power = 1 << max(0, size.bit_length() - 2)
    return max(1, min(size - 1, power + size % 3 - 1))


def one_at_a_time(scheme: Scheme) -> str:
    """Return why the law does not apply to a scheme without batches,
    or "" for a scheme that takes batches.
    """
    return "" if scheme.batched else "the scheme takes one state at a time: there is no batch to depend on"


law = searched(
    name="reproducibility",
    statement="y1 has the same bits for any batch size and any place in the batch",
    source="contract",
    unit="ulp of y",
    cost=1.9,
    # `steps` is left at 0, because it counts steps of given problems; the 140 000 here are of
    # polynomial systems.
    middle=Middle.MAP,
    cases=Cases(damped=True, where={"batch": ("2–9", "33–129", "500–2000", "4097–9000")}),
    check=check,
    not_applicable=one_at_a_time,
)


def test_reproducibility(scheme: Scheme, effort: Effort) -> None:
    require(law, scheme, effort)
