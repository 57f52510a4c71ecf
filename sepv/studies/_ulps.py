"""Defects of one step in units of rounding: energy ulps, eps |∇H||y|, and Casimir ulps, eps |∇C||y|.

The invariants are evaluated at the binary64 states in extended precision, so that the measured defect is the scheme's
and not an error of the evaluation. Steps start on the exact orbit, with increments of variance h, truncated for h < 1.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from sepv.exact import exact_flow
from sepv.problem import Array, Problem
from sepv.problems import EXTENSIONS
from sepv.reference.hard import Sample
from sepv.reference.problem import exact_problem
from sepv.schemes import Scheme
from sepv.simulate import truncation as bounded
from sepv.studies._hard_cases import ask_each, energy_defects
from sepv.verification import casimir_ulp, describe, energy_ulp

# The usual step h. If a problem states a longest step, h is at most a quarter of it, so that every step has a solution.
USUAL_STEP = 2.0**-5
ORBIT = 10.0


@dataclass(frozen=True)
class Ulps:
    """The defects of one scheme on one problem, in energy ulps and Casimir ulps; None if nothing was measured.

    The Casimirs are the quadratic and linear Casimirs of the problem. The `failed` steps were refused, crashed or ended
    in a value that is not finite; these steps have no defects.
    """

    scheme: str
    problem: str
    h: float
    steps: int
    failed: int
    energy_median: float | None
    energy_largest: float | None
    casimir_median: float | None
    casimir_largest: float | None


def one_step(
    scheme: Scheme, problem: Problem, *, h: float | None = None, steps: int = 400, seed: int = 0
) -> Ulps:
    """Measure the defects of a scheme in `steps` independent random steps, which are the same for every scheme.

    If the problem is made of Python functions, its own code evaluates H, in the longest float that this code supports.
    """
    length = h or min(USUAL_STEP, (problem.longest_step or 1.0) / 4)
    rng = np.random.default_rng([seed, *problem.name.encode()])
    y0 = exact_flow(problem, rng.uniform(0, ORBIT, steps)).y
    dW = math.sqrt(length) * rng.standard_normal((problem.noises, steps))
    used = bounded.truncate(dW, length, 2 if length < 1 else None)
    y1, endings, _, _ = ask_each(scheme, problem, Sample(y0, length, used))
    fine = (endings == "CONVERGED") & np.isfinite(y1).all(axis=0)
    energy, casimir = _defects(problem, y0[:, fine], y1[:, fine])
    return Ulps(
        scheme.name, problem.name, length, steps, int((~fine).sum()),
        *(None if not values.size else float(of(values)) for values in (energy, casimir) for of in (np.median, np.max)),
    )  # fmt: skip


def _defects(problem: Problem, y0: Array, y1: Array) -> tuple[Array, Array]:
    """The defects (M,) of H in energy ulps, and of the worst Casimir in Casimir ulps, for M steps from y0 to y1."""
    data = problem.data if problem.name in EXTENSIONS else describe(problem)
    assert data is not None
    energy = energy_defects(data, y0, y1) / energy_ulp(problem, y0, y1)
    invariants = [*problem.casimirs, *problem.linear_casimirs]
    if not invariants or not y0.size:
        return energy, np.empty(0)
    exact = exact_problem(data, 40)
    worst = []
    for a, b in zip(y0.T, y1.T, strict=True):
        before, after = exact.casimir_values(exact.state(a)), exact.casimir_values(exact.state(b))
        worst.append(
            max(
                abs(float(v - u)) / casimir_ulp(C, a, b)
                for u, v, C in zip(before, after, invariants, strict=True)
            )
        )
    return energy, np.array(worst)
