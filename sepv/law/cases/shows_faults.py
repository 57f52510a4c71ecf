"""A test of a case: in it usual faults of a scheme, such as a wrong quadrature,
must exceed the bound of rounding.
"""

from __future__ import annotations

from typing import cast

import numpy as np

from sepv.law.cases.case import Case
from sepv.law.cases.strata import Levels
from sepv.law.tolerance import casimir_bound, energy_bound, step_residual
from sepv.problem import Array, Problem, average_gradient, combined, matvec

# SHOWN_MOTION is the least ratio of a step's increment to rounding, because a fault may change a
# small share of it alone. SHOWN_EFFECT is the least ratio of a fault's effect to the law's bound.
# `benchmarks.power` measures the effect of both.
SHOWN_MOTION, SHOWN_EFFECT = 1e7, 64.0
# In steps longer than this share of the contraction radius, errors of the size of a power of h
# exceed rounding.
LONG_STEP_SHARE = 0.5


def shows_faults(case: Case, levels: Levels) -> bool:
    """True if usual faults, such as B taken at y0 instead of the midpoint,
    would exceed rounding in this case.

    Let z = Δ B∇H be an explicit step. The step z, and its parts from h and from each c_jΔW_j, must
    exceed SHOWN_MOTION times rounding. Taking ∇H at the midpoint instead of its average must change
    H. Taking B at y instead of the midpoint must change y1 and every quadratic Casimir. Each change
    must exceed SHOWN_EFFECT times the bound of rounding. These changes are not tested for short
    steps, quadratic H or constant B, because then the faults change nothing.
    """
    if levels["step/radius"].high < LONG_STEP_SHARE:
        return True
    problem, y, h, dW = case.build()
    parts = np.array([h, *(problem.c * dW)])
    with np.errstate(all="ignore"):
        g = problem.gradient(y)
        z = matvec(combined(problem, y, parts), g)
        residual = step_residual(problem, y, y + z, h, dW)
        alone = [matvec(combined(problem, y, part), g) for part in np.diag(parts)[parts != 0]]
        moves = min(float(np.max(np.abs(v))) for v in (z, *alone)) > SHOWN_MOTION * float(np.max(residual))
        curved = bool(moves) and _curved(problem, levels, y, z, residual)
        return curved and _turning(problem, levels, y, z, residual, parts)


def _curved(problem: Problem, levels: Levels, y: Array, z: Array, residual: Array) -> bool:
    """True if averages of gradients with one node (too few) would show in H and in a Casimir C,
    if of degree > 2.
    """
    found = []
    if levels["degree of H"].high > 2:
        found.append((problem, energy_bound(problem, y, y + z, residual)))
    if problem.nambu is not None and levels["degree of C"].high > 2:
        nambu = cast(Problem, problem.nambu)
        found.append((nambu, np.abs(nambu.gradient(y)) @ residual))
    wrong = (f.gradient(y + 0.5 * z) - average_gradient(f, y, y + z).value for f, _ in found)
    return all(abs(w @ z) > SHOWN_EFFECT * bound for w, (_, bound) in zip(wrong, found, strict=True))


def _turning(problem: Problem, levels: Levels, y: Array, z: Array, residual: Array, parts: Array) -> bool:
    """True if y1 and all quadratic Casimirs change by more than rounding when B is taken at y
    instead of y + z/2.
    """
    degrees = [levels[axis].high for axis in ("degree of B", "degree of g") if axis in levels]
    if max(degrees, default=0) < 1:
        return True
    moved = matvec(combined(problem, y + 0.5 * z, parts), problem.gradient(y)) - z
    return bool(np.any(np.abs(moved) > SHOWN_EFFECT * residual)) and all(
        abs(z @ A @ z) > SHOWN_EFFECT * casimir_bound(A, y, y + z, residual) for A in problem.casimirs
    )
