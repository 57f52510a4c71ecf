"""sdeint's integrators, one step at a time through its own code. Needs the extra ``sdeint``."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import sdeint

from sepv.fields import vector_field
from sepv.problem import Array, Problem
from sepv.scheme import Scheme


def _step_by(integrator: Callable[..., Any]) -> Callable[[Problem, Array, float, Array], Array]:
    """A step by sdeint's integrator over tspan = (0, h), with drift f = B∇H and noise fields c_j f."""

    def step(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        def drift(state: Array, _time: float) -> Array:
            return vector_field(problem, state)

        def noise(state: Array, _time: float) -> Array:
            return np.outer(vector_field(problem, state), problem.c)

        path = integrator(drift, noise, y, np.array([0.0, h]), dW=dW.reshape(1, -1))
        return np.asarray(path[-1])

    return step


strat_heun = Scheme(
    name="sdeint stratHeun",
    step=_step_by(sdeint.stratHeun),
    mean_square_order=1.0,
    source="sdeint.stratHeun; order 1 because all noises drive one field",
    truncation=None,
)

# Given the Stratonovich coefficients unconverted, as a user does who overlooks the difference.
ito_euler = Scheme(
    name="sdeint itoEuler, unconverted",
    step=_step_by(sdeint.itoEuler),
    mean_square_order=0.5,
    source="sdeint.itoEuler, given the coefficients of the Stratonovich form",
    truncation=None,
)
