"""Faults of the noise: another random step than Δ = h + Σ_j c_j ΔW_j,
or noise where it does not belong.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from sepv.core.formula import Fields
from sepv.problem import Array, Problem, matvec
from sepv.schemes import LOCAL_LAWS, Scheme, Step, drift_and_noise
from sepv.schemes import energy_preserving as original
from sepv.schemes import energy_preserving_formula as formula

from .formula import one_point_quadrature
from .record import Family, implicit, middle

FAMILY = Family("noise")
_STEP = ("midpoint", "reference", "reduction", "expansion")
_PATH_LIMITS = ("local-mean-square", "mean-square-order", "right-limit")
# Laws that find a scheme with a wrong limit, if the mean of this limit is wrong too.
_MEAN = (*_STEP, *_PATH_LIMITS, "local-mean", "local-weak", "weak-order")
_SEVERAL_NOISES_LAWS = ("midpoint", "reference", "reduction", "noise-sum", "random-step", *_PATH_LIMITS)
_NOISE_SIZE_LAWS = (
    *("identity", "midpoint", "reference", "reduction", "noise-sum", "random-step"),
    *(*LOCAL_LAWS, "mean-square-order", "weak-order"),
)


def _with(delta: Callable[[Any, Any, Any], Any]) -> Callable[[], Scheme]:
    """Make (2.1) with another random step Δ = delta(c, h, w), of shape (M,), where c is (m, 1)
    and w = dW is (m, M).
    """
    return implicit(formula, lambda problem, h, noise: delta(problem.c[:, None], h, noise)[None])


FAMILY.rows(
    ("drift-dropped", "Δ has no h", ("identity", "random-step", *_MEAN), lambda c, _h, w: np.sum(c * w, axis=0)),
    ("noise-dropped", "Δ has no noise", ("identity", "random-step", *_MEAN), lambda _c, h, w: np.full(w.shape[1], h)),
    ("noise-sign", "the noise has the wrong sign", ("identity", "random-step", *_STEP, *_PATH_LIMITS),
     lambda c, h, w: h - np.sum(c * w, axis=0)),
    ("c-squared", "c is squared", _NOISE_SIZE_LAWS, lambda c, h, w: h + np.sum(c**2 * w, axis=0)),
    ("c-forgotten", "every c is 1", _NOISE_SIZE_LAWS, lambda _c, h, w: h + np.sum(w, axis=0)),
    ("sqrt-h", "the increments are taken for standard normals and multiplied by √h",
     ("identity", "random-step", *_MEAN), lambda c, h, w: h + math.sqrt(h) * np.sum(c * w, axis=0)),
    ("absolute-increments", "|ΔW| stands for ΔW", ("identity", "symmetry", "random-step", "noise-sum", *_MEAN),
     lambda c, h, w: h + np.sum(c * np.abs(w), axis=0)),
    ("absolute-step", "|Δ| stands for Δ", ("symmetry", *_MEAN), lambda c, h, w: np.abs(h + np.sum(c * w, axis=0))),
    by=_with,
)  # fmt: skip


@FAMILY.formula(
    "∇H is averaged for Δ > 0 and taken at the midpoint for Δ < 0",
    ("energy", "symmetry", "reference", "local-mean", "local-weak"),
)
def positive_step_only(fields: Fields, y: Any, z: Any, step: Any) -> Any:
    right, wrong = formula(fields, y, z, step), one_point_quadrature(fields, y, z, step)
    return np.where(step[0] > 0, right, wrong)


FAMILY.rows(
    ("first-noise-only", "only the first noise is seen", _SEVERAL_NOISES_LAWS + LOCAL_LAWS,
     lambda c, h, w: h + np.sum((c * w)[:1], axis=0)),
    ("one-noise-in-law", "several noises are replaced by one of the same variance", _SEVERAL_NOISES_LAWS,
     lambda c, h, w: h + np.linalg.norm(c) * np.sum(w[:1], axis=0)),
    ("noises-reversed", "the c_j are taken in the wrong order", _SEVERAL_NOISES_LAWS,
     lambda c, h, w: h + np.sum(c[::-1] * w, axis=0)),
    by=_with,
)  # fmt: skip


@FAMILY.around(
    "increments are clipped at one standard deviation", ("identity", "random-step", *_SEVERAL_NOISES_LAWS)
)
def clipped_at_one(step: Step, problem: Problem, y: Array, h: float, dW: Array, widths: float = 1.0) -> Array:
    bound = widths * math.sqrt(h)
    return step(problem, y, h, np.clip(dW, -bound, bound))


@FAMILY.around(
    "increments are clipped inside the step, with k = 1 where the scheme says 2",
    ("midpoint", "reference", "noise-sum", "random-step", "truncation", "local-mean-square"),
)
def clipped_with_k_one(step: Step, problem: Problem, y: Array, h: float, dW: Array) -> Array:
    widths = math.sqrt(2 * abs(math.log(h))) if h < 1 else math.inf
    return clipped_at_one(step, problem, y, h, dW, widths)


FAMILY.rows(
    ("k-too-small", "the scheme asks for increments truncated with k = 1, which costs order 1",
     ("truncation", "local-mean-square"), lambda: replace(original, truncation=1)),
)  # fmt: skip
FAMILY.rows(
    # *noise-sum* is not named, because one noise with the same sum is too large by the same factor.
    ("noise-too-large", "every increment is too large by a factor of 1.0001",
     ("identity", "random-step", *_STEP, *LOCAL_LAWS), lambda c, h, w: h + 1.0001 * np.sum(c * w, axis=0)),
    ("drift-too-large", "the drift is too large by a factor of 1.001", ("identity", "random-step", *_STEP, *LOCAL_LAWS),
     lambda c, h, w: 1.001 * h + np.sum(c * w, axis=0)),
    ("fifth-noise-dropped", "four noises are seen, and no more", LOCAL_LAWS,
     lambda c, h, w: h + np.sum((c * w)[:4], axis=0)),
    ("ten-noises-only", "ten noises are seen, and no more", ("midpoint", "reference", "noise-sum", "random-step"),
     lambda c, h, w: h + np.sum((c * w)[:10], axis=0)),
    ("two-digits", "the c_j are rounded to two digits", ("midpoint", "reference", "noise-sum"),
     lambda c, h, w: h + np.sum(np.round(c, 2) * w, axis=0)),
    ("faint-noise-dropped", "noises below a thousandth of h are left out", ("reference", "noise-sum", "random-step"),
     lambda c, h, w: h + np.sum(np.where(np.abs(c * w) < 1e-3 * abs(h), 0.0, c * w), axis=0)),
    ("unmoved-without-drift", "a step with h = 0 returns y0, whatever the noise",
     ("midpoint", "reference", "random-step"), lambda c, h, w: h + np.sum(c * w, axis=0) * (h != 0)),
    by=_with,
)  # fmt: skip


@FAMILY.formula(
    "the drift is implicit, the noise explicit: the “symplectic midpoint” that converges to Itô",
    ("energy", "casimir", "symmetry", "random-step", "rounding", *_MEAN),
    parts=drift_and_noise,
)
def explicit_noise(fields: Fields, y: Any, z: Any, step: Any) -> Any:
    return step[0] * fields.field(middle(y, z)) + step[1] * fields.field(y)


@FAMILY.formula(
    "B is taken at y0 in the drift and at the midpoint in the noise",
    ("casimir", "midpoint", "symmetry", "random-step", "reference", "expansion"),
    parts=drift_and_noise,
)
def explicit_drift_structure(fields: Fields, y: Any, z: Any, step: Any) -> Any:
    B = step[0] * fields.structure(y) + step[1] * fields.structure(middle(y, z))
    return matvec(B, fields.mean_gradient(y, z))


@FAMILY.formula(
    "B is averaged over both ends in the drift and taken at the midpoint in the noise: H and symmetry are kept",
    ("casimir", "midpoint", "random-step", "reference"),
    parts=drift_and_noise,
)
def averaged_drift_structure(fields: Fields, y: Any, z: Any, step: Any) -> Any:
    ends = 0.5 * (fields.structure(y) + fields.structure(y + z))
    return matvec(step[0] * ends + step[1] * fields.structure(middle(y, z)), fields.mean_gradient(y, z))


@FAMILY.formula(
    "trapezoidal rule for the drift, midpoint rule for the noise: symmetric, not a function of Δ",
    ("energy", "random-step", "reference"),
    parts=drift_and_noise,
)
def trapezoidal_drift(fields: Fields, y: Any, z: Any, step: Any) -> Any:
    drift = 0.5 * (fields.field(y) + fields.field(y + z))
    return step[0] * drift + step[1] * fields.field(middle(y, z))


FAMILY.rows(
    ("absolute-h", "|h| stands for h, so that no step leads back", ("symmetry",),
     lambda c, h, w: abs(h) + np.sum(c * w, axis=0)),
    by=_with,
)  # fmt: skip


@FAMILY.formula(
    "the correction ½Σc²f′f, which the Stratonovich form does not need, is added to the drift",
    ("identity", "energy", "casimir", "symmetry", "random-step", "rounding", *_MEAN),
    parts=drift_and_noise,
)
def ito_correction(fields: Fields, y: Any, z: Any, step: Any) -> Any:
    correction = fields.derivative_along(y, fields.field(y))
    return (
        formula(fields, y, z, step[:1] + step[1:]) + 0.5 * np.sum(fields.problem.c**2) * step[0] * correction
    )
