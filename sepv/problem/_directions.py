"""Gradients of invariants made orthogonal by Gram and Schmidt, for arrays and for symbols."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from sepv.problem._fields import dot

# A gradient adds nothing if its part orthogonal to those before it is below this share of its length.
DEPENDENT = 2.0**-40


class Directions(NamedTuple):
    """Orthogonal vectors q_k (d, ...) that span the same space as some gradients N_k.

    `inverse` are the 1/|q_k|², (...), or 0 where N_k adds nothing to those before it. `products` has a list of the
    q_jᵀN_k, j < k, for each k.
    """

    q: list[Any]
    inverse: list[Any]
    products: list[list[Any]]

    def without(self, w: Any) -> Any:
        """The part of w (d, ...) that is orthogonal to all gradients.

        The parts along the q_k are subtracted twice, because the first time leaves the rounding of a longer vector.
        """
        for _ in range(2):
            for b, inverse in zip(self.q, self.inverse, strict=True):
                w = w - b * (dot(b, w) * inverse)
        return w

    def correction(self, r: Sequence[Any]) -> Any:
        """The vector u in the span of the gradients with N_kᵀu = r_k, (d, ...), where they are independent."""
        weights: list[Any] = []
        for value, products, inverse in zip(r, self.products, self.inverse, strict=True):
            for w, product in zip(weights, products, strict=True):
                value = value - product * w  # noqa: PLW2901
            weights.append(value * inverse)
        return sum(q * w for q, w in zip(self.q, weights, strict=True))

    def of(self, lanes: Any) -> Directions:
        """The directions at some of the states, given by their numbers or a mask."""
        parts = self.q, self.inverse, *self.products
        q, inverse, *products = ([v[..., lanes] for v in part] for part in parts)
        return Directions(q, inverse, products)


def directions(gradients: Sequence[Any]) -> Directions:
    """Make gradients, (d, ...) each, orthogonal one after the other."""
    basis = Directions([], [], [])
    for N in gradients:
        q = basis.without(N)
        left = dot(q, q)
        new = left > DEPENDENT**2 * dot(N, N)
        basis.products.append([dot(b, N) for b in basis.q])
        basis.q.append(q)
        basis.inverse.append(np.where(new, 1.0 / np.where(new, left, 1.0), 0.0))
    return basis
