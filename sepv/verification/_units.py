"""A problem's own units of time and length, in which laws choose steps and states of a user's problem.

With t = τs, the equation dy = B∇H(dt + Σ c_j∘dW_j) is dy = τB∇H(ds + Σ c_jτ^{−½}∘dW_j), and y = λx multiplies states by
λ. Both change numbers and nothing else. So h, T, the ln h in A_h of Remark 2.1, and every bound that is compared with a
state are taken in units (τ, λ) found from the problem itself, which change with it: no verdict depends on whether time
is in seconds or in years.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sepv.problem import Array, Problem, damping_of, sample_states
from sepv.schemes import Scheme
from sepv.verification._cases.from_problem import sizes_at


@dataclass(frozen=True)
class Units:
    """A unit of time and a unit of length."""

    time: float = 1.0
    length: float = 1.0


def units_for(scheme: Scheme, problem: Problem) -> Units:
    """The units of a user's problem; 1 for the suite's own problems, whose steps are stated as they are."""
    return units_of(problem) if scheme.problems else Units()


def units_of(problem: Problem) -> Units:
    """Choose the time that the flow's slope and the noise allow, and the size of the initial state.

    With L the slope of the fields at y0, τ = min(2/L, 2(LΣc_j)⁻²). Over steps of τ/8, the longest that laws make, the
    drift turns by ¼ at most, and the random time has a standard deviation of 1/(2L) at most. Paths are of length τ/4
    and their coarsest steps τ/16, so that errors of right schemes fall as their order says.

    If L = 0 at y0, nearby states are used; if all fields are constant L is |f|/λ. From the origin λ is |f|/L. If
    nothing moves both are 1: no law can see a unit there.
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
    """The largest component of a field at y, and a bound of its slope there, |B′||∇H| + |B||H″| + γ by row sums."""
    B, g, dB, H = sizes_at(problem, y)
    gamma = abs(damping_of(problem))
    slope = float(np.max(np.sum(np.einsum("ijk,j->ik", dB, g) + B @ H, axis=1)))
    return float(np.max(B @ g + gamma * np.abs(y))), slope + gamma
