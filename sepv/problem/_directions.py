"""Directions of gradients made orthogonal, for arrays and for symbols."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from sepv.problem._fields import dot

# Gradients closer to those before them than this, relative to their length, are the same to rounding: they add nothing.
DEPENDENT = 2.0**-40


class Directions(NamedTuple):
    """Gram and Schmidt's vectors q_k (d, ...) of gradients N_k, 1/|q_k|² (...), and the products q_jᵀN_k, j < k.

    The reciprocal is 0 where N_k adds nothing to those before it.
    """

    q: list[Any]
    inverse: list[Any]
    products: list[list[Any]]

    def without(self, w: Any) -> Any:
        """w less its parts along the q_k, taken away twice: the first time leaves rounding of a longer vector."""
        for _ in range(2):
            for b, inverse in zip(self.q, self.inverse, strict=True):
                w = w - b * (dot(b, w) * inverse)
        return w

    def correction(self, r: Sequence[Any]) -> Any:
        """u in the span of the N_k with N_kᵀu = r_k, where they are independent."""
        weights: list[Any] = []
        for value, products, inverse in zip(r, self.products, self.inverse, strict=True):
            for w, product in zip(weights, products, strict=True):
                value = value - product * w  # noqa: PLW2901
            weights.append(value * inverse)
        return sum(q * w for q, w in zip(self.q, weights, strict=True))

    def of(self, lanes: Any) -> Directions:
        """The directions in some lanes (M,)."""
        parts = self.q, self.inverse, *self.products
        q, inverse, *products = ([v[..., lanes] for v in part] for part in parts)
        return Directions(q, inverse, products)


def directions(gradients: Sequence[Any]) -> Directions:
    """Make the directions from gradients (d, ...) each."""
    basis = Directions([], [], [])
    for N in gradients:
        q = basis.without(N)
        left = dot(q, q)
        new = left > DEPENDENT**2 * dot(N, N)
        basis.products.append([dot(b, N) for b in basis.q])
        basis.q.append(q)
        basis.inverse.append(np.where(new, 1.0 / np.where(new, left, 1.0), 0.0))
    return basis
