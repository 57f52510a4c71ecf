"""Checked arguments of a run of paths: scheme, problem, steps, initial state,
the increments and their truncation.
"""

from __future__ import annotations

import warnings
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from sepv._arguments import floats, is_number, require_whole
from sepv.errors import TruncationWarning, UsageError
from sepv.problem import Array, Problem
from sepv.schemes import PointLaw, Scheme, Step, ask_once, load_problem, load_scheme, weakly
from sepv.simulate import _truncation as bounded
from sepv.simulate import _wiener as wiener

# The largest number of steps N; beyond it, N and N + 1 are the same binary64 number.
MAX_STEPS = 2**53


class RunArguments(NamedTuple):
    """Checked arguments shared by `integrate`, `ensemble` and `long_path`;
    k is the truncation's k (Remark 2.1).
    """

    scheme: Scheme
    problem: Problem
    start: Array
    steps: int
    k: int | None


def checked(
    scheme: str | Scheme | Step, problem: str | Problem, h: float, T: float | None, steps: int | None,
    y0: ArrayLike | None, truncation: int | Literal["own"] | None, increments: str | PointLaw | None,
) -> RunArguments:  # fmt: skip
    """Load scheme and problem and check the arguments of a run;
    errors are listed in `sepv.integrate`.
    """
    problem = load_problem(problem)
    own, k = prepared(load_scheme(scheme, problems=(problem,)), truncation, increments)
    return RunArguments(own, problem, initial_state(problem, y0), step_count(h, T, steps), k)


def require_drawable(run: RunArguments, h: float, seed: int, paths: range, refine: int | None) -> None:
    """Raise an error if increments for the scheme cannot be drawn,
    or if a step of the scheme returns no state.
    """
    if run.scheme.asks:
        raise UsageError(
            expected="a scheme that sees increments alone: nothing else is drawn for many or long paths",
            received=f"{run.scheme.name}, which asks for {run.scheme.asks}",
            remedy="sepv.integrate for one path, or sepv.simulate.drawn and the scheme's step for many",
        )
    if run.k is not None:
        bounded.truncation_bound(h, run.k)  # refuses h and k that Remark 2.1 does not cover
    wiener.validate(seed, h * run.steps, run.steps, run.problem.noises, paths)
    wiener.grid(run.steps, refine)
    ask_once(run.scheme, run.problem, run.start, float(h))


def prepared(
    scheme: Scheme, truncation: int | Literal["own"] | None, increments: str | PointLaw | None
) -> tuple[Scheme, int | None]:
    """The scheme with the chosen distribution of increments (None: the one that it declares),
    and the truncation's k.

    Increments with few values are bounded: their k is None, another k raises UsageError. Warns if k
    lowers the order.
    """
    if increments is not None:
        scheme = weakly(scheme, increments)
    if isinstance(scheme.increments, PointLaw):
        if truncation not in ("own", None):
            raise UsageError(
                expected="truncation=None, or left out, with increments of a few points",
                received=f"truncation = {truncation!r} with {scheme.increments.name} increments",
                remedy=f"they are bounded already, by {scheme.increments.bound:.4g} √h",
            )
        return scheme, None
    k = scheme.truncation if truncation == "own" else truncation
    if k is not None:
        k = require_whole("truncation k", k, "the paper takes k = 2, and None is no truncation")
    order = scheme.mean_square_order
    # Clipping as in Remark 2.1 has a mean-square error O(h^{k+1}) per step. Mean-square order p
    # allows h^{2p+1}, so k ≥ 2p is needed. `truncation_bound` refuses k < 1.
    if k is not None and order is not None and 1 <= k < 2 * order:
        warnings.warn(
            f"Truncation k = {k} costs {scheme.name} its mean-square order {order:g}: the error stalls at order "
            f"{k / 2:g}. Remedy: k ≥ {2 * order:g} (its own is {scheme.truncation}), or None for no truncation.",
            TruncationWarning,
            stacklevel=4,
        )
    return scheme, k


def step_count(h: float, T: float | None, steps: int | None) -> int:
    """The number N of steps: `steps`, or T/h. Raise UsageError if h,
    T and `steps` do not give such a number.
    """
    if not is_number(h) or h <= 0:
        raise UsageError(
            expected="h, a finite step size > 0",
            received=f"h = {h!r:.80}",
            remedy="a path goes forwards in time; a single step of `Scheme.step` may have h < 0"
            if is_number(h) and h < 0
            else "give a number such as h=0.01",
        )
    if (T is None) == (steps is None):
        raise UsageError(
            expected="one of T and steps",
            received=f"T = {T!r}, steps = {steps!r}",
            remedy="give exactly one of them",
        )
    if steps is not None:
        return require_whole("steps", steps, "give a whole number of steps, such as steps=100")
    assert T is not None
    if not is_number(T) or T <= 0:
        raise UsageError(expected="T, a finite number > 0", received=f"{T!r:.80}", remedy="choose T = N h")
    count = round(min(T / h, MAX_STEPS + 1))
    if count > MAX_STEPS:
        raise UsageError(
            expected=f"at most {MAX_STEPS} steps",
            received=f"T = {T!r}, h = {h!r}",
            remedy="choose a larger h: the rounding of t = Nh alone is beyond h otherwise",
        )
    # h·N = T up to the rounding of decimal step sizes such as 0.01.
    if count < 1 or abs(count * h - T) > 1e-12 * T:
        raise UsageError(
            expected="T, a positive multiple of h",
            received=f"T = {T!r}, h = {h!r}, T/h = {T / h!r}",
            remedy="choose h = T/N",
        )
    return count


def initial_state(problem: Problem, y0: ArrayLike | None) -> Array:
    """The checked initial state: y0 if given, else the problem's initial state."""
    start = problem.initial if y0 is None else y0
    if start is None:
        raise UsageError(
            expected="an initial state",
            received="none",
            remedy="give y0=, or initial= when making the problem",
        )
    y = floats("y0", start).copy()
    if y.shape != (problem.dimension,) or not np.all(np.isfinite(y)):
        raise UsageError(
            expected=f"y0 finite, of shape ({problem.dimension},)",
            received=f"shape {y.shape}: {start!r:.80}",
            remedy="one number for each component",
        )
    with np.errstate(all="ignore"):
        energy = float(problem.hamiltonian(y))
    if not np.isfinite(energy):
        raise UsageError(
            expected="y0 with a finite energy H(y0), from which defects are measured",
            received=f"H(y0) = {energy!r} at y0 = {y.tolist()!r:.200}",
            remedy="another y0, or other units of y or H",
        )
    return y
