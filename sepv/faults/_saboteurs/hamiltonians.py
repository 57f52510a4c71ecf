"""Faults of schemes for several Hamiltonians: each loses one property of the scheme that it imitates, and claims it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from sepv.faults._saboteurs.record import Saboteur
from sepv.problem import Array, Problem, hamiltonian_field
from sepv.schemes import (
    Scheme,
    area_midpoint,
    darboux_lie,
    drift_preserving,
    isospectral_midpoint,
    stochastic_midpoint,
    stochastic_splitting,
)
from sepv.schemes._drift_preserving import pushed, quiet
from sepv.schemes._isospectral_midpoint import require_spins
from sepv.schemes._one_step import Implicit, each_noise
from sepv.schemes._scheme import as_lanes
from sepv.solve import Increment

LOUDER = 1 + 2.0**-10
PUSH = 2.0**-30


def _imitating(original: Scheme, step: Callable[..., Array]) -> Callable[[], Scheme]:
    return lambda: replace(original, step=step, solve=None)


def _louder(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    """The last increment a thousandth too large."""
    noise = np.array(dW)
    noise[-1] *= LOUDER
    return stochastic_midpoint.step(problem, y, h, noise)


def _away(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    """y1 a little too long."""
    return stochastic_midpoint.step(problem, y, h, dW) * (1 + PUSH * h)


def _minus_areas(problem: Problem, y: Array, h: float, dW: Array, areas: Array) -> Array:
    return area_midpoint.step(problem, y, h, dW, -areas)


def _lie(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    """All flows in turn, and not the same way back."""
    stochastic_splitting.step(problem, y, 0.0, 0 * dW)  # refuses what that refuses
    state, noise = as_lanes(problem, y, h, dW)
    flows: tuple[Any, ...] = (*problem.flows, *problem.noise_flows)  # type: ignore[attr-defined]
    times = [state[0] * 0 + h] * len(problem.flows) + list(problem.c[:, None] * noise)
    for flow, t in zip(flows, times, strict=True):
        state = flow(state, t)
    return state.reshape(y.shape)


def _without_the_quarter(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    """y0 = x − ½f, y1 = x + ½f: the midpoint rule."""
    require_spins(problem, as_lanes(problem, y, h, dW)[0])
    return stochastic_midpoint.step(problem, y, h, dW)


def _arithmetic(problem: Problem, y0: Array, y1: Array, step: Array) -> Increment:
    """y0(exp(f(ȳ)/ȳ) − 1) with ȳ = (y0 + y1)/2, as an equation for y1."""
    ones = np.ones(y0.shape[1], dtype=np.int64)
    middle = y0 + 0.5 * (y1 - y0)
    value = y0 * np.expm1(hamiltonian_field(problem, middle, step) / middle)
    return Increment(value, ones, ones, ones.astype(bool))


def _halves_alike(problem: Problem, y: Array, h: float, dW: Array, first: Array) -> Array:
    """Half of the increment at both ends: two halves that are one."""
    return drift_preserving.step(problem, y, h, dW, 0 * first + 0.5 * dW)


def _too_far(problem: Problem, y: Array, h: float, dW: Array, first: Array) -> Array:
    """All pushes too long by 2⁻²⁰."""
    drift_preserving.step(problem, y, 0.0, 0 * dW, 0 * first)  # refuses what that refuses
    state, noise = as_lanes(problem, y, h, dW)
    before, far = np.reshape(first, noise.shape), 1 + 2.0**-20
    middle = quiet(problem, pushed(problem, state, far * before), h, noise)
    return pushed(problem, middle, far * (noise - before)).reshape(y.shape)


_TABLE = (
    ("second-noise-louder", "the last noise is 2⁻¹⁰ too large", _imitating(stochastic_midpoint, _louder),
     ("local-weak", "local-mean", "local-mean-square", "noise-sum", "expansion")),
    ("away-from-the-origin", "y1 is multiplied by 1 + 2⁻³⁰h", _imitating(stochastic_midpoint, _away),
     ("casimir", "symmetry", "symplecticity")),
    ("areas-of-other-sign", "the Lévy areas have the wrong sign", _imitating(area_midpoint, _minus_areas),
     ("local-mean-square", "mean-square-order")),
    ("lie-and-trotter", "the flows are composed in turn, and not symmetrically", _imitating(stochastic_splitting, _lie),
     ("symmetry",)),
    ("midpoint-as-isospectral", "¼(mᵀx)m is left out: all Casimirs and orders are kept, the structure is not",
     _imitating(isospectral_midpoint, _without_the_quarter), ("poisson-map",)),
    ("arithmetic-middle", "ȳ is the arithmetic mean, not that of logarithms: positive, of that order, no Poisson map",
     _imitating(darboux_lie, Implicit(_arithmetic, parts=each_noise)), ("poisson-map",)),
    ("halves-alike", "each half of the step sees half of its increment", _imitating(drift_preserving, _halves_alike),
     ("energy-drift",)),
    ("pushed-too-far", "the additive noise is 2⁻²⁰ too large", _imitating(drift_preserving, _too_far),
     ("energy-drift", "local-weak")),
)  # fmt: skip

SABOTEURS = tuple(Saboteur(name, "hamiltonians", broken, make, laws) for name, broken, make, laws in _TABLE)
# What each of them claims: all that its original does.
ORIGINALS = {
    "second-noise-louder": stochastic_midpoint,
    "away-from-the-origin": stochastic_midpoint,
    "areas-of-other-sign": area_midpoint,
    "lie-and-trotter": stochastic_splitting,
    "midpoint-as-isospectral": isospectral_midpoint,
    "arithmetic-middle": darboux_lie,
    "halves-alike": drift_preserving,
    "pushed-too-far": drift_preserving,
}
