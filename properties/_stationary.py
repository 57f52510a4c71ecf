"""The stationary covariance of a step and of the exact flow, for friction with a quadratic V:
no paths are sampled.

Let the drift be −A(y − μ), with noise G dW. If all eigenvalues of A have positive real parts, the
exact solution has the stationary distribution N(μ, Σ) with

    AΣ + ΣAᵀ = GGᵀ                                                                               (S)

(C. W. Gardiner, Handbook of Stochastic Methods, 2004, §4.5.6). Here A = Γ − BH″. A step of most
schemes is then an affine map too, y1 = b + Φy + Nξ with independent normal ξ, from which all
increments and further rows of the step are made. This is tested. If the spectral radius of Φ is
below 1, the step has the stationary distribution N(ν, S) with

    ν = b + Φν,    S = ΦSΦᵀ + NNᵀ.                                                               (D)

Increments are not clipped here. A scheme that clips them itself is not affine.

**Roundings.** Both equations are solved in standard deviations of the exact distribution, as
LX = R with the matrix L of a linear map of covariances. A computed X has the error |L⁻¹|(|LX
− R| + γ(|L||X| + |R|) + δ), where γ is the rounding of d² + d sums and δ that of L and R.
For (S) δ comes from K operations behind each entry of A and G. For (D) a step errs by e in
each component, which is its residual (`sepv.law.tolerance`) times the largest ‖(I + chA)⁻¹‖
for c = 0, ½, 1: right for explicit steps, the midpoint rule and an implicit Euler step, an
estimate for others. So Φ and N, differences of steps, err by 2e, and δ = 4e(‖Φ‖ Σ|S| + ‖N‖)
in the norm of row sums.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from random import Random

import numpy as np
from sepv.properties._orders.gaussian_step import AFFINE_TOLERANCE, affine_slope
from sepv.properties._problems_of import problems_of

from sepv.errors import Skipped, StepFailure, Unasked
from sepv.law.tolerance import operations, step_residual
from sepv.problem import (
    Array,
    PolynomialSystem,
    Problem,
    Systems,
    damping_of,
    drift,
    friction,
    noise_vectors,
)
from sepv.problems import canonical, started
from sepv.record import EPS, poly
from sepv.schemes import Scheme, ask, has_memory, takes

# The largest dimension: (S) and (D) are solved as systems of d² equations.
STATIONARY_MAX_DIMENSION = 12
# A mode that decays by a smaller share of its own frequency is counted as undamped: roundings of A
# move it as much.
LEAST_DECAY = 2.0**-40
# A covariance with a larger bound of its roundings, in standard deviations, is not judged.
COVARIANCE_MAX_ERROR = 2.0**-20
# A step whose spectral radius is nearer to 1 has a singular equation (D).
RADIUS_GAP = 2.0**-36
# The slowest decay a and the fastest rate |λ| of A make the step a/(DECAY_SHARE |λ|²), at which a
# step must decay.
DECAY_SHARE = 64.0
# The states and normal numbers, in standard deviations, at which a step is compared with its affine
# map.
TESTED_DEVIATIONS = (1.0, -0.5, 3.0)
# Random systems of two or three bodies beside those with names.
RANDOM_MEMBERS = 2


@dataclass(frozen=True)
class Stationary:
    """A stationary distribution: mean (d,) and covariance (d, d).

    `rounding` bounds the roundings of both, in standard deviations of the exact distribution.
    `time` is 1/|λ| for the fastest eigenvalue λ of A, or the step. `drift` is A.
    """

    mean: Array
    covariance: Array
    rounding: float
    time: float
    drift: Array

    @property
    def sizes(self) -> Array:
        """The standard deviations (d,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))


def exact(problem: Problem) -> Stationary | str:
    """The stationary distribution of the exact solution by (S),
    or the reason why there is none of this form.
    """
    d = problem.dimension
    if d > STATIONARY_MAX_DIMENSION:
        return f"{problem.name} has more than {STATIONARY_MAX_DIMENSION} components"
    if len(noise_vectors(problem)) != problem.noises or not problem.c.any():
        return f"the noise of {problem.name} is not given by vectors, or is zero"
    A = affine_slope(problem)
    if A is None:
        return f"V of {problem.name} is not quadratic"
    rates = np.linalg.eigvals(A)
    if np.min(rates.real) <= LEAST_DECAY * np.max(np.abs(rates)):
        return f"{problem.name} has a part without friction, and no stationary distribution"
    G = noise_vectors(problem).T * problem.c
    mean = np.asarray(np.linalg.solve(A, drift(problem, np.zeros(d))))
    solved = _solved(_of_flow(A), G @ G.T, np.zeros((d, d)))[0]
    if not np.all(np.diag(solved) > 0):
        return f"the noise of {problem.name} does not reach every component"
    sizes = np.sqrt(np.diag(solved))
    A_hat, G_hat = A * sizes / sizes[:, None], G / sizes[:, None]
    each = 0.5 * EPS * operations(problem)
    spread = np.abs(A_hat) @ np.abs(solved / np.outer(sizes, sizes))
    delta = 2 * each * (spread + spread.T + np.abs(G_hat) @ np.abs(G_hat).T)
    _, rounding = _solved(_of_flow(A_hat), G_hat @ G_hat.T, delta)
    about = np.linalg.norm(np.linalg.inv(A_hat), np.inf) * each * np.linalg.norm(A_hat, np.inf)
    rounding += 2 * float(about * np.max(np.abs(mean / sizes)))
    return Stationary(mean, solved, rounding, float(1 / np.max(np.abs(rates))), A)


def _of_flow(A: Array) -> Array:
    """The matrix (d², d²) of the map Σ → AΣ + ΣAᵀ."""
    one = np.eye(len(A))
    return np.asarray(np.kron(A, one) + np.kron(one, A))


@dataclass(frozen=True)
class AffineStep:
    """A step y1 = rest + Φy + Nξ, in units of given sizes from a given state.

    `error` bounds the error of a computed step, and `radius` is the spectral radius of Φ.
    """

    rest: Array
    Phi: Array
    N: Array
    error: float
    radius: float


def affine(
    scheme: Scheme, problem: Problem, h: float, centre: Array, sizes: Array, A: Array
) -> AffineStep | str:
    """The affine map of a step, or the reason why there is none: the scheme refuses it,
    or it is not affine.

    The map is found from states and normal numbers up to 3 `sizes` (d,) from `centre` (d,). The
    drift has the slope −A.
    """
    d, rows = problem.dimension, rows_of(scheme, problem, h)
    k = rows.shape[1]
    likely = np.full(problem.noises, max(TESTED_DEVIATIONS) * math.sqrt(h))
    if not takes(scheme, problem, centre, h, likely):
        return f"{problem.name}: a step of {h:.2g} is longer than the longest that the scheme states"
    error = 0.0

    def step(y: Array, xi: Array) -> Array:
        """A step in `sizes` from the centre; `error` bounds the residuals of all."""
        nonlocal error
        start, row = centre + sizes * y, rows @ xi
        end = ask(scheme, problem, start, h, row)
        residual = step_residual(problem, start, end, h, row[: problem.noises], scheme)
        error = max(error, float(np.max((residual + EPS * np.abs(end)) / sizes)))
        return (end - centre) / sizes

    try:
        rest = step(np.zeros(d), np.zeros(k))
        Phi = np.stack([step(e, np.zeros(k)) - rest for e in np.eye(d)], axis=1)
        N = np.stack([step(np.zeros(d), e) - rest for e in np.eye(k)], axis=1)
        for n, size in enumerate(TESTED_DEVIATIONS):
            signs = np.resize([1.0, -1.0] if n % 2 else [1.0], d + k)
            y, xi = size * signs[:d], size * signs[d:]
            off = np.abs(step(y, xi) - (rest + Phi @ y + N @ xi))
            if np.any(off > max(AFFINE_TOLERANCE, scheme.eps / EPS * 2.0**-40) * (np.abs(rest) + abs(size))):
                return f"a step of {problem.name} is not affine in y and the noise"
    except (StepFailure, Skipped) as refusal:
        return f"{problem.name}, h = {h:.2g}: the scheme refuses the step, {str(refusal).splitlines()[0]}"
    A_hat = A * sizes / sizes[:, None]
    error *= max(float(np.linalg.norm(np.linalg.inv(np.eye(d) + c * h * A_hat), np.inf)) for c in (0, 0.5, 1))
    return AffineStep(rest, Phi, N, error, float(np.max(np.abs(np.linalg.eigvals(Phi)))))


def of_step(scheme: Scheme, problem: Problem, h: float, around: Stationary) -> Stationary | str:
    """The stationary distribution of the scheme's step by (D),
    or the reason why there is none that can be judged.
    """
    sizes = around.sizes
    step = affine(scheme, problem, h, around.mean, sizes, around.drift)
    if isinstance(step, str):
        return step
    if step.radius > 1 - RADIUS_GAP:
        return f"the spectral radius of a step of {problem.name} is {step.radius:.3g} for h = {h:.2g}"
    d, Phi, N = problem.dimension, step.Phi, step.N
    back = np.linalg.inv(np.eye(d) - Phi)
    about = back @ step.rest
    operator, right = np.eye(d * d) - np.kron(Phi, Phi), N @ N.T
    S, _ = _solved(operator, right, np.zeros((d, d)))
    spread = np.linalg.norm(Phi, np.inf) * float(np.sum(np.abs(S))) + np.linalg.norm(N, np.inf)
    _, rounding = _solved(operator, right, np.full((d, d), 4 * step.error * spread))
    of_mean = np.linalg.norm(back, np.inf) * (step.error * (1 + 2 * np.sum(np.abs(about))) + d * EPS)
    rounding = around.rounding + max(rounding, float(of_mean))
    if not rounding <= COVARIANCE_MAX_ERROR:
        return f"the covariance of {problem.name} is known to {rounding:.2g} standard deviations only"
    return Stationary(around.mean + sizes * about, S * np.outer(sizes, sizes), rounding, h, around.drift)


def does_not_decay(scheme: Scheme, problem: Problem, around: Stationary, sizes: Array) -> str:
    """Say where a short step does not forget its start, as the exact solution does; "" if all do.

    The step is Φ = 1 − hA + O(h²). So 1 − ρ(Φ) is near ah at h = a/(64|λ|²), with the slowest decay
    a and the fastest rate |λ| of A: the O(h²) changes it by a share of about (h|λ|²/a)^½ = ⅛ if the
    eigenvalue is double, and less otherwise. Right schemes have .91 to 1.00 of ah. Half is asked,
    less the bound of Bauer and Fike for the error of Φ.
    """
    rates = np.linalg.eigvals(around.drift)
    slowest = float(np.min(rates.real))
    shortest = slowest * around.time**2 / DECAY_SHARE
    for h in (shortest, *(size for size in sizes if size < shortest)):
        step = affine(scheme, problem, float(h), around.mean, around.sizes, around.drift)
        if isinstance(step, str):
            continue
        vectors = np.linalg.cond(np.linalg.eig(step.Phi)[1])
        slack = 2 * problem.dimension * step.error * min(float(vectors), 1 / step.error)
        if 1 - step.radius < 0.5 * slowest * h - slack:
            return (
                f"{problem.name}: a step of h = {h:.3g} multiplies a direction by {step.radius!r}, where the exact "
                f"solution forgets it as exp(−{slowest:.3g} t), {math.exp(-slowest * h)!r} in a step"
            )
    return ""


def _solved(operator: Array, right: Array, delta: Array) -> tuple[Array, float]:
    """The solution X (d, d) of LX = R, and a bound of its error ("Roundings" in the module)."""
    inverse = np.linalg.inv(operator)
    x = inverse @ right.ravel()
    gamma = EPS * (len(operator) + len(right))
    residual = np.abs(operator @ x - right.ravel()) + delta.ravel()
    residual += gamma * (np.abs(operator) @ np.abs(x) + np.abs(right.ravel()))
    X = x.reshape(right.shape)
    return 0.5 * (X + X.T), float(np.max(np.abs(inverse) @ residual))


def rows_of(scheme: Scheme, problem: Problem, h: float) -> Array:
    """The matrix (m + k, n) that makes the rows of a step's increments of n independent normal
    numbers.
    """
    m = problem.noises
    own, none = math.sqrt(h) * np.eye(m), np.zeros((m, m))
    if not scheme.asks:
        return own
    if scheme.asks == "halves":
        half = math.sqrt(0.5) * own
        return np.block([[half, half], [half, none]])
    if scheme.asks == "space-time":
        return np.block([[own, none], [none, own / math.sqrt(12)]])
    raise Unasked("Lévy areas are not normal, and a step is not affine in them")


def balanced(scheme: Scheme, seed: int) -> Iterator[tuple[Problem, Stationary]]:
    """The scheme's problems with friction and quadratic V, and their stationary distributions.

    A scheme for all systems with friction gets random ones of several bodies too.

    Raises
    ------
    Unasked
        If there are none, or the scheme has a memory, so that a step is no map of y alone.
    """
    if has_memory(scheme):
        raise Unasked("a step of a method with memory is no map of y alone")
    why, found = "the systems have no friction", False
    whole = scheme.systems is Systems.FRICTION and not scheme.problems
    for problem in (*(problems_of(scheme) or ()), *(members(seed) if whole else ())):
        distribution = exact(problem) if damping_of(problem) else f"{problem.name} has no friction"
        if isinstance(distribution, Stationary):
            found = True
            yield problem, distribution
        else:
            why = distribution
    if not found:
        raise Unasked(why)


@lru_cache(maxsize=16)
def members(seed: int) -> tuple[Problem, ...]:
    """Random systems of two and three bodies, with a full mass matrix and a force at q = 0."""
    return tuple(_bodies(n, Random(f"bodies {seed} {n}")) for n in range(2, 2 + RANDOM_MEMBERS))


def _bodies(n: int, random: Random) -> Problem:
    """Bodies with H = ½ pᵀM⁻¹p + ½ qᵀKq + kᵀq, where M⁻¹ and K are sums of squares,
    with friction at random kT.
    """

    def form(places: range) -> poly.Polynomial:
        rows = np.zeros((n, 2 * n))
        for i in range(n):
            rows[i, places.start + i : places.stop] = [
                1.0 if i == j else random.choice([-0.5, 0.5]) for j in range(i, n)
            ]
        forms = [poly.linear(row) for row in rows.tolist()]
        weights = [random.choice([0.5, 1.0, 2.0]) for _ in forms]
        return poly.add(
            *(poly.scale(w / 2, poly.multiply(f, f)) for w, f in zip(weights, forms, strict=True))
        )

    pull = poly.linear([random.choice([-0.5, 0.25, 1.0]) for _ in range(n)] + [0.0] * n)
    H = poly.add(form(range(n, 2 * n)), form(range(n)), pull)
    bare = started(PolynomialSystem(2 * n, H, canonical(2 * n, 1.0), ()), f"{n} bodies", (0.0,) * 2 * n)
    return friction(
        bare, random.choice([0.25, 0.5, 1.0]), random.choice([0.5, 1.0, 2.0]), f"{n} random bodies"
    )
