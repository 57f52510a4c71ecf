"""The exact solution with several structures or Hamiltonians, by a formula if the flows commute,
else by finer steps.

If all fields commute, y(T) is the flow of T f_0 + Σ c_j W_j(T) f_j at the time 1. Else the
reference is the log-ODE of step two (`sepv.properties._orders.log_ode`) over a path of increments
and Lévy areas refined LOG_ODE_REFINEMENT times. It has mean-square order 1, also if the noises do
not commute. So its error is smaller than that of a scheme of order 1 by the factor
LOG_ODE_REFINEMENT, and than that of a scheme of order ½ by more. Let y_δ be its result with the
step size δ. The error is estimated by |y_δ − y_2δ|. The reference is 2y_δ − y_2δ: this
extrapolation hardly changes errors of paths, but makes their mean O(δ²), which is enough for weak
order 2.

A scheme of order 1.5 for commuting noises would soon be more accurate than this reference. For such
a scheme the log-ODE also has the brackets with the drift, by space-time areas. Its errors are then
O(δ) in the mean, which the extrapolation removes, and otherwise O(δ^{3/2}).
"""

from __future__ import annotations

import numpy as np
from sepv.properties._orders.gaussian_step import gaussian_path, is_gaussian
from sepv.properties._orders.log_ode import log_flow, path

from sepv.exact import exact_flow
from sepv.problem import (
    Array,
    Problem,
    column,
    commutes,
    each_noise,
    one_field,
)
from sepv.simulate import RoughPath, areas

# The number of reference steps in each of the finest steps of a scheme.
LOG_ODE_REFINEMENT = 8


def ends(problem: Problem, y0: Array, T: float, W: Array) -> Array | None:
    """Return the exact solution y(T) (d, M) from y0 (d,) for given W(T) (m, M),
    or None if there is no formula.
    """
    if one_field(problem):
        return exact_flow(problem, problem.random_step(T, W), y0).y
    form = getattr(problem, "closed_form", None)
    if form is None and commutes(problem):
        states = np.repeat(y0[:, None], W.shape[1], axis=1)
        return log_flow(problem, states, each_noise(problem, T, W), np.zeros((0, W.shape[1])))[0]
    return None if form is None else np.asarray(form(y0, T, W))


def refined(
    problem: Problem, y0: Array, T: float, steps: int, paths: range, seed: int, order: float, asks: str = ""
) -> tuple[RoughPath, Array, float]:
    """Return the reference for fields that do not all commute: finer noise and areas, y(T) (d, M),
    rms error.

    `order` is the mean-square order that the scheme claims for this problem, and `asks` what it
    gets beside increments. With additive noise and an affine drift y(T) is exact
    (`sepv.properties._orders.gaussian_step`).
    """
    if is_gaussian(problem):
        finest = steps * (areas.FINE_STEPS if asks else 1)
        rough = areas.drawn(seed, T=T, steps=finest, noises=problem.noises, paths=paths)
        return rough, gaussian_path(problem, y0, rough, seed, paths), 0.0
    fine = areas.drawn(seed, T=T, steps=LOG_ODE_REFINEMENT * steps, noises=problem.noises, paths=paths)
    half = fine.coarse(LOG_ODE_REFINEMENT * steps // 2)
    with_drift = order > 1 and column(problem) != "general"
    y, coarse = (path(problem, y0, rough, with_drift=with_drift) for rough in (fine, half))
    return fine, 2 * y - coarse, float(np.sqrt(np.mean(np.sum((y - coarse) ** 2, axis=0))))
