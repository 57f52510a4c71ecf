"""Errors of high order with few paths: importance sampling of the rare large increments that cause
the errors.

With s stages a step's error is C(y)Δ^{2s+1}, and E|error|² is proportional to the (4s + 2)th
moment of a normal number. For s = 4, increments of 4.4 standard deviations cause most of
E|error|². A plain mean over 2000 paths of 8 steps has a relative standard deviation of more than
3. The mean error is proportional to moment 2s + 2. Let ξ_n be the normalised Σ c_jΔW_j of step n.
A third of the paths draws ξ_n at one random n from the density |x|^p φ(x)/E|ξ|^p with p = 4s + 2
(a χ with p + 1 degrees of freedom, with a random sign), another third with p = 2s + 2. The weight
of a path is

    w = 3 / (1 + Σ_p N⁻¹ Σ_n |ξ_n|^p/E|ξ|^p) ≤ 3.

Means of weighted errors are means under the Wiener measure, without bias. Different step sizes have
independent samples, because the important increments depend on the step size.

The exact solution gets the increments truncated as in Remark 2.1 too
(`sepv.properties._orders.convergence`), so that only the scheme's own error is estimated. The error
of truncation is known in closed form (`sepv.exact.clipping_error`). If not only the order but the
size of the error is of interest, the error of truncation has to be added.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from sepv.properties._orders.convergence import StrongErrors, clipped, errors_of

from sepv.exact import exact_flow
from sepv.problem import Array, Problem
from sepv.schemes import Scheme
from sepv.simulate import Watch

_TILTED_CHUNK = 256
# Errors below TILTED_FLOOR·eps·scale are rounding. TILTED_FLOOR is smaller than for plain samples:
# rare paths have small weights and common paths small errors, so even at smaller steps means exceed
# the rounding of a path, which is some 10 eps.
TILTED_FLOOR = 256.0


def tilted_increments(
    rng: np.random.Generator, c: Array, *, T: float, steps: int, paths: int, powers: Sequence[int]
) -> tuple[Array, Array]:
    """Draw increments (steps, m, M), and weights (M,) with which they have the law of Wiener
    increments over [0, T].

    There is one kind of tilted path for each of the even `powers` p, and one kind of path without
    tilting.
    """
    direction = c / np.linalg.norm(c)
    xi = rng.standard_normal((steps, c.size, paths))
    along = np.einsum("j,njm->nm", direction, xi)
    kind = rng.integers(0, len(powers) + 1, paths)
    for n, power in enumerate(powers, 1):
        chosen = np.flatnonzero(kind == n)
        place = rng.integers(0, steps, chosen.size)
        large = np.sqrt(rng.chisquare(power + 1, chosen.size)) * rng.choice([-1.0, 1.0], chosen.size)
        xi[place, :, chosen] += (large - along[place, chosen])[:, None] * direction
        along[place, chosen] = large
    ratio = np.ones(paths)
    for power in powers:
        moment = float(np.prod(np.arange(power - 1, 0, -2, dtype=np.float64)))  # E|ξ|^p = (p − 1)!!
        ratio += np.mean(np.abs(along) ** power, axis=0) / moment
    return np.sqrt(T / steps) * xi, (len(powers) + 1) / ratio


def tilted_errors(
    scheme: Scheme, problem: Problem, *, T: float, steps: Sequence[int], paths: range, seed: int, order: float,
    unit: float = 1.0, watch: Watch | None = None,
) -> StrongErrors:  # fmt: skip
    """Return strong errors by importance sampling for a scheme of mean-square order `order`,
    multiplied by weights.

    Arguments are those of `sepv.properties._orders.convergence.strong_errors`. With weights w,
    `squared` is w|e|² and `errors` is w·e, so that means over paths estimate E|e|² and E e.
    """
    powers = (2 * round(2 * order + 1), 2 * round(order + 1))

    def draw(numbers: range) -> Iterator[tuple[Array, Array, Array, Array]]:
        for count in steps:
            # The numbers of a chunk of paths depend only on the seed, its first path and the number
            # of steps.
            sequence = np.random.SeedSequence(seed, spawn_key=(numbers[0], count))
            rng = np.random.Generator(np.random.SFC64(sequence))
            raw, weights = tilted_increments(
                rng, problem.c, T=T, steps=count, paths=len(numbers), powers=powers
            )
            used = clipped(scheme, raw, T / count, problem.noises, unit)
            W = used.sum(axis=0)
            yield used, exact_flow(problem, problem.random_step(T, W)).y, W, weights

    return replace(
        errors_of(scheme, problem, T, steps, paths, _TILTED_CHUNK, draw, watch), floor=TILTED_FLOOR
    )
