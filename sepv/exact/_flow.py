"""The exact solution of (1.1): the deterministic flow at the random time θ(t) = t + Σ_j c_j W_j(t).

By the Stratonovich chain rule y(t) = φ_θ(t)(y0), where φ is the flow of y′ = B(y)∇H(y). The
oscillator (rotation), the rigid body and the pendulum (Jacobi elliptic functions) have closed
forms. Other problems are solved numerically once over [min θ, max θ], accurate to rounding. The
result depends on no step size, and on no scheme under verification.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from sepv._arguments import floats
from sepv._kept import kept, key_of
from sepv.errors import UsageError
from sepv.exact._closed_forms import CLOSED_FORMS
from sepv.exact._dense_flow import solve_dense
from sepv.problem import Array, NamedProblem, Problem, damping_of, drift, one_field, vector_field
from sepv.record import EPS, PolynomialMap
from sepv.schemes import load_problem
from sepv.simulate import initial_state

# The largest number of times θ of a solution that is stored between runs (`sepv._kept`).
MOST_KEPT = 1024


@dataclass(frozen=True)
class ExactFlow:
    """The exact solution y = φ_θ(y0), (d, M), at M random times θ, its largest absolute error,
    and its method.
    """

    y: Array
    error: float
    method: str


def exact_flow(
    problem: str | Problem, theta: ArrayLike, y0: ArrayLike | None = None, *, dense: bool = False
) -> ExactFlow:
    """The exact solution φ_θ(y0) of dy = B(y)∇H(y)(dt + Σ_j c_j∘dW_j) at M random times θ.

    A damped problem without noise, y′ = B∇H − γy, has a flow too, and θ is then the time.

    Parameters
    ----------
    problem : str or Problem
        The problem or its name, as for `sepv.integrate`.
    theta : (M,) or scalar, of either sign
        The random times θ = t + Σ_j c_j W_j(t).
    y0 : (d,), optional
        The state at θ = 0, by default the problem's initial state.
    dense : bool
        True solves numerically even if the problem has a closed form.

    Returns
    -------
    ExactFlow
        Its `error` estimates the largest error. For a numerical solution it is four times the
        largest difference from a second solution, of another order and with other panels, plus 8
        roundings. For a closed form it is 16 eps (|y| + |f(y)| (1 + |θ|)) with the largest |y|,
        |f(y)|, |θ| (special functions: below 4 eps measured).

    Raises
    ------
    UsageError
        If θ is not finite, or there is no initial state.
    FlowFailure, an ArithmeticError
        If the solution ends before the time θ.

    Examples
    --------
    >>> import numpy as np
    >>> import sepv
    >>> exact = sepv.exact_flow("harmonic-oscillator", [0.0, np.pi], y0=(1.0, 0.0))
    >>> exact.y.round(12).tolist()[0]
    [1.0, -1.0]
    """
    problem = load_problem(problem)
    if problem.noises and not one_field(problem):
        raise UsageError(
            expected="a problem of class (1.1): one structure, one random time",
            received=f"{problem.name}, with several structures or Hamiltonians",
            remedy="its closed_form, where the flows commute; no formula is known where they do not",
        )
    times = floats("theta", theta)
    start = initial_state(problem, y0)
    if times.ndim > 1 or not times.size or not np.all(np.isfinite(times)):
        raise UsageError(
            expected="theta finite, of shape (M,) or a scalar",
            received=f"shape {times.shape}",
            remedy="θ = t + Σ c_j W_j(t), one value for each path",
        )
    flat = times.ravel()
    result = None
    if isinstance(problem.data, NamedProblem) and not dense:
        form = CLOSED_FORMS.get(problem.data.name)
        result = form(dict(problem.data.parameters), start, flat) if form else None
    if result is None:
        y, error, method = *_dense_flow(problem, start, flat), "Gauss collocation in panels"
    else:
        y, method = result
        speed = float(np.max(np.abs(vector_field(problem, y))))
        error = 16 * EPS * (float(np.max(np.abs(y))) + speed * (1 + float(np.max(np.abs(flat)))))
    return ExactFlow(y.reshape(problem.dimension, *times.shape), error, method)


def _dense_flow(problem: Problem, y0: Array, theta: Array) -> tuple[Array, float]:
    """The exact solution, computed numerically, and its error,
    estimated from a solution with other panels.
    """

    def f(y: Array) -> Array:
        value = drift(problem, y)
        if problem.domain is not None:
            value = np.where(problem.domain(y), value, np.nan)
        return value

    def solved() -> tuple[Array, float]:
        y, check = _evaluate(f, y0, theta, 20, 0.8), _evaluate(f, y0, theta, 16, 0.6)
        return y, 4 * float(np.max(np.abs(y - check))) + 8 * EPS * float(np.max(np.abs(y)))

    parts = problem.structure, problem.gradient
    if damping_of(problem):
        return solved()
    if theta.size > MOST_KEPT or problem.domain or not all(isinstance(v, PolynomialMap) for v in parts):
        return solved()
    y, error = kept("flows").get(key_of(parts, y0, theta), solved)
    return y.copy(), error


def _evaluate(f: Callable[[Array], Array], y0: Array, theta: Array, stages: int, shrink: float) -> Array:
    """The solution of y′ = f(y) from y0 at times θ of either sign,
    by `solve_dense` forwards and backwards.
    """
    result = np.repeat(y0[:, None], theta.size, axis=1)
    for side in (theta > 0, theta < 0):
        if side.any():
            times = theta[side]
            end = float(times[np.argmax(np.abs(times))])
            result[:, side] = solve_dense(f, y0, end, stages, shrink)(times)
    return result
