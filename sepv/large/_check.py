"""Consistency of a large problem's parts: B is skew, ∇H, H″ and averaged ∇H belong to H, and B′ and C belong to B."""

from __future__ import annotations

import numpy as np

from sepv.errors import ProblemError
from sepv.large._problem import LargeProblem
from sepv.problem import Array, slope_along

# The largest allowed relative error of a part. If a function varies on the scale of y, its central differences of order
# six, with a width of 2⁻⁷ of this scale, have an error of 1e-12. A wrong sign, factor or term changes the first digit.
TOLERANCE = 1e-6
_WIDTH = 2.0**-7


def check_large(problem: LargeProblem, seed: int = 0) -> None:
    """Compare the parts of a large problem with each other, along a random direction at its initial state.

    Raises
    ------
    ProblemError
        If a part contradicts the others. The message shows the given and the expected value.
    """
    rng = np.random.default_rng(seed)
    y = np.array(problem.initial)
    direction = rng.standard_normal(y.size)
    direction *= (
        np.max(np.abs(y)) / np.max(np.abs(direction)) if problem.domain is None else 0.05 * np.min(np.abs(y))
    )
    B = problem.structure(y)
    skew = abs(B + B.T).max()
    if B.shape != (y.size, y.size) or skew > 0:
        raise ProblemError(
            expected=f"structure: a sparse skew-symmetric matrix {(y.size, y.size)}",
            received=f"shape {B.shape}, largest entry of B + Bᵀ {skew!r}",
            remedy="build the part above the diagonal, and subtract its transpose",
        )
    _same("gradient", problem.gradient(y) @ direction, slope_along(problem.energy, y, direction, _WIDTH))
    _same("hessian", problem.hessian(y) @ direction, slope_along(problem.gradient, y, direction, _WIDTH))
    v = rng.standard_normal(y.size)
    slope = np.zeros_like(y) if problem.structure_slope is None else problem.structure_slope(y, v) @ direction
    _same("structure_slope", slope, slope_along(lambda at: problem.structure(at) @ v, y, direction, _WIDTH))
    for name in ("casimirs", "other_casimirs"):
        function = getattr(problem, name)
        if function is not None:
            # The derivative of C along B v is vᵀBᵀ∇C = 0 for every v.
            flow = B @ v
            flow *= np.max(np.abs(direction)) / (np.max(np.abs(flow)) or 1.0)
            size = np.max(np.abs(function(y)), initial=1.0)
            _same(name, slope_along(function, y, flow, _WIDTH) / size, np.zeros(np.shape(function(y))))
    if problem.mean_gradient is not None:
        from sepv.record import gauss_legendre

        points, weights = gauss_legendre(32)
        quadrature = sum(
            w * problem.gradient(y + t * direction) for t, w in zip(points, weights, strict=True)
        )
        _same("mean_gradient", problem.mean_gradient(y, y + direction), np.asarray(quadrature))


def _same(name: str, given: Array, expected: Array) -> None:
    """Raise a ProblemError if the relative error of a problem's part `name` is larger than TOLERANCE."""
    scale = max(float(np.max(np.abs(expected), initial=0.0)), float(np.max(np.abs(given), initial=0.0)), 1.0)
    error = np.abs(np.asarray(given) - expected).reshape(-1)
    if error.size and not np.max(error) <= TOLERANCE * scale:
        worst = int(np.argmax(error))
        raise ProblemError(
            expected=f"{name} to be that of its function: {np.ravel(expected)[worst]!r} at [{worst}]",
            received=f"{np.ravel(given)[worst]!r}",
            remedy=f"correct {name}, or the function that it belongs to",
        )
