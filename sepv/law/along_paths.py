"""Invariants along the paths that laws about paths make: of their steps,
those at which H or a Casimir changes most.

The cases of *energy* and *casimir* are drawn, and a step may be right on them and wrong at states
that paths reach, as one that projects on the level of H only if H is off it by 1e-9. So laws about
paths let `watching` keep their worst steps. After all laws these are measured as further cases of
*energy* and *casimir* (`replays`). No further path is made. A change in binary64 only selects a
step: the law's own bound decides.

Steps of a scheme with memory are not kept, because they depend on the steps before; `_middle`
measures its paths.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any

import numpy as np

from sepv.law._law import Finding, Law, Run, Verdict
from sepv.law.cases.case import Case, to_json
from sepv.law.cases.from_problem import describe
from sepv.law.cases.users_problems import sources
from sepv.problem import Array, Problem, casimir_gradients, invariants
from sepv.record import EPS, TINY
from sepv.schemes import Scheme, has_memory
from sepv.simulate import Watch

# The law about H, and the law about Casimirs.
ENERGY, CASIMIR = "energy", "casimir"


def watching(run: Run, scheme: Scheme) -> Watch | None:
    """A function that keeps the worst steps of paths in `run.worst`: for each law and problem,
    one of each size h.

    A change of an invariant I is counted in roundings of the state, EPS |∇I(y1)| |y1|. There is no
    function if a step is no case of a law: for schemes with memory, in single precision, or with
    further arguments.
    """
    if has_memory(scheme) or scheme.asks or scheme.eps != EPS:
        return None

    def watch(problem: Problem, y0: Array, y1: Array, h: float, dW: Array) -> None:
        with np.errstate(all="ignore"):
            change = np.abs(invariants(problem, y1) - invariants(problem, y0))
            slopes = casimir_gradients(problem.casimirs, problem.linear_casimirs, 2 * y1)
            sizes = np.linalg.norm([problem.gradient(y1), *slopes], axis=1) * np.linalg.norm(y1, axis=0)
            ratio = change / (EPS * sizes + TINY)
        ratio = np.where(np.isfinite(ratio), ratio, 0.0)  # a path may leave the range of numbers
        for law, rows in ((ENERGY, ratio[:1]), (CASIMIR, ratio[1:])):
            worst = rows.max(axis=0, initial=0.0)
            k, key = int(np.argmax(worst)), (law, problem, h)
            if worst[k] > run.worst.get(key, (0.0,))[0]:
                run.worst[key] = float(worst[k]), tuple(y0[:, k].tolist()), tuple(dW[:, k].tolist())

    return watch


def taken(run: Run, scheme: Scheme) -> tuple[tuple[str, dict[str, Any]], ...]:
    """The kept steps as witnesses, each with the name of its law; they are kept no longer.

    Of functions that are neither data nor a problem of the scheme's user no process can make a
    witness.
    """
    words = {item.fixed: item.text for item in sources(scheme) if item.fixed is not None}
    found = []
    for (law, problem, h), (_, y, dW) in run.worst.items():
        case = Case(describe(problem, words.get(problem, "")), y, h, dW)
        if problem in words or not hasattr(case.problem, "problem"):
            found.append((law, to_json(case)))
    run.worst.clear()
    return tuple(found)


def replays(
    laws: Iterable[Law], findings: dict[str, Finding], ask: Callable[[Law, int, dict[str, Any]], Finding]
) -> None:
    """Measure the kept steps of all findings, and replace findings that hold by the first
    violation.

    `ask` measures a law on a witness, which has a number. A finding that is not measured leaves out
    the step.
    """
    seen = [each for finding in findings.values() for each in finding.along]
    for law in laws:
        for number, (name, witness) in enumerate(seen):
            before = findings[law.name]
            if name != law.name or before.verdict is not Verdict.HOLDS or before.expected is not None:
                continue
            found = ask(law, number, witness)
            checks = before.checks + found.checks
            if found.verdict is Verdict.VIOLATED:
                message = f"on a step of a path, found by a law about paths:\n{found.message}"
                findings[law.name] = replace(found, checks=checks, message=message, claimed=before.claimed)
            else:
                findings[law.name] = replace(before, checks=checks)
