"""Batches in blocks of one size: compiled code and the order of its operations then do not depend on their number."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from sepv.problem import Array

# Lanes computed together; the last block is filled up.
LANES = 64


def in_blocks(step: Callable[[Array, Array], Any], y: Array, dW: Array, lanes: int) -> Array:
    """step(y (d, lanes), dW (m, lanes)) over any number of lanes, or on one state (d,) with dW (m,)."""
    states = y.reshape(y.shape[0], -1)
    count = states.shape[1]
    increments = dW.reshape(dW.shape[0], count)
    filled = -(-count // lanes) * lanes
    lane = np.minimum(np.arange(filled), count - 1)
    parts = []
    for first in range(0, filled, lanes):
        block = lane[first : first + lanes]
        parts.append(np.asarray(step(states[:, block], increments[:, block])))
    return np.concatenate(parts, axis=1)[:, :count].reshape(y.shape)
