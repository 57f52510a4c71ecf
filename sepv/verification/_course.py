"""Courses, for pictures: the states that a scheme reaches if it repeats the step of a
counterexample.

Every step has the same h and ΔW, so the same Δ = h + Σ c_jΔW_j. If all noises have the field B∇H,
the exact solution after n steps is φ(nΔ, y0), where φ(t, y0) is the flow of ẏ = B∇H.
"""

from __future__ import annotations

import math
import time
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from sepv.children import TimedOut, attempted, deadline
from sepv.errors import SepvError, Skipped
from sepv.exact import exact_flow
from sepv.files import finite
from sepv.law import Finding, Verdict, in_units
from sepv.law.cases.case import Case, from_json
from sepv.law.cases.users_problems import objects_of
from sepv.problem import Array, Problem, casimir_gradients, invariants, one_field
from sepv.properties import load_laws
from sepv.schemes import Scheme, ask
from sepv.verification._outcome import Outcome

# The number of steps of a course, and the number of points of the exact solution in each step.
COURSE_STEPS, EXACT_POINTS_PER_STEP = 40, 3
# The most seconds for all courses of a report. Steps that were made until then are shown.
COURSES_MAX_SECONDS = 10.0
# A course ends when a state is larger than the first by this factor, because larger states would
# flatten the picture.
COURSE_END_FACTOR = 100.0


def with_courses(report: Outcome) -> dict[str, Any]:
    """The report as JSON in which each violation by a single step has its course of COURSE_STEPS
    steps.

    A course that raises an exception is left out, because a user's problem may raise any. After
    Ctrl-C none is made.
    """
    data, end = report.to_json(), time.monotonic() + COURSES_MAX_SECONDS
    for finding, law in zip(report.findings, data["laws"], strict=True):
        left = end - time.monotonic()
        single = finding.verdict is Verdict.VIOLATED and {"problem", "y"} <= set(finding.witness or {})
        if single and left > 0 and not report.interrupted:
            with suppress(Exception):
                work = partial(course, report.scheme, finding, left)
                if drawn := attempted(f"the course of {finding.law} of {report.target}", work, seconds=left):
                    law["course"] = drawn
    return data


def course(scheme: Scheme, finding: Finding, seconds: float = COURSES_MAX_SECONDS) -> dict[str, Any]:
    """Repeat the step of a finding's witness up to COURSE_STEPS times; return what a picture shows,
    or {} if y never changes.

    Returns
    -------
    dict
        components : the numbers, from 1, of the two components of y that change most (of one if d
            = 1)
        states : these components in the first state and after each step
        exact : these components of the exact solution, `EXACT_POINTS_PER_STEP` points a step; empty
            if no formula is known
        kept : the invariant that is shown: "C" for laws about Casimirs (the one that changes most),
            else "H"
        drift : the change of this invariant since the first state
        size : the size of the invariant's terms, by which rounding is distinguished from drift
        defects, bounds : the law's own measurement of the step from each state; absent for the laws
            whose defect is the change of the invariant
        ended : the reason of an early end; empty if there was none
    """
    share = seconds / 3  # for each of the path, the exact solution and the law's defects
    case = from_json(finding.witness, objects_of(scheme))
    problem, y, h, dW = case.build()
    states, ended = [y], ""
    try:
        with deadline(share):
            while len(states) <= COURSE_STEPS and not ended:
                states.append(ask(scheme, problem, states[-1], h, dW))
                if np.abs(states[-1]).max() > COURSE_END_FACTOR * np.abs(y).max() + 1:
                    ended = "it runs away"
    except SepvError as error:
        ended = str(error).partition("\n")[0].rstrip(".")
    except TimedOut:
        ended = f"the time for all courses, {COURSES_MAX_SECONDS:g} s, was over"
    path = np.stack(states, axis=1)
    if not np.ptp(path, axis=1).any():
        return {}
    conserved, drift, size = _kept(finding.law, problem, path)
    shown = np.sort(np.argsort(-np.ptp(path, axis=1), kind="stable")[:2])
    exact = np.empty((len(y), 0))
    if one_field(problem):
        theta = float(problem.random_step(h, dW)) * np.linspace(
            0, len(states) - 1, EXACT_POINTS_PER_STEP * (len(states) - 1) + 1
        )
        with suppress(SepvError, TimedOut), deadline(share):
            exact = exact_flow(problem, theta, y).y
    measured = _measured(finding.law, scheme, case, states, share)
    return {
        "components": [int(i) + 1 for i in shown], "states": _rounded(path[shown]), "exact": _rounded(exact[shown]),
        "kept": conserved, "drift": _rounded(drift), "size": _rounded(size), "ended": ended,
        **({key: _rounded(v) for key, v in zip(("defects", "bounds"), measured, strict=True)} if measured.size else {}),
    }  # fmt: skip


def _measured(name: str, scheme: Scheme, case: Case, states: list[Array], seconds: float) -> Array:
    """The law's defects and bounds (2, n) of the steps from `states`, in its unit;
    NaN where a step is refused.

    It is empty for the laws of H and C, whose defect is the change that is drawn, and ends when the
    time is over.
    """
    (law,) = load_laws([name])
    if law.measure is None or name == "energy" or _draws_casimir(name, case.build()[0]):
        return np.empty((2, 0))
    rows = []
    with suppress(TimedOut), deadline(seconds):
        for y in states:
            defect = bound = math.nan
            with suppress(SepvError, ArithmeticError, Skipped):
                there = law.measure(scheme, replace(case, y=tuple(y.tolist())))
                found = in_units(
                    scheme, law.finding(Verdict.VIOLATED, defect=there.defect, bound=there.bound)
                )
                defect, bound = float(found.defect or 0.0), float(found.bound or 0.0)
            rows.append((defect, bound))
    return np.array(rows).T if rows else np.empty((2, 0))


def _kept(law: str, problem: Problem, path: Array) -> tuple[str, Array, Array]:
    """For a law's invariant I: its name ("H" or "C"), its change along `path` (d, n),
    and the largest |∇I||y|.
    """
    with np.errstate(all="ignore"):
        values, slopes = invariants(problem, path), [problem.gradient(path)]
        slopes += casimir_gradients(problem.casimirs, problem.linear_casimirs, 2 * path)
        if law != "casimir" and _draws_casimir(law, problem):
            assert problem.nambu is not None
            values, slopes = problem.nambu.casimir(path)[None], [problem.nambu.gradient(path)]
        drift = values - values[:, :1]
        largest = (
            int(np.argmax(np.nan_to_num(np.ptp(drift, axis=1), nan=np.inf)[1:])) + 1 if len(drift) > 1 else 0
        )
        which = largest if law == "casimir" else 0
        size = np.max(np.linalg.norm(slopes[which], axis=0) * np.linalg.norm(path, axis=0))
    return "C" if _draws_casimir(law, problem) else "H", drift[which], size


def _draws_casimir(law: str, problem: Problem) -> bool:
    """True for the laws whose defect is the change of a Casimir that can be drawn."""
    return law == "casimir" or (law == "invariant:casimir" and problem.nambu is not None)


def _rounded(values: Array) -> Any:
    """Nested lists of the values with five digits, enough for a picture;
    null for a value that is not finite.
    """
    if not values.size:
        return []
    return finite(np.vectorize(lambda v: float(f"{v:.5g}"), otypes=[float])(values).tolist())
