"""Faults of the noise: another random step than Δ = h + Σ_j c_j ΔW_j, or noise where it does not belong."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from sepv.faults._saboteurs.formula import _one_point
from sepv.faults._saboteurs.record import Saboteur, around, implicit, middle
from sepv.problem import Array, Problem
from sepv.problem._fields import matvec
from sepv.schemes import Scheme
from sepv.schemes import energy_preserving as original
from sepv.schemes._energy_preserving import formula
from sepv.schemes._one_step import drift_and_noise
from sepv.schemes._scheme import Step
from sepv.solve import Fields

_LOCAL = ("local-mean", "local-mean-square", "local-weak")
_STEP = ("midpoint", "reference", "reduction", "expansion")
_LIMIT = ("local-mean-square", "mean-square-order", "right-limit")
_SEVERAL = ("midpoint", "reference", "reduction", "noise-sum", "random-step", *_LIMIT)


def _stepping(delta: Callable[[Array, float, Array], Array]) -> Callable[[], Scheme]:
    """(2.1) with another Δ, given c as a column (m, 1), h and the increments (m, M)."""
    return implicit(formula, lambda problem, h, noise: delta(problem.c[:, None], h, noise)[None])


def _first_only(c: Array, h: float, noise: Array) -> Array:
    return h + np.sum((c * noise)[:1], axis=0)


def _in_law(c: Array, h: float, noise: Array) -> Array:
    return h + np.linalg.norm(c) * np.sum(noise[:1], axis=0)


def _reversed(c: Array, h: float, noise: Array) -> Array:
    return h + np.sum(c[::-1] * noise, axis=0)


def _explicit_noise(fields: Fields, y: Any, z: Any, step: Any) -> Any:
    return step[0] * fields.field(middle(y, z)) + step[1] * fields.field(y)


def _explicit_drift_structure(fields: Fields, y: Any, z: Any, step: Any) -> Any:
    B = step[0] * fields.structure(y) + step[1] * fields.structure(middle(y, z))
    return matvec(B, fields.mean_gradient(y, z))


def _averaged_drift_structure(fields: Fields, y: Any, z: Any, step: Any) -> Any:
    ends = 0.5 * (fields.structure(y) + fields.structure(y + z))
    return matvec(step[0] * ends + step[1] * fields.structure(middle(y, z)), fields.mean_gradient(y, z))


def _trapezoidal_drift(fields: Fields, y: Any, z: Any, step: Any) -> Any:
    drift = 0.5 * (fields.field(y) + fields.field(y + z))
    return step[0] * drift + step[1] * fields.field(middle(y, z))


def _ito_correction(fields: Fields, y: Any, z: Any, step: Any) -> Any:
    correction = fields.derivative_along(y, fields.field(y))
    return (
        formula(fields, y, z, step[:1] + step[1:]) + 0.5 * np.sum(fields.problem.c**2) * step[0] * correction
    )


def _positive_only(fields: Fields, y: Any, z: Any, step: Any) -> Any:
    right, wrong = formula(fields, y, z, step), _one_point(fields, y, z, step)
    return np.where(step[0] > 0, right, wrong)


def _clipped(widths: Callable[[float], float]) -> Callable[[Step], Step]:
    """Increments clipped inside the step, at so many standard deviations."""

    def around_step(step: Step) -> Step:
        def clipped(problem: Problem, y: Array, h: float, dW: Array) -> Array:
            bound = widths(h) * math.sqrt(h)
            return step(problem, y, h, np.clip(dW, -bound, bound))

        return clipped

    return around_step


def _k_one(h: float) -> float:
    return math.sqrt(2 * abs(math.log(h))) if h < 1 else math.inf


_TABLE = (
    (
        "drift-dropped",
        "Δ has no h",
        _stepping(lambda c, _h, w: np.sum(c * w, axis=0)),
        ("identity", "random-step", *_STEP, *_LIMIT, "local-mean", "local-weak", "weak-order"),
    ),
    (
        "noise-dropped",
        "Δ has no noise",
        _stepping(lambda _c, h, w: np.full(w.shape[1], h)),
        ("identity", "random-step", *_STEP, *_LIMIT, "local-mean", "local-weak", "weak-order"),
    ),
    (
        "noise-sign",
        "the noise has the wrong sign",
        _stepping(lambda c, h, w: h - np.sum(c * w, axis=0)),
        ("identity", "random-step", *_STEP, *_LIMIT),
    ),
    (
        "c-squared",
        "c is squared",
        _stepping(lambda c, h, w: h + np.sum(c**2 * w, axis=0)),
        (
            "identity",
            "midpoint",
            "reference",
            "reduction",
            "noise-sum",
            "random-step",
            *_LOCAL,
            "mean-square-order",
            "weak-order",
        ),
    ),
    (
        "c-forgotten",
        "every c is 1",
        _stepping(lambda _c, h, w: h + np.sum(w, axis=0)),
        (
            "identity",
            "midpoint",
            "reference",
            "reduction",
            "noise-sum",
            "random-step",
            *_LOCAL,
            "mean-square-order",
            "weak-order",
        ),
    ),
    (
        "sqrt-h",
        "the increments are taken for standard normals and multiplied by √h",
        _stepping(lambda c, h, w: h + math.sqrt(h) * np.sum(c * w, axis=0)),
        ("identity", "random-step", *_STEP, *_LIMIT, "local-mean", "local-weak", "weak-order"),
    ),
    (
        "absolute-increments",
        "|ΔW| stands for ΔW",
        _stepping(lambda c, h, w: h + np.sum(c * np.abs(w), axis=0)),
        (
            "identity",
            "symmetry",
            "random-step",
            "noise-sum",
            *_STEP,
            *_LIMIT,
            "local-mean",
            "local-weak",
            "weak-order",
        ),
    ),
    (
        "absolute-step",
        "|Δ| stands for Δ",
        _stepping(lambda c, h, w: np.abs(h + np.sum(c * w, axis=0))),
        ("symmetry", *_STEP, *_LIMIT, "local-mean", "local-weak", "weak-order"),
    ),
    (
        "positive-step-only",
        "∇H is averaged for Δ > 0 and taken at the midpoint for Δ < 0",
        implicit(_positive_only),
        ("energy", "symmetry", "reference", "local-mean", "local-weak"),
    ),
    ("first-noise-only", "only the first noise is seen", _stepping(_first_only), (*_SEVERAL, *_LOCAL)),
    (
        "one-noise-in-law",
        "several noises are replaced by one of the same variance",
        _stepping(_in_law),
        _SEVERAL,
    ),
    ("noises-reversed", "the c_j are taken in the wrong order", _stepping(_reversed), _SEVERAL),
    (
        "clipped-at-one",
        "increments are clipped at one standard deviation",
        around(_clipped(lambda _: 1.0)),
        ("identity", "random-step", *_SEVERAL),
    ),
    (
        "clipped-with-k-one",
        "increments are clipped inside the step, with k = 1 where the scheme says 2",
        around(_clipped(_k_one)),
        ("midpoint", "reference", "noise-sum", "random-step", "truncation", "local-mean-square"),
    ),
    (
        "k-too-small",
        "the scheme asks for increments truncated with k = 1, which costs order 1",
        lambda: replace(original, truncation=1),
        ("truncation", "local-mean-square"),
    ),
    (
        "noise-too-large",
        "every increment is too large by a factor of 1.0001",
        _stepping(lambda c, h, w: h + 1.0001 * np.sum(c * w, axis=0)),
        # Not noise-sum: one noise of the same sum is too large by the same share.
        ("identity", "random-step", *_STEP, *_LOCAL),
    ),
    (
        "drift-too-large",
        "the drift is too large by a factor of 1.001",
        _stepping(lambda c, h, w: 1.001 * h + np.sum(c * w, axis=0)),
        ("identity", "random-step", *_STEP, *_LOCAL),
    ),
    (
        "fifth-noise-dropped",
        "four noises are seen, and no more",
        _stepping(lambda c, h, w: h + np.sum((c * w)[:4], axis=0)),
        _LOCAL,
    ),
    (
        "explicit-noise",
        "the drift is implicit, the noise explicit: the “symplectic midpoint” that converges to Itô",
        implicit(_explicit_noise, drift_and_noise),
        (
            "energy",
            "casimir",
            "symmetry",
            "random-step",
            "rounding",
            *_STEP,
            *_LIMIT,
            "local-mean",
            "local-weak",
            "weak-order",
        ),
    ),
    (
        "explicit-drift-structure",
        "B is taken at y0 in the drift and at the midpoint in the noise",
        implicit(_explicit_drift_structure, drift_and_noise),
        ("casimir", "midpoint", "symmetry", "random-step", "reference", "expansion"),
    ),
    (
        "averaged-drift-structure",
        "B is averaged over both ends in the drift and taken at the midpoint in the noise: H and symmetry are kept",
        implicit(_averaged_drift_structure, drift_and_noise),
        ("casimir", "midpoint", "random-step", "reference"),
    ),
    (
        "trapezoidal-drift",
        "trapezoidal rule for the drift, midpoint rule for the noise: symmetric, not a function of Δ",
        implicit(_trapezoidal_drift, drift_and_noise),
        ("energy", "random-step", "reference"),
    ),
    (
        "absolute-h",
        "|h| stands for h, so that no step leads back",
        _stepping(lambda c, h, w: abs(h) + np.sum(c * w, axis=0)),
        ("symmetry",),
    ),
    (
        "ito-correction",
        "the correction ½Σc²f′f, which the Stratonovich form does not need, is added to the drift",
        implicit(_ito_correction, drift_and_noise),
        (
            "identity",
            "energy",
            "casimir",
            "symmetry",
            "random-step",
            "rounding",
            *_STEP,
            *_LIMIT,
            "local-mean",
            "local-weak",
            "weak-order",
        ),
    ),
)

SABOTEURS = tuple(Saboteur(name, "noise", broken, make, laws) for name, broken, make, laws in _TABLE)
