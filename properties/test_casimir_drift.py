"""Trace formula: E[C(y1)] = C(y0) + hσ for additive noise and Casimirs C = yᵀAy or bᵀy of B.

For dy = B(y)∇H dt + Σ_j c_j g_j dW_j, ∇CᵀB = 0 reduces the generator L to LC = ½ Σ_j c_j² g_jᵀC″g_j. So E[C(y(t))]
grows at the rate σ = Σ_j c_j² g_jᵀAg_j if C = yᵀAy, and E[bᵀy(t)] is constant (D. Cohen and G. Vilmart,
arXiv 2005.13991, for energy and quadratic Casimirs). A quadrature over the increments gives the expectation.
"""

from __future__ import annotations

from functools import partial

import numpy as np
from sepv.properties._trace_formula import Quantity, measured, short

from sepv.problem import Array, Problem, Systems, noise_vectors
from sepv.schemes import Scheme
from sepv.verification import Case, Cases, Effort, Measurement, require, searched
from sepv.verification._tolerance import casimir_bound, casimir_ulp, pushes


def with_casimirs(case: Case) -> Case | None:
    """Keep a case with additive noise and a quadratic or linear Casimir, with a step as long as `short` allows."""
    problem, *_ = case.build()
    named = len(problem.casimirs) + len(problem.linear_casimirs)
    return short(case) if named and len(noise_vectors(problem)) else None


def quantity(problem: Problem, A: Array, y: Array, h: float) -> Quantity:
    """Return C, yᵀAy or bᵀy, with its rate σ. The bound allows for states in a step that noise moves beyond y1."""
    form, rate = "bᵀy", 0.0
    if A.ndim == 2:
        vectors = noise_vectors(problem)
        form, rate = "yᵀAy", float(problem.c**2 @ np.sum((vectors @ A) * vectors, axis=1))
    reach = pushes(problem) * 4 * h**0.5 * float(problem.c.sum())

    def moved(y0: Array, y1: Array, residual: Array) -> Array:
        return np.asarray(casimir_bound(A, np.abs(y0), np.abs(y1) + reach[:, None], residual))

    return Quantity(form, partial(_value, A), partial(_size, A), moved, rate, casimir_ulp(A, y, y))


def _value(A: Array, y: Array) -> Array:
    return np.asarray(np.sum(y * (A @ y), axis=0) if A.ndim == 2 else A @ y)


def _size(A: Array, y: Array) -> Array:
    return _value(np.abs(A), np.abs(y))


def check(scheme: Scheme, case: Case) -> Measurement:
    """Measure the largest |E[C(y1)] − C(y0) − hσ| of all Casimirs C, with a bound by |∇C| ≤ |A|(|y0| + |y1|)."""
    problem, y, h, _ = case.build()
    casimirs = (*problem.casimirs, *problem.linear_casimirs)
    measurements = (measured(scheme, problem, y, h, quantity(problem, A, y, h)) for A in casimirs)
    return max(measurements, key=lambda m: m.ratio)


_KEPT = "the exact flow keeps Casimirs: see the law casimir"
law = searched(
    name="casimir-drift",
    statement="E[C(y1)] = C(y0) + hσ if additive noise makes E[C] of a quadratic or linear Casimir C grow at rate σ",
    source="trace formula",
    unit="ulp of C",
    preserves=True,
    steps=4000,
    cases=Cases(
        where={"Casimirs": ("linear", "quadratic", "two")},
        adapt=with_casimirs,
        why="the noise is not additive by vectors, or the problems name no Casimir",
        not_of={s: _KEPT for s in Systems if s is not Systems.ADDITIVE} | {Systems.ADDITIVE: ""},
    ),
    check=check,
)


def test_casimir_drift(scheme: Scheme, effort: Effort) -> None:
    require(law, scheme, effort)
