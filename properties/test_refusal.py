"""If a step of (2.1) has no solution, a scheme refuses it by an ArithmeticError,
or by the step's status in a batch.

Any returned state is wrong, also y0 and the explicit step. `sepv.properties._without_solution`
proves that there is no solution: one component of (2.1) is a quadratic equation without real root,
in exact numbers. The residual of a returned state in this component is compared with the largest
residual that a solved step may have. A scheme that does not claim the law *reference* may solve
another equation. Then the report says what the scheme returns, without a judgement.
"""

from __future__ import annotations

import math
import warnings
from collections import Counter
from dataclasses import replace
from functools import cache, partial
from random import Random
from typing import Any

import numpy as np
from sepv.properties._problems_of import taken_by
from sepv.properties._without_solution import CLASSES_WITH_FOLDS, NoSolution, made, proof

from sepv.core.newton import Status
from sepv.errors import SepvError, Skipped, StepFailure
from sepv.law import (
    Case,
    Cases,
    Effort,
    Finding,
    Law,
    Measurement,
    Run,
    Verdict,
    require,
    searched,
    state_ulp,
    step_residual,
)
from sepv.problem import Array, Problem, Systems, vector_field
from sepv.schemes import Scheme, ask

# FIRST_STEPS_TESTED is the number of steps tested before the random search, UNCLAIMED_STEPS_TRIED
# the number tried for a scheme that does not claim *reference*. They are small, because an
# iteration without a solution takes fifty times as long as one that converges.
FIRST_STEPS_TESTED, UNCLAIMED_STEPS_TRIED = 8, 8


def check(scheme: Scheme, case: Case) -> Measurement:
    """Measure the residual of the step alone and, if case and scheme have batches,
    in a batch with steps of Δ = 0.
    """
    why = proof(case, scheme.stages)
    if why is None:
        raise Skipped("nothing proves that the step has no solution")
    problem, y, h, dW = case.build()
    alone = _judged(scheme, case, why, partial(ask, scheme, problem, y, h, dW), "y1")
    if alone.violates or not (scheme.batched and case.batch):
        return alone
    states, noises = np.repeat(y[:, None], 3, axis=1), np.repeat(dW[:, None], 3, axis=1)
    if problem.noises and problem.c[0]:
        # Both other steps of the batch get Δ = 0. With several structures they may move
        # nevertheless.
        noises[0, ::2] -= (h + float(problem.c @ dW)) / problem.c[0]
    among = _judged(scheme, case, why, lambda: ask(scheme, problem, states, h, noises)[:, 1], "y1 in a batch")
    if among.violates or scheme.solve is None:
        return among
    solve = scheme.solve

    def lane() -> Array | None:
        solution = solve(problem, states.copy(), h, noises.copy())
        return solution.value[:, 1] if solution.status[1] == Status.CONVERGED else None

    return _judged(scheme, case, why, lane, "y1 of solve, of which the status says that it is solved,")


def _judged(scheme: Scheme, case: Case, why: NoSolution, answer: Any, name: str) -> Measurement:
    """Measure the residual of an answer in the component without solution, in ulp of y,
    or 0 if the step is refused.
    """
    problem, y, h, dW = case.build()
    try:
        y1 = answer()
    except StepFailure:
        y1 = None
    if y1 is None:
        return Measurement(0.0, 0.0, "refused, as is right")
    k = why.place
    with np.errstate(all="ignore"):
        allowed = float(step_residual(problem, y, y1, h, dW, scheme)[k])
    unit = state_ulp(y, y1)
    left = _float(why.residual(y[k], y1[k])) / unit
    detail = (
        f"{name} = {y1.tolist()} came, and (2.1) has no solution: for z = y1_{k + 1} − y_{k + 1} it says "
        f"{float(why.a):.6g} z² {float(why.b):+.6g} z {float(why.c):+.6g} {'≤' if why.stages > 1 else '='} 0, "
        f"which no real z obeys; each state leaves a residual of {float(why.least):.3g} at least\n"
        "Remedy: raise sepv.StepFailure, or an ArithmeticError, where the iteration does not converge"
    )
    return Measurement(left, allowed / unit if math.isfinite(allowed) else 0.0, detail)


def _float(value: Any) -> float:
    """Convert a Fraction to binary64. Numbers above 2^1000 become infinite."""
    return math.inf if value > 2**1000 else float(value)


@cache
def _law(stages: int = 1) -> Law:
    return searched(
        name="refusal",
        statement="a step of (2.1) without solution is refused: no state is returned",
        source="(2.1)",
        unit="ulp of y",
        cost=0.4,
        steps=24,
        middle="a step without a solution is known from its first state alone",
        cases=Cases(
            adapt=lambda case: case if proof(case, stages) is not None else None,
            why="nothing proves of the problems that a step has no solution",
            no_cases_of={Systems.HAMILTONIANS: "no steps are known by a formula to have no solution"},
            made={
                systems: (FIRST_STEPS_TESTED, partial(made, systems=systems, stages=stages))
                for systems in CLASSES_WITH_FOLDS
            },
        ),
        check=check,
    )


def _run(_: Law, scheme: Scheme, this_run: Run) -> Finding:
    inner = _law(scheme.stages)
    if "reference" in scheme.claims:
        finding = inner.run(inner, scheme, this_run)
        # Steps longer than the scheme's `longest_step` are skipped. Too few other steps are no
        # failure.
        if (
            finding.verdict in (Verdict.INCONCLUSIVE, Verdict.NOT_APPLICABLE)
            and scheme.longest_step is not None
        ):
            left = Verdict.HOLDS if finding.checks else Verdict.NOT_APPLICABLE
            return replace(finding, verdict=left, skipped=finding.skipped if finding.checks else 0)
        return finding
    text = "the scheme does not claim reference, and may solve another equation"
    if scheme.systems in CLASSES_WITH_FOLDS and not scheme.problems:
        text += f"\n{_returned(scheme, this_run.effort.seed)}"
    return inner.finding(Verdict.NOT_APPLICABLE, message=text)


def _returned(scheme: Scheme, seed: int) -> str:
    """Describe the states that a scheme returns for steps at which (2.1) has no solution."""
    seen: Counter[str] = Counter()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the scheme's own warnings are not findings
        steps = (made(Random(f"{seed} {n}"), scheme.systems) for n in range(UNCLAIMED_STEPS_TRIED))
        for problem, y, h, dW in (case.build() for case in taken_by(scheme, steps)):
            try:
                seen[_named(problem, y, h, dW, ask(scheme, problem, y, h, dW))] += 1
            except StepFailure:
                seen["a refusal"] += 1
            except SepvError as error:
                seen[f"{type(error).__name__}: {str(error).splitlines()[0]:.70}"] += 1
    return f"at {UNCLAIMED_STEPS_TRIED} steps without a solution of (2.1) came: " + ", ".join(
        f"{what} ({n})" for what, n in seen.most_common()
    )


def _named(problem: Problem, y: Array, h: float, dW: Array, y1: Array) -> str:
    """Name a returned state y1: "y0", "the explicit step" or "another state"."""
    if np.array_equal(y1, y):
        return "y0"
    explicit = y + problem.random_step(h, dW) * vector_field(problem, y)
    return "the explicit step" if np.allclose(y1, explicit, rtol=1e-12, atol=0.0) else "another state"


def _replay(_: Law, scheme: Scheme, witness: dict[str, Any]) -> Finding:
    inner = _law(scheme.stages)
    return inner.replay(inner, scheme, witness)


law = Law(
    **{
        key: getattr(_law(), key)
        for key in ("name", "statement", "source", "unit", "cost", "steps", "cases", "middle")
    },
    run=_run,
    replay=_replay,
)


def test_refusal(scheme: Scheme, effort: Effort) -> None:
    require(law, scheme, effort)
