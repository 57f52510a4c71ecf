"""Drift of the invariants of a table of states, and whether each row is a step of a scheme from the
row before.

**Growth.** The errors e(t) = I(y(t)) − I(y(0)) of a single path are cut into 16 to 64 blocks. In
each block the errors since its start are a sample of how the error grows over the times T_b/2^k,
T_b the length of a block. The exponent of their rms has a confidence interval by a jackknife over
the blocks (`sepv.properties.growth_exponent`). So growth is judged up to the time T_b. What grows
faster than linearly is a line within a block, and is called a trend. So is an oscillation with a
period longer than T_b/16, unless its changes over sixteenths of the table have no mean that differs
from 0: then it is inconclusive.

**Steps.** Row n + 1 is a step of a scheme if |Φ(y_n) − y_{n+1}| is at most what half a unit in the
last digit of y_n, y_{n+1}, h and dW can change, and what rounding can. The effect of the digits of
y_n is measured by steps from y_n ± half a unit.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from sepv.errors import SepvError, UsageError
from sepv.problem import Array, Problem
from sepv.properties import GROWTH_LEVEL
from sepv.properties import energy_rounding_walk as rounding_walk
from sepv.properties import growth_exponent as exponent
from sepv.properties import growth_kind as kind_of
from sepv.record import EPS
from sepv.schemes import Scheme, ask
from sepv.statistics import students_t
from sepv.studies._energy_growth import SLOPE_DOUBLINGS
from sepv.studies._table_of_states import Rows, read_rows

__all__ = ["TREND", "Drift", "Mismatch", "Rows", "drifts", "first_mismatch", "read_rows"]

# Blocks: the more, the narrower the interval, and the shorter the time over which growth is judged.
# A random walk needs about 64 for an interval of ± 0.2, which tells it from bounded and linear
# errors.
FEWEST_BLOCKS, BLOCKS = 16, 64
TREND = "a trend, linear or faster"
# Rounding of a step relative to |y|: the residual of our solvers is at most 256 eps
# (`RESIDUAL_ROUNDING` of the stop rule).
STEP_ROUNDING = 256 * EPS
# Digits are allowed a quarter more than their first-order effect, for the curvature of the step
# over half a unit. This factor is a heuristic: for three digits and a step of the size of y, the
# second-order effect is below a tenth.
CURVATURE = 1.25


@dataclass(frozen=True)
class Drift:
    """The drift of one invariant along a table.

    errors : (N + 1,), I(y_n) − I(y_0); digits : (N + 1,), what the digits of the table can change
        in them
    exponent : value and half-width of the interval of p in t^p; rounding : what rounding can change
        over all steps
    """

    name: str
    errors: Array
    digits: Array
    exponent: tuple[float, float]
    rounding: float

    @property
    def largest(self) -> float:
        """The largest |I(y_n) − I(y_0)|."""
        return float(np.max(np.abs(self.errors)))

    @property
    def kind(self) -> str:
        """The explanation of the errors, "digits" or "rounding"; else a kind of growth,
        or "inconclusive".
        """
        if np.all(np.abs(self.errors) <= self.rounding):
            return "rounding"
        if np.all(np.abs(self.errors) <= self.digits + self.rounding):
            return "digits"
        kind: str = kind_of(*self.exponent)
        trend = TREND if self._goes_one_way else "inconclusive"
        return {"open": "inconclusive", "linear": trend, "faster than linear": trend}.get(kind, kind)

    @property
    def _goes_one_way(self) -> bool:
        """True if the changes over sixteenths of the table have a mean that is not 0,
        at the level of the exponent.

        Within a block, an oscillation with a longer period is a line. Over the table its changes
        have both signs.
        """
        ends = np.linspace(0, self.errors.size - 1, FEWEST_BLOCKS + 1).astype(int)
        changes = np.diff(self.errors[ends])
        error = float(np.std(changes, ddof=1)) / FEWEST_BLOCKS**0.5
        return bool(abs(np.mean(changes)) > students_t(GROWTH_LEVEL / 2, FEWEST_BLOCKS - 1) * error)

    def sentence(self) -> str:
        """The verdict on one line."""
        value, half = self.exponent
        return {
            "rounding": f"rounding: at most {self.rounding:.1g} over all steps",
            "digits": f"no drift is seen: the digits of the table allow {float(self.digits.max()):.1g}",
            "inconclusive": f"inconclusive: t^({value:.2f} ± {half:.2f}) within a block"
            if np.isfinite(half)
            else "inconclusive: too few rows",
        }.get(self.kind, f"{self.kind}: t^({value:.2f} ± {half:.2f})")


@dataclass(frozen=True)
class Mismatch:
    """A row that is not a step of the scheme: its number (from 1), component (from 1), both values,
    and the bound.
    """

    row: int
    component: int
    found: float
    expected: float
    bound: float


def drifts(rows: Rows, problem: Problem) -> list[Drift]:
    """The drift of H and of each Casimir, evaluated in extended precision where the machine has
    it.
    """
    y: Any = rows.y.astype(np.longdouble)
    with np.errstate(all="ignore"):
        named = [("H", problem.hamiltonian(y), problem.gradient(rows.y))]
    defined = np.isfinite(named[0][1]) & np.isfinite(named[0][2]).all(axis=0)
    if not defined.all():
        row = int(np.argmin(defined))
        raise UsageError(
            expected=f"states at which H of {problem.name} is defined",
            received=f"y = {rows.y[:, row].tolist()} in row {row + 1}",
            remedy="correct -p, or the order of the columns: t first, components as in the problem",
        )
    for n, A in enumerate(problem.casimirs, 1):
        named.append((f"C{n} = yᵀAy", np.einsum("in,ij,jn->n", y, A, y), 2 * A @ rows.y))
    for n, b in enumerate(problem.linear_casimirs, 1):
        named.append((f"L{n} = bᵀy", b @ y, np.repeat(b[:, None], y.shape[1], axis=1)))
    found = []
    for name, values, slope in named:
        digits = np.sum(np.abs(slope) * rows.half, axis=0)
        # Half a unit of the first row and of row n; the rounding of a walk is that of H, scaled to
        # this invariant.
        scale = float(np.max(np.sum(np.abs(slope * rows.y), axis=0)) + np.max(np.abs(values)))
        walk = (
            rounding_walk(problem, rows.y, rows.steps) if name == "H" else 8 * EPS * rows.steps**0.5 * scale
        )
        errors = np.asarray(values - values[0], dtype=np.float64)
        found.append(Drift(name, errors, digits + digits[0], _exponent(rows.t, errors), walk))
    return found


def _exponent(t: Array, errors: Array) -> tuple[float, float]:
    steps, shortest = errors.size - 1, 2**SLOPE_DOUBLINGS
    blocks = min(BLOCKS, max(FEWEST_BLOCKS, steps // (8 * shortest)))
    length = steps // blocks // shortest * shortest
    if not length:
        return 0.0, np.inf
    lags = length // 2 ** np.arange(SLOPE_DOUBLINGS, -1, -1)
    starts = np.arange(blocks) * length
    since = errors[starts + lags[:, None]] - errors[starts]
    if not np.all(np.any(since != 0, axis=1)):
        return 0.0, np.inf
    value, half = exponent(t[lags] - t[0], since)
    return float(value), float(half)


def first_mismatch(rows: Rows, problem: Problem, scheme: Scheme) -> Mismatch | None:
    """The first row that is not a step of the scheme from the row before, or None.

    Raises UsageError for a problem with noise if the table has no increments, and for a scheme with
    a memory.
    """
    if problem.noises and rows.dW is None:
        raise UsageError(
            expected=f"columns dW_1 … dW_{problem.noises}, the increments of the steps that end in each row",
            received="a table without them",
            remedy="add them, or leave --scheme out; a problem without noise needs none: --no-noise",
        )
    if not callable(scheme.step) or hasattr(scheme.step, "init") or hasattr(scheme.step, "states"):
        raise UsageError(
            expected="a scheme whose step depends on y alone",
            received=f"{scheme.name}, which carries a state or makes a whole path",
            remedy="the table has no carried states; leave --scheme out",
        )
    h, h_half = _steps(rows)
    for n in range(rows.steps):
        dW = np.zeros(0) if rows.dW is None else rows.dW[n]
        y, target = rows.y[:, n], rows.y[:, n + 1]
        made = ask(scheme, problem, y, h[n], dW)
        allowed = rows.half[:, n + 1] + STEP_ROUNDING * np.maximum(np.abs(y).max(), np.abs(made).max())
        for other in _nudged(rows, n, float(h[n]), h_half, dW):
            try:
                allowed = allowed + CURVATURE * np.abs(ask(scheme, problem, *other) - made)
            except SepvError:
                allowed = np.full_like(allowed, np.inf)  # half a unit decides whether the step exists
        off = np.abs(made - target)
        if not np.all(off <= allowed):
            k = int(np.argmax(off / allowed))
            return Mismatch(n + 2, k + 1, float(target[k]), float(made[k]), float(allowed[k]))
    return None


def _steps(rows: Rows) -> tuple[Array, float]:
    """The step sizes (N,), all equal if the digits of the times allow it,
    and by how much they may be wrong.
    """
    gaps = np.diff(rows.t)
    unit = rows.t_half + EPS * float(np.abs(rows.t).max())
    mean = float(rows.t[-1] - rows.t[0]) / rows.steps
    if np.all(np.abs(gaps - mean) <= 2 * unit):
        return np.full(rows.steps, mean), 2 * unit / rows.steps
    return gaps, 2 * unit


def _nudged(rows: Rows, n: int, h: float, h_half: float, dW: Array) -> list[tuple[Array, float, Array]]:
    """The arguments of step n with one number moved by half a unit of its last digit,
    for each number that has one.
    """
    y = rows.y[:, n]
    moved = []
    for k in np.flatnonzero(rows.half[:, n]):
        other = y.copy()
        other[k] += rows.half[k, n]
        moved.append((other, h, dW))
    if h_half:
        moved.append((y, h + h_half, dW))
    halves = np.zeros(0) if rows.dW_half is None else rows.dW_half[n]
    for j in np.flatnonzero(halves):
        other = dW.copy()
        other[j] += halves[j]
        moved.append((y, h, other))
    return moved
