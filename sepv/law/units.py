"""A problem's own units of time and length, in which laws choose steps and states of a user's
problem.

With t = τs, the equation dy = B∇H(dt + Σ c_j∘dW_j) is dy = τB∇H(ds + Σ c_jτ^{−½}∘dW_j); with
y = λx, states have the unit λ. Both changes of units change only the numbers of a problem.
The units (τ, λ) are computed from the problem. They are used for the step h, the length T of
a path, the ln h in the truncation A_h of Remark 2.1, and every bound that is compared with a
state. So no verdict depends on whether time is in seconds or in years.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sepv.law.cases.from_problem import sizes_at
from sepv.problem import Array, Problem, damping_of, sample_states


@dataclass(frozen=True)
class Units:
    """A unit of time and a unit of length."""

    time: float = 1.0
    length: float = 1.0


def units_of(problem: Problem) -> Units:
    """Choose a unit of time τ from the slope of a problem's fields and its noise,
    and a unit of length λ from y0.

    Let L be the slope of the fields at y0. Then τ = min(2/L, 2(LΣc_j)⁻²). For h = τ/8, the longest
    step that laws make, Lh is ¼ at most, and the random time has a standard deviation of 1/(2L) at
    most. Paths have length τ/4 and steps of τ/16 at most, so that the errors of a correct scheme
    fall with its order.

    If L = 0 at y0, L is taken at nearby states; if all fields f are constant, L is |f|/λ. If
    y0 = 0, λ is |f|/L. If all fields vanish, L is 1, and λ too if y0 = 0: no law then depends
    on a unit.
    """
    start = np.array(problem.initial, dtype=np.float64)
    length = float(np.max(np.abs(start), initial=0.0))
    field, slope = rates_at(problem, start)
    about = iter(sample_states(problem, length or 1.0))
    while not 0 < slope < np.inf and (y := next(about, None)) is not None:
        slope = rates_at(problem, y)[1]
    if not 0 < slope < np.inf:
        slope = field / (length or 1.0) if 0 < field < np.inf else 1.0
    noise = slope * float(problem.c.sum())
    time = min(2 / slope, 2 * noise**-2) if noise else 2 / slope
    return Units(time, length or (field / slope if 0 < field < np.inf else 1.0))


def rates_at(problem: Problem, y: Array) -> tuple[float, float]:
    """Bounds at y of the fields, and of their slopes: row sums of |B′||∇H| + |B||H″|,
    plus |γ| for damping −γy dt.
    """
    B, g, dB, H = sizes_at(problem, y)
    gamma = abs(damping_of(problem))
    slope = float(np.max(np.sum(np.einsum("ijk,j->ik", dB, g) + B @ H, axis=1)))
    return float(np.max(B @ g + gamma * np.abs(y))), slope + gamma
