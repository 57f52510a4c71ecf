"""Vectors along which a projection moves a state to correct its invariants,
for arrays and for symbols.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from sepv.core.arrays import matvec
from sepv.problem._products import dot

# A gradient gives no new direction if its part orthogonal to earlier gradients is below this
# fraction of its length.
INDEPENDENCE_TOLERANCE = 2.0**-40


class Directions(NamedTuple):
    """Orthogonal vectors q_k (d, ...), one for the gradient N_k of each invariant,
    with N_jᵀq_k = 0 for j < k.

    `inverse` lists the numbers 1/(N_kᵀq_k), each (...); they are 0 where a move along q_k does not
    change invariant k. `products` lists, for each k, the numbers q_jᵀN_k with j < k.
    """

    q: list[Any]
    inverse: list[Any]
    products: list[list[Any]]

    def without(self, w: Any) -> Any:
        """The part of w (d, ...) that is orthogonal to all gradients.

        The parts along the q_k are subtracted twice: after the first time rounding errors of w
        remain in them.
        """
        for _ in range(2):
            for b, inverse in zip(self.q, self.inverse, strict=True):
                w = w - b * (dot(b, w) * inverse)
        return w

    def correction(self, r: Sequence[Any]) -> Any:
        """The combination u (d, ...) of the q_k with N_kᵀu = r_k for all k;
        a q_k whose `inverse` is 0 is left out.
        """
        weights: list[Any] = []
        for value, products, inverse in zip(r, self.products, self.inverse, strict=True):
            for w, product in zip(weights, products, strict=True):
                value = value - product * w  # noqa: PLW2901
            weights.append(value * inverse)
        return sum(q * w for q, w in zip(self.q, weights, strict=True))

    def of(self, lanes: Any) -> Directions:
        """The directions at some states of the batch; `lanes` is a list of the indices of these
        states, or a mask.
        """
        parts = self.q, self.inverse, *self.products
        q, inverse, *products = ([v[..., lanes] for v in part] for part in parts)
        return Directions(q, inverse, products)


def directions(gradients: Sequence[Any]) -> Directions:
    """The `Directions` of gradients (d, ...): each gradient is made orthogonal to the gradients
    before it.
    """
    basis = Directions([], [], [])
    for N in gradients:
        _append(basis, basis.without(N), N, dot(N, N))
    return basis


def projections(B: Any, gradient: Any, casimirs: Sequence[Any]) -> Directions:
    """The `Directions` along which a projection corrects the Casimirs,
    whose gradients are `casimirs`, and then H.

    A Casimir is corrected along its gradient, and H along v = BᵀB∇H, which has ∇Hᵀv = |B∇H|² and is
    orthogonal to the gradients of Casimirs. If Ay = 0 for a Casimir yᵀAy, differentiating BAy = 0
    gives BA = 0: moves along v keep yᵀAy.
    """
    basis, size = directions(casimirs), dot(B, B).sum(axis=0) * dot(gradient, gradient)
    _append(basis, basis.without(-matvec(B, matvec(B, gradient))), gradient, size)
    return basis


def _append(basis: Directions, q: Any, N: Any, size: Any) -> None:
    """Append the direction q for the gradient N; its `inverse` is 1/(Nᵀq),
    or 0 if Nᵀq is a rounding of `size`.
    """
    left = dot(q, N)
    new = left > INDEPENDENCE_TOLERANCE**2 * size
    basis.products.append([dot(b, N) for b in basis.q])
    basis.q.append(q)
    basis.inverse.append(np.where(new, 1.0 / np.where(new, left, 1.0), 0.0))
