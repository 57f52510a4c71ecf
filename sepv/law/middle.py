"""Laws about a step, measured on steps in the middle of a path:
a scheme may carry a state (`sepv.StatefulStep`).

A case has a problem, a state y and a step (h, ΔW). To measure the step after k others, the step of
the case is divided into N = k + 1 equal steps of one path from y. Let |Δ| ≤ min(r/G, κ/L) inside
the contraction radius of y (`sepv.law.contraction`). All N steps together are no longer than Δ, so
the path stays within r of y, where G and L are bounds. So each step in the middle has a solution
near its y, and contracts with the factor κ/N.

Each law says how it is measured there (`Middle`), or why it is not. Derivations of the bounds:

- STEPS: each step from y_n to y_(n+1) is measured alone, with the bound of the law for this step.
  Nothing accumulates.
- MAP: the law compares values of a map, which is now y0 → y_N. Each of the N steps has a residual
  of at most r. A step multiplies earlier errors by (1 + κ/N)/(1 − κ/N) at most, N steps by less
  than e^(2κ). So the map solves its equation with a residual of N e^(2κ) r, which
  `sepv.law.tolerance.step_residual` returns for it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from hypothesis import strategies as st

from sepv.errors import Unasked
from sepv.law._law import Measurement, Middle
from sepv.law.cases.case import Case
from sepv.law.cases.of_law import Question
from sepv.law.search_log import Check
from sepv.schemes import Scheme, ask_next, resumed, several

# The numbers k of steps before the last one: the second, the third and the eighth step of a path.
# Two and eight steps alone would hide faults that cancel in pairs.
STEPS_BEFORE = (1, 2, 7)
# The increments of the steps of a path are ΔW/N times these numbers in turn, for laws that measure
# each step alone. A scheme may keep the noise of the step before.
INCREMENT_TURNS = (1.0, -0.5, 0.75)


def anywhere(middle: Middle | str, check: Check) -> Check:
    """The check that measures `case.after` + 1 steps of a path;
    a case with `after` = 0 is measured as it is.

    If `middle` is a reason why a law is about first steps only, the check raises Unasked for other
    steps.
    """

    def measured(scheme: Scheme, case: Case) -> Measurement:
        if not case.after:
            return check(scheme, case)
        if isinstance(middle, str):
            raise Unasked(middle)
        if middle is Middle.STEPS:
            return _worst_step(check, scheme, case)
        count = case.after + 1
        found = check(several(scheme, count), replace(case, after=0))
        return replace(found, detail=f"after {count} steps of a path: {found.detail}")

    return measured


def _worst_step(check: Check, scheme: Scheme, case: Case) -> Measurement:
    """Measure each step of a path alone, up to the first that violates the law,
    and return the worst.
    """
    problem, y, *_ = case.build()
    count, state, worst = case.after + 1, None, Measurement(0.0, 0.0)
    h = float(scheme.numbers(np.array(case.h / count)))
    for n in range(count):
        dW = scheme.numbers(np.array(case.dW) * INCREMENT_TURNS[n % len(INCREMENT_TURNS)] / count).astype(
            np.float64
        )
        here = replace(case, y=tuple(y.tolist()), h=h, dW=tuple(dW.tolist()), after=0)
        found = check(resumed(scheme, state), here)
        if n == 0 or found.violates or found.ratio > worst.ratio:
            words = f"step {n + 1} of a path, from y = {y.tolist()} with h = {h!r}, dW = {dW.tolist()}"
            worst = replace(found, detail=f"{words}: {found.detail}")
        if found.violates:
            break
        if n + 1 < count:
            y, state = ask_next(scheme, problem, y, state, h, dW)
    return worst


def along_paths(question: Question) -> Question:
    """The question for a scheme with memory: each case of the design is also asked in the middle of
    a path.
    """

    def design(seed: int) -> list[Case]:
        cases = question.design(seed)
        return [
            each
            for n, case in enumerate(cases)
            for each in (case, replace(case, after=STEPS_BEFORE[(n + seed) % len(STEPS_BEFORE)]))
        ]

    drawn = st.tuples(question.strategy, st.sampled_from((0, *STEPS_BEFORE)))
    return replace(question, design=design, strategy=drawn.map(lambda pair: replace(pair[0], after=pair[1])))
