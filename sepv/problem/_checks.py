"""Consistency of a problem's parts: ∇H against H, skewness of B, and ∇CᵀB = 0 for each Casimir."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sepv.core.arrays import EPS, TINY, Array
from sepv.core.average import gauss_legendre, mean_nodes
from sepv.errors import ProblemError
from sepv.problem._stated import Stated

# A correct gradient differs from the complex-step derivative only by rounding: eps times the
# cancellation inside H. The bound 1e-9 is heuristic: it allows for a loss of seven digits, and
# still detects any wrong term.
GRADIENT_TOLERANCE = 1e-9
# A defect of skewness enters the energy at its full size, so only a few eps are allowed.
SKEW_TOLERANCE = 8 * EPS
# ∇CᵀB is a sum of d products with a few rounding errors each.
CASIMIR_TOLERANCE = 1e-12
CHECKED_STATES = 5


def check_problem(problem: Stated) -> None:
    """Compare the parts of a problem at a few states of its domain.

    Raises
    ------
    ProblemError
        At the first contradiction. The message names the component and both values.
    """
    for y in sample_states(problem):
        _check_shapes(problem, y)
        _check_skew(problem, y)
        _check_gradient(problem, y)
        _check_mean_gradient(problem, y)
        _check_casimirs(problem, y)
        _check_derivatives(problem, y)


def sample_states(problem: Stated, length: float = 1.0) -> Iterator[Array]:
    """A few states of the domain around the problem's initial state, the same in every run.

    Component i of a state differs from y_i, that of the initial state, by at most
    (|y_i| + `length`)/4.
    """
    rng = np.random.default_rng(20140203)
    d = problem.dimension
    centre = np.ones(d) if problem.initial is None else np.asarray(problem.initial)
    candidates = [centre] + [
        centre + 0.25 * (length + np.abs(centre)) * rng.uniform(-1, 1, d) for _ in range(64)
    ]
    states = [y for y in candidates if inside(problem, y)]
    if not states:
        raise ProblemError(
            expected="a domain that contains the initial state or states near it",
            received=f"domain(y) is False at y = {centre.tolist()} and at 64 states about it",
            remedy="give initial=, a state inside the domain, or correct domain",
        )
    yield from states[:CHECKED_STATES]


def inside(problem: Stated, y: Array) -> bool:
    """True if a state (d,) lies in the problem's domain, or the problem states no domain."""
    return problem.domain is None or bool(np.all(_call(problem, "domain", y)))


def _check_shapes(problem: Stated, y: Array) -> None:
    d = problem.dimension
    for trailing in ((), (2,)):
        states = np.stack([y] * 2, axis=1) if trailing else y
        for key, shape in (("structure", (d, d)), ("gradient", (d,)), ("hamiltonian", ())):
            got = np.shape(_call(problem, key, states))
            if got != shape + trailing:
                raise ProblemError(
                    expected=f"{key}(y) of shape {shape + trailing} for y of shape {states.shape}",
                    received=f"shape {got}",
                    remedy="component first: index y[0], y[1], … and build arrays with np.stack or np.array, "
                    "so that a batch (d, M) passes through; np.zeros_like(y[0]) for zero entries",
                )


def _check_skew(problem: Stated, y: Array) -> None:
    B = problem.structure(y)
    defect = np.abs(B + B.T)
    i, j = np.unravel_index(np.argmax(defect), defect.shape)
    if not defect[i, j] <= SKEW_TOLERANCE * max(np.abs(B).max(), TINY):
        raise ProblemError(
            expected="a skew-symmetric structure matrix, B_ij = −B_ji",
            received=f"structure(y)[{i}, {j}] = {float(B[i, j])!r} and structure(y)[{j}, {i}] = {float(B[j, i])!r} "
            f"at y = {y.tolist()}",
            remedy="compute the entries above the diagonal and set the others to their negatives",
        )


def _check_gradient(problem: Stated, y: Array) -> None:
    for (k,), value, derivative in _mistaken(problem.gradient(y), problem.hamiltonian, y):
        raise ProblemError(
            expected="gradient to be that of hamiltonian",
            received=f"gradient(y)[{k}] = {value!r}, ∂H/∂y[{k}] = {derivative!r} at y = {y.tolist()}",
            remedy=f"correct gradient(y)[{k}], or hamiltonian",
        )


def _mistaken(
    given: Array, of: Callable[[Any], Any], y: Array
) -> Iterator[tuple[tuple[int, ...], float, float]]:
    """The wrong entries (index, value, right value) of the array `given` (..., d),
    the claimed derivative of `of` at y.

    One random direction v with ½ ≤ |v_k| < 1 is tried first: Σ_k given[..., k] v_k must be the
    derivative along v. It takes one evaluation of `of`, where the d directions of the entries
    take d. A single wrong entry changes the sum by more than half its error δ, so it is missed
    only if δ < 2 GRADIENT_TOLERANCE Σ|given v|, 2d times what is allowed for one entry at most.
    The errors of several entries of a row cancel for no v but a set of measure zero. If the sums
    differ, the entries are tried one by one. So no problem is refused whose entries are right.
    """
    along = _direction(len(y))
    if not _differ(
        given @ along, np.abs(given) @ np.abs(along), given, _derivative(of, y, along, given @ along)
    ).any():
        return
    for k in range(len(y)):
        claimed = given[..., k]
        derivative = _derivative(of, y, np.eye(1, len(y), k)[0], claimed)
        for place in np.argwhere(_differ(claimed, 0.0, given, derivative)):
            yield (*map(int, place), k), float(claimed[tuple(place)]), float(derivative[tuple(place)])


def _direction(d: int) -> Array:
    """A direction (d,) with random signs and sizes between ½ and 1, the same in every run."""
    rng = np.random.default_rng(20140203)
    return np.asarray(rng.choice((-1.0, 1.0), d) * rng.uniform(0.5, 1.0, d))


def _differ(claimed: Any, terms: Any, given: Array, derivative: Any) -> NDArray[np.bool_]:
    """True where a claimed derivative, a sum whose `terms` have these sizes together,
    is wrong or not a number.
    """
    scale = np.maximum(max(float(np.abs(given).max()), 1e-3), terms)
    return ~np.asarray(
        np.abs(derivative - claimed) <= GRADIENT_TOLERANCE * np.maximum(scale, np.abs(derivative))
    )


def _check_mean_gradient(problem: Stated, y: Array) -> None:
    """Check that (y1 − y0)ᵀ∇̄H = H(y1) − H(y0) for the averaged gradient ∇̄H that `mean_gradient`
    or `degree` gives.

    Energy preservation needs this equation. The tolerance is GRADIENT_TOLERANCE relative to the
    terms of the left side. A wrong average, such as ∇H at the midpoint, violates the equation by
    about |y1 − y0|³, which is 1e-5 here.
    """
    end = y * (1 + 2.0**-4) + 2.0**-6
    if (problem.mean_gradient is None and problem.degree is None) or not inside(problem, end):
        return
    if problem.mean_gradient is not None:
        average = problem.mean_gradient(y, end)
    else:
        points, weights = gauss_legendre(mean_nodes(problem.degree or 1))
        average = problem.gradient(y[:, None] + points * (end - y)[:, None]) @ weights
    terms = (end - y) * np.asarray(average, dtype=np.float64)
    difference = float(problem.hamiltonian(end) - problem.hamiltonian(y))
    # Each energy may have a rounding error of 4 eps of its size. GRADIENT_TOLERANCE covers the
    # roundings of the terms.
    rounding = 2.0**-50 * (abs(float(problem.hamiltonian(end))) + abs(float(problem.hamiltonian(y))))
    if not abs(terms.sum() - difference) <= GRADIENT_TOLERANCE * np.abs(terms).sum() + rounding:
        if problem.mean_gradient is None:
            raise ProblemError(
                expected=f"degree = {problem.degree} to be that of H, whose averaged gradient is then exact",
                received=f"(x − y)ᵀ∫∇H = {float(terms.sum())!r} by its quadrature, and H(x) − H(y) = {difference!r} "
                f"for y = {y.tolist()}, x = {end.tolist()}",
                remedy="give the degree of the polynomial H, or leave it out",
            )
        raise ProblemError(
            expected="mean_gradient to be ∫₀¹∇H(y + τ(x − y))dτ, so that (x − y)ᵀmean_gradient = H(x) − H(y) = "
            f"{difference!r}",
            received=f"{float(terms.sum())!r} for y = {y.tolist()}, x = {end.tolist()}",
            remedy="correct it, or leave it out: the mean is then computed by quadrature",
        )


def _check_casimirs(problem: Stated, y: Array) -> None:
    B = problem.structure(y)
    named = [(f"casimirs[{n}]", 2 * A @ y) for n, A in enumerate(problem.casimirs)]
    named += [(f"linear_casimirs[{n}]", b) for n, b in enumerate(problem.linear_casimirs)]
    for key, slope in named:
        product, size = slope @ B, np.abs(slope) @ np.abs(B)
        k = int(np.argmax(np.abs(product)))
        if not abs(product[k]) <= CASIMIR_TOLERANCE * max(size.max(), TINY):
            raise ProblemError(
                expected=f"{key} to be a Casimir: ∇CᵀB = 0 for all y",
                received=f"(∇CᵀB)[{k}] = {float(product[k])!r} at y = {y.tolist()}",
                remedy="correct the matrix (C(y) = yᵀAy), or leave it out: no law then asks for it",
            )


def _check_derivatives(problem: Stated, y: Array) -> None:
    for key, of in (("hessian", problem.gradient), ("structure_derivative", problem.structure)):
        if getattr(problem, key) is None:
            continue
        given, shape = _call(problem, key, y), (*np.shape(of(y)), problem.dimension)
        if np.shape(given) != shape:
            raise ProblemError(
                expected=f"{key}(y) of shape {shape} for y of shape {y.shape}",
                received=f"shape {np.shape(given)}",
                remedy=f"put the derivative by y_k at [..., k], or leave {key} out: differences then serve",
            )
        for index, value, derivative in _mistaken(given, of, y):
            raise ProblemError(
                expected=f"{key} to be the derivative of what it belongs to",
                received=f"{key}(y){list(index)} = {value!r}, derivative {derivative!r} at y = {y.tolist()}",
                remedy=f"correct it, or leave {key} out: differences then serve",
            )


def _derivative(of: Callable[[Any], Any], y: Array, along: Array, claimed: Array) -> Array:
    """The derivative of a function at y along a direction (d,), computed in two ways;
    entries closer to `claimed`.

    The complex step is exact to rounding, but wrong for code that is not analytic (abs,
    comparisons, conversions to float). Differences in extended precision work for any code, but
    lose digits; they are computed where the complex step disagrees. An entry is NaN if neither way
    gives a number.
    """
    best = np.full(np.shape(claimed), np.nan)
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        for method in (_complex_step, _extended_difference):
            try:
                value = np.asarray(method(of, y, along), dtype=np.float64)
            except (TypeError, ValueError, ArithmeticError):
                continue
            if value.shape == best.shape:
                closer = np.isfinite(value) & ~(np.abs(best - claimed) <= np.abs(value - claimed))
                best = np.where(closer, value, best)
            if np.all(np.abs(best - claimed) <= GRADIENT_TOLERANCE * np.abs(claimed)):
                break
    return best


def _complex_step(of: Callable[[Any], Any], y: Array, along: Array) -> Any:
    """The derivative as the imaginary part of the function at y + iεv, divided by ε."""
    return np.imag(of(y + 1e-40j * along)) / 1e-40


def _extended_difference(of: Callable[[Any], Any], y: Array, along: Array) -> Any:
    """The derivative as a central difference of order six in long double,
    with an error of h⁶ + eps_long/h.

    The largest component of v moves by h = 2⁻⁸(1 + |y_k|), for the smallest |y_k| of the components
    that move.
    """
    h = np.longdouble(2.0**-8) * (1 + np.abs(y[along != 0]).min())
    total: Any = np.longdouble(0)
    for distance, weight in ((1, 45), (2, -9), (3, 1)):
        for sign in (1, -1):
            total = total + sign * weight * np.asarray(of(y + sign * distance * h * along))
    return total / (60 * h)


def _call(problem: Stated, key: str, y: Array) -> Any:
    """The value of the problem's function `key` at a copy of y.
    ProblemError if the function raises or changes y.
    """
    copied = y.copy()
    try:
        value = getattr(problem, key)(copied)
        if not np.array_equal(copied, y):
            raise ProblemError(
                expected=f"{key}(y) to leave y as it is",
                received=f"y = {copied.tolist()} after a call with {y.tolist()}",
                remedy="compute with copies: y = y * 2, not y *= 2",
            )
        return value
    except ProblemError:
        raise
    except (Exception, SystemExit) as error:
        raise ProblemError(
            expected=f"{key}(y) to take a state of shape {y.shape}",
            received=f"{type(error).__name__}: {error}",
            remedy="component first: a state is (d,), a batch of M states (d, M)",
        ) from error
