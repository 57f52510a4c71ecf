"""Means of errors, for laws about weak orders and limits,
and combinations of means at several step sizes.

A mean of errors has an expansion μ(h) = a h^p + b h^(p+1) + c h^(p+2) + … in the step size
(Talay and Tubaro 1990). A claim says that the first coefficient a vanishes, with p = 0 for a
limit and p = q − 1 for a weak order q. The linear combination of three step sizes that gives a
is itself a mean over paths. So its interval is Student's, even if the mean changes its sign at
some h. No logarithm is taken of a number that may be zero.

Errors are capped at the size of the solution, |e| ≤ max|y(T)|. So one path that diverges at a
coarse step does not dominate the sample. A weak order remains, because it holds for bounded test
functions too. `benchmarks.coverage` measures how often these intervals miss.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations_with_replacement

import numpy as np
from sepv.properties._orders.convergence import StrongErrors

from sepv.problem import Array, Problem, drift, ito_drift, noise_field
from sepv.statistics import students_t


@dataclass(frozen=True)
class Coefficient:
    """A coefficient (K,) of the expansions of K means in powers of h, with its standard error (K,)
    and a remainder.

    `remainder` is the change of the coefficient if the coarsest step size is included, which
    estimates the effect of the omitted powers.
    """

    value: Array
    error: Array
    remainder: Array
    paths: int
    power: float = 0

    def half(self, alpha: float, more: float = 1.0) -> Array:
        """Return half-widths (K,) of joint intervals at level 1 − alpha,
        as if there were `more` times the paths.
        """
        return critical(alpha / self.value.size, self.paths) * self.error / np.sqrt(more)


def critical(alpha: float, paths: int) -> float:
    """Return Student's two-sided quantile for a mean over `paths` paths."""
    return students_t(alpha / 2, paths - 1)


def capped(errors: StrongErrors) -> Array:
    """Return the errors e (L, d, M) without their weights, shortened to |e| ≤ scale,
    infinite and NaN ones included.
    """
    weights = errors.weights[:, None]
    # A path of weight 0 was left out, and its error is 0 already.
    e = np.divide(errors.errors, weights, out=np.zeros_like(errors.errors), where=weights > 0)
    e = np.nan_to_num(e, nan=errors.scale, posinf=errors.scale, neginf=-errors.scale)
    size = np.max(np.abs(e), axis=1, keepdims=True)
    return e * np.minimum(1.0, errors.scale / np.maximum(size, errors.scale * 1e-300))


def moment_errors(errors: StrongErrors) -> Array:
    """Return the weighted errors w·[g(y_N) − g(y(T))] of g = y_i and y_i y_j, (L, K, M),
    in units of the spread of g.

    The spread is that of g(y(T)). If g hardly varies, like a Casimir, the unit is a thousandth of
    the size of g.
    """
    e, y = capped(errors), errors.ends
    d = y.shape[1]
    pairs = list(combinations_with_replacement(range(d), 2))
    parts, spreads = [e[:, i] for i in range(d)], [_spread(y[0, i], errors, 1) for i in range(d)]
    for i, j in pairs:
        parts.append(e[:, i] * y[:, j] + y[:, i] * e[:, j] + e[:, i] * e[:, j])
        spreads.append(_spread(y[0, i] * y[0, j], errors, 2))
    return np.stack(parts, axis=1) * errors.weights[:, None] / np.array(spreads)[:, None]


def _spread(g: Array, errors: StrongErrors, degree: int) -> float:
    w = errors.weights[0]
    middle = np.mean(w * g)
    return max(float(np.sqrt(np.mean(w * (g - middle) ** 2))), 1e-3 * errors.scale**degree)


def limit_errors(errors: StrongErrors, problem: Problem) -> tuple[list[str], Array, Array]:
    """Return K possible causes of an error e, the shares (L, K, M) by which each would be wrong,
    and their sizes (K,).

    The causes are drift, noise, each noise, and Itô's correction. If one is too large by the share
    γ, it moves y(T) by γv to first order, with v = T B∇H for the drift, Σ c_j W_j G_j∇H for the
    noise and ½T Σ c_j² (G_j∇H)′G_j∇H for the correction. The share is ⟨v, e⟩/E|v|². If the limit is
    right, the mean share vanishes with h, because e does. For noises the share is Cov(v, e)/Var v.
    Then the part of e independent of the noise (nearly all if c is small) adds no variance. The
    size of a cause is the rms of its v at the coarsest step.
    """
    e = capped(errors)
    rows, sizes = [], np.empty(0)
    for level, W in enumerate(errors.W):
        names, directions = _directions(problem, errors.ends[level], errors.T, W)
        w, row = errors.weights[level], []
        middle = w / np.mean(w)  # the weights of a mean in which constants have no variance
        for name, v in zip(names, directions, strict=True):
            x, error = v, e[level]
            if name.startswith("noise"):
                x, error = (a - np.mean(middle * a, axis=1, keepdims=True) for a in (x, error))
            row.append(w * np.sum(x * error, 0) / np.mean(w * np.sum(x * x, 0)))
        rows.append(row)
        if not level:
            sizes = np.sqrt([np.mean(w * np.sum(v * v, 0)) for v in directions])
    return names, np.array(rows), sizes


def _directions(problem: Problem, y: Array, T: float, W: Array) -> tuple[list[str], list[Array]]:
    noises = [c * W[j] * noise_field(problem, j, y) for j, c in enumerate(problem.c)]
    first = drift(problem, y)
    correction = T * (ito_drift(problem, y) - first)
    named = [("drift", T * first), ("noise", np.sum(noises, axis=0))]
    if len(noises) > 1:
        named += [(f"noise {j}", v) for j, v in enumerate(noises, 1)]
    named.append(("Itô correction", correction))
    named = [(name, v) for name, v in named if np.any(v)]
    return [name for name, _ in named], [v for _, v in named]


def leading(samples: Array, h: Array, power: float) -> Coefficient:
    """Estimate the coefficient of h^power in means of samples (L, K, M) that expand in h^power,
    h^(power + 1), ….
    """
    chosen = sorted({0, len(h) // 2, len(h) - 1})
    weights = _combination(h[chosen], power)
    fewer = np.concatenate([[0.0], _combination(h[chosen[1:]], power)])
    paths = samples.shape[2]
    means = samples[chosen].mean(axis=2)
    each = np.einsum("l,lkm->km", weights, samples[chosen])
    error = each.std(axis=1, ddof=1) / np.sqrt(paths)
    return Coefficient(weights @ means, error, np.abs((weights - fewer) @ means), paths, power)


def _combination(h: Array, power: float) -> Array:
    """Return the weights λ with Σ λ_l h_l^(power + i) = 1 for i = 0, and 0 for i = 1, …, L − 1."""
    unit = h / h[-1]
    system = unit[None] ** (power + np.arange(len(h))[:, None])
    return np.linalg.solve(system, np.eye(len(h))[0]) / float(h[-1]) ** power


def decay(samples: Array, h: Array, alpha: float, more: float = 1.0) -> tuple[float, float, float]:
    """Estimate the order at which the largest of K means falls from the coarsest step to the
    finest: value, low, high.

    The intervals of all 2K means, as if there were `more` times the paths, hold together with
    probability 1 − alpha. If at the coarsest step all of them contain 0, `low` is −∞; if at the
    finest step, `high` is ∞.
    """
    paths = samples.shape[2]
    ends = samples[[0, -1]]
    means = np.abs(ends.mean(axis=2))
    half = critical(alpha / (2 * means.shape[1]), paths) * ends.std(axis=2, ddof=1) / np.sqrt(paths * more)
    (c_low, f_low), (c_high, f_high) = np.max(means - half, axis=1), np.max(means + half, axis=1)
    span = float(np.log(h[0] / h[-1]))
    c, f = np.max(means, axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        value = np.log(c / f) / span
        low = np.log(c_low / f_high) / span if c_low > 0 else -np.inf
        high = np.log(c_high / f_low) / span if f_low > 0 else np.inf
    return float(value), float(low), float(high)
