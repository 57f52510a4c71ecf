"""Lévy areas and space-time Lévy areas: their moments given a step's increments,
and rough paths (W with its areas).

The Lévy area of a step of length h is A_ij = ½∫(W_i dW_j − W_j dW_i). With the Brownian bridges
b_i(t) = W_i(t) − (t/h)ΔW_i and B_i = ∫b_i dt,

    A_ij = (ΔW_j B_i − ΔW_i B_j)/h + a_ij,    B_i ~ N(0, h³/12),    a_ij = ½∫(b_i db_j − b_j db_i),

because ∫t db_j = −B_j. Given ΔW, all terms have mean zero. No two of the B_i and a_ij
are correlated, because a_ij is odd in b_i and in b_j. As Var a_ij = h²/12, E[A_ij² |
ΔW] = h²/12 + h(ΔW_i² + ΔW_j²)/12, so that E[A_ij²] = h²/4. Third moments vanish except
E[a_ij a_jk a_ki] of three noises, which is O(h³). The space-time areas are H_i = B_i/h
(J. Foster, T. Lyons and H. Oberhauser, SIAM J. Numer. Anal. 58, 2020): ∫W_i ds
− ½hΔW_i = hH_i over a step.

**Drawn areas.** Over fine steps of length δ, the B_i are drawn from their distribution, and the
a_ij as normal numbers of the right variance. Over a step of K fine steps Chen's relation is A = Σ_k
A_k + ½ Σ_{k<l} ΔW_k ∧ ΔW_l, where (v ∧ w)_ij = v_i w_j − v_j w_i. Only the shape of the fine a_ij's
distribution is approximate, and the fine a_ij make up 1/K of the variance h²/12 of the step's a_ij
(for such couplings see A. Davie, in: Stochastic Analysis 2010). Increments and areas are one rough
path, the same for schemes and reference solutions at all step sizes.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from sepv.errors import UsageError
from sepv.problem import Array
from sepv.simulate import _wiener as wiener

# Fine steps per step of a scheme that uses areas: with eight, the shape of the fine a_ij's
# distribution hardly matters.
FINE_STEPS = 8
# The seed of the areas is the seed of the increments plus this number, and so far from seeds given
# by hand.
_SECOND_STREAM = 2**40


def points(xi: Array) -> tuple[Array, Array]:
    """Nodes (k, P, Q) and weights (Q,), of degree 3, for k Lévy areas of a step h = 1 with
    increments xi (m, P).

    The areas depend on n uncorrelated numbers, m B_i and k a_ij (see the module), with nodes ±√n
    e_i of equal weights.
    """
    m = len(xi)
    pairs = list(combinations(range(m), 2))
    n = m + len(pairs)
    if not pairs:
        return np.zeros((0, xi.shape[1], 1)), np.ones(1)
    normals = np.sqrt(n) * np.concatenate([np.eye(n), -np.eye(n)], axis=1)
    return _from_normals(xi[..., None], normals[:, None], pairs, 1.0), np.full(2 * n, 0.5 / n)


def bridges(noises: int) -> Array:
    """The space-time Lévy areas H_i (m, Q) of a step h = 1 at the Q nodes of `points`,
    for m = `noises` ≥ 2.
    """
    n = noises + noises * (noises - 1) // 2
    return np.asarray(np.sqrt(n / 12) * np.concatenate([np.eye(noises, n), -np.eye(noises, n)], axis=1))


def _from_normals(dW: Array, normals: Array, pairs: list[tuple[int, int]], h: float) -> Array:
    """Lévy areas A_ij (k, ...) from ΔW (m, ...) and `normals`: m for the B_i,
    then k for the a_ij (see the module).
    """
    m = len(dW)
    return np.stack([
        h**0.5 / 12**0.5 * (dW[j] * normals[i] - dW[i] * normals[j]) + h / 12**0.5 * normals[m + k]
        for k, (i, j) in enumerate(pairs)
    ])  # fmt: skip


@dataclass(frozen=True)
class RoughPath:
    """M rough paths over N fine steps h: dW and space-time areas `bridges` (N, m, M),
    and Lévy areas (N, k, M).
    """

    h: float
    dW: Array
    areas: Array
    bridges: Array

    def coarse(self, steps: int) -> RoughPath:
        """The rough path over `steps` longer steps, by Chen's relation; `steps` must divide N."""
        N, m, M = self.dW.shape
        K = N // steps
        dW = self.dW.reshape(steps, K, m, M)
        before = np.cumsum(dW, axis=1) - dW
        areas = self.areas.reshape(steps, K, -1, M).sum(axis=1)
        for k, (i, j) in enumerate(combinations(range(m), 2)):
            areas[:, k] += 0.5 * np.sum(before[:, :, i] * dW[:, :, j] - before[:, :, j] * dW[:, :, i], axis=1)
        # ∫W ds over a coarse step is the sum of the integrals over its fine steps, each started
        # from W(kδ).
        means = (before + 0.5 * dW + self.bridges.reshape(steps, K, m, M)).mean(axis=1)
        return RoughPath(K * self.h, dW.sum(axis=1), areas, means - 0.5 * dW.sum(axis=1))

    def rows(self, steps: int, asks: str) -> Array:
        """Rows (steps, m + k, M) for `steps` steps: m of increments,
        then k of the data that `asks` names, e.g. areas.

        Raises UsageError if `asks` is "halves" and the N fine steps do not divide into 2·`steps`
        equal parts.
        """
        coarse = self.coarse(steps)
        further = {"areas": coarse.areas, "space-time": coarse.bridges}.get(asks, coarse.dW[:, :0])
        if asks == "halves":
            if self.dW.shape[0] % (2 * steps):
                raise UsageError(
                    expected=f"a path of a multiple of {2 * steps} fine steps",
                    received=f"{self.dW.shape[0]}",
                    remedy="draw it finer",
                )
            further = self.coarse(2 * steps).dW[::2]
        return np.concatenate([coarse.dW, further], axis=1)


def drawn(seed: int, *, T: float, steps: int, noises: int, paths: int | range) -> RoughPath:
    """Draw rough paths: the increments of `wiener.increments` with the same arguments,
    and all their areas.
    """
    dW = wiener.increments(seed, T=T, steps=steps, noises=noises, paths=paths)
    pairs = list(combinations(range(noises), 2))
    h = T / steps
    more = wiener.increments(
        seed + _SECOND_STREAM, T=float(steps), steps=steps, noises=noises + len(pairs), paths=paths
    )
    bridges = np.sqrt(h / 12) * more[:, :noises]
    if not pairs:
        return RoughPath(h, dW, np.zeros((steps, 0, dW.shape[2])), bridges)
    areas = _from_normals(np.moveaxis(dW, 1, 0), np.moveaxis(more, 1, 0), pairs, h)
    return RoughPath(h, dW, np.moveaxis(areas, 0, 1), bridges)
