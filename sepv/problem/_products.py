"""Products of vectors and of B′ with a direction, summed in a fixed order."""

from __future__ import annotations

import numpy as np

from sepv.core.arrays import Array, matvec


def dot(u: Array, v: Array) -> Array:
    """The product uᵀv of vectors (d, ...), summed in the order of the components,
    for one state as for a batch.

    `np.sum` would add eight or more components of a single state in another order than those of a
    batch.
    """
    product: Array = matvec(u[None], v)[0]
    return product


def turned_along(D: Array, w: Array) -> Array:
    """The derivative of B in the direction w, B′(y)w = Σ_k D[:, :, k] w_k, (d, d, ...),
    for D = ∂B_ij/∂y_k.
    """
    total = D[:, :, 0] * w[0]
    for k in range(1, len(w)):
        total = total + D[:, :, k] * w[k]
    return np.asarray(total)
