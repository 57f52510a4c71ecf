"""If the random step Δ = h + Σ c_jΔW_j is 0, or if ∇H(y0) = 0, then y1 = y0 exactly:
both follow from (2.1).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sepv.law import Case, Cases, Effort, Measurement, require, searched, state_ulp
from sepv.problem import NamedProblem, Systems, hamiltonians_of, noise_vectors, one_field
from sepv.schemes import Scheme, ask

PENDULUM_AT_REST = Case(NamedProblem("pendulum", (("noise", (1.0, 0.5)),)), (0.0, 0.0), 0.25, (0.5, -0.25))


def unmoved(case: Case) -> Case:
    """Make Δ = 0 exactly, by h = c_1 2^n and ΔW_1 = −2^n or by h = 0;
    a case with ∇H(y0) = 0 stays unchanged.

    If the noises have structures or Hamiltonians of their own, no noise cancels h: then h and all
    ΔW_j are set to 0.
    """
    problem, y, h, dW = case.build()
    c, pushed = problem.c, noise_vectors(problem).any()
    if not pushed and not any(F.gradient(y).any() for F in hamiltonians_of(problem) if F.gradient):
        return case
    if not one_field(problem) or not c.size or not c[0]:
        still = h == 0 and not (c * dW).any()
        return case if still else replace(case, h=0.0, dW=(0.0,) * c.size)
    if float(problem.random_step(h, dW)) == 0:
        return case
    unit = 2.0 ** np.floor(np.log2(max(abs(h) / c[0], 2.0**-60)))
    unit = -unit if h < 0 else unit
    silent = (0.0 if cj else w for cj, w in zip(c[1:], case.dW[1:], strict=True))
    return replace(case, h=float(c[0] * unit), dW=(-float(unit), *silent))


def check(scheme: Scheme, case: Case) -> Measurement:
    """Measure the largest component of |y1 − y0|; its bound is zero."""
    problem, y, h, dW = case.build()
    y1 = ask(scheme, problem, y, h, dW)
    moved = float(np.max(np.abs(y1 - y)))
    return Measurement(moved / state_ulp(y, y1), 0.0, f"y1 = {y1.tolist()}, expected y itself")


law = searched(
    name="identity",
    statement="y1 = y0 exactly if Δ = 0 or ∇H(y0) = 0",
    source="(2.1)",
    unit="ulp of y",
    cost=0.4,
    steps=74,
    # y1 = y0 + a(y0 − y−1) + …: BDF2, for example, has (4y0 − y−1)/3, which is y0 up to rounding if
    # both are equal.
    middle="a multistep method with Δ = 0 goes on from differences of earlier states, or rounds their sum",
    cases=Cases(
        where={"state": ("anywhere", "∇H = 0")},
        # Most faults depend on Δ: neither steps with ∇H(y0) = 0 nor steps with h = 0 and no noise
        # show them.
        blind={"state": ("∇H = 0",), "m": ("0",)},
        adapt=unmoved,
        fixed={Systems.SINGLE: lambda: (PENDULUM_AT_REST,)},
    ),
    check=check,
)


def test_identity(scheme: Scheme, effort: Effort) -> None:
    require(law, scheme, effort)
