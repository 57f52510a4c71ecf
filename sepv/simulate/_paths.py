"""A path and an ensemble. NumPy batches; a failed path keeps its status and stops, the others go on."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from sepv._arguments import floats, is_number
from sepv.errors import StepFailure, TruncationWarning, UsageError
from sepv.problem import Array, Problem
from sepv.schemes import PointLaw, Scheme, ask, load_problem, load_scheme, weakly
from sepv.schemes._further_increments import answer, further_rows
from sepv.schemes._scheme import REFUSALS, Step
from sepv.simulate import _areas as areas
from sepv.simulate import _truncation as bounded
from sepv.simulate import _wiener as wiener
from sepv.simulate._results.labelled import to_xarray
from sepv.simulate._results.reductions import Summary
from sepv.solve import Status

# Paths computed together: enough to hide NumPy's cost a call, few enough that increments stay small.
CHUNK = 1024


@dataclass(frozen=True)
class Trajectory:
    """One path.

    Attributes
    ----------
    t : (N + 1,)
    y : (d, N + 1)
    dW : (N, m)
        The increments that were used, with areas or halves in further columns for a scheme that asks for them.
    gradient_evaluations, divisions, continuations : int
        Evaluations of ∇H; steps that were divided, and followed from Δ = 0, because they had no solution otherwise.
    """

    t: Array
    y: Array
    dW: Array
    gradient_evaluations: int
    divisions: int = 0
    continuations: int = 0


@dataclass(frozen=True)
class Ensemble:
    """The ends of many paths.

    Attributes
    ----------
    y : (d, M)
        States at T; of a failed path the last state reached.
    W : (m, M)
        W(T), untruncated: θ(T) = T + Σ c_j W_j(T) gives the exact solution.
    status : (M,)
        `sepv.solve.Status` of each path: 0 where every step converged.
    failed_step : (M,)
        The number of the step that failed, −1 where none did.
    energy_defect, casimir_defect : (M,)
        Largest |H(y_n) − H(y_0)| over the path, and the same over all quadratic and linear Casimirs,
        evaluated in binary64.
    gradient_evaluations, structure_evaluations, iterations : int
        Work over all paths and steps; zero for schemes that do not report it.
    times, states : (K,), (K, d, M)
        The states at the chosen times, of a failed path the last one reached.
    engine : "numpy" or "compiled"
    reason : why it was not the compiled engine.
    divisions : int
        Steps and parts of steps that were divided, over all paths (`sepv.schemes.divided`).
    continuations : int
        Shares of steps solved on the way to failed ones (`sepv.schemes.continued`).
    repeated : int
        Chunks that had to be computed again because a worker raised or died.
    reduced : dict of `sepv.simulate._results.reductions.Summary`
        With `reduce=`, by name; the arrays above then have no paths.
    about : dict
        Problem, scheme, step size, seed, version: what `to_xarray` writes into its attributes.
    """

    y: Array
    W: Array
    status: np.ndarray
    failed_step: np.ndarray
    energy_defect: Array
    casimir_defect: Array
    gradient_evaluations: int
    structure_evaluations: int
    iterations: int
    times: Array = field(default_factory=lambda: np.empty(0))
    states: Array = field(default_factory=lambda: np.empty((0, 0, 0)))
    engine: str = "numpy"
    reason: str = ""
    repeated: int = 0
    divisions: int = 0
    continuations: int = 0
    reduced: Mapping[str, Summary] = field(default_factory=dict)
    about: Mapping[str, Any] = field(default_factory=dict, repr=False)

    def to_xarray(self) -> Any:
        """An `xarray.Dataset` with dimensions path, time, component and noise (extra `store`).

        What is on disk (`store=`) stays there, and is read where it is looked at.
        """
        return to_xarray(self)


def integrate(
    scheme: str | Scheme | Step,
    problem: str | Problem,
    *,
    h: float,
    T: float | None = None,
    steps: int | None = None,
    y0: ArrayLike | None = None,
    seed: int = 0,
    dW: ArrayLike | None = None,
    truncation: int | Literal["own"] | None = "own",
    increments: str | PointLaw | None = None,
) -> Trajectory:
    """One path from y0 (default: the problem's initial state).

    Parameters
    ----------
    scheme : str, Scheme or function
        As for `sepv.verify`: a built-in name, ``module:attribute``, a `Scheme`, or ``step(problem, y, h, dW)``.
    problem : str or Problem
        A built-in name, ``module:attribute``, a ``.json`` file of polynomial data, or a `Problem`.
    h : float > 0
    T, steps : one of them; T must be a multiple of h.
    y0 : (d,), optional
    seed : int
        Of the increments: path 0 of `ensemble` with the same seed.
    dW : (N, m), optional
        Untruncated increments to use; else those of `wiener.increments(seed, …)`, path 0.
    truncation : int, "own" or None
        k of Remark 2.1; by default the scheme's own. None for untruncated.
    increments : "normal", "two-point", "three-point" or PointLaw, optional
        By default the scheme's own. Each is taken at the rank of the increment drawn or given
        (`sepv.simulate._truncation.seen`).

    Returns
    -------
    Trajectory
        t (N+1,), y (d, N+1), the increments used dW (N, m), and the work.

    Raises
    ------
    StepFailure
        At the first step whose implicit equation was not solved.
    SchemeFault
        For an answer of the scheme that is no state: wrong shape or type, not finite.
    UsageError, TargetError
        For arguments that make no path, for what is no scheme or no problem.

    Examples
    --------
    >>> import sepv
    >>> path = sepv.integrate("energy-preserving", "rigid-body", h=0.01, T=1.0)
    >>> path.y.shape
    (3, 101)
    """
    problem = load_problem(problem)
    scheme, k = prepared(load_scheme(scheme, problems=(problem,)), truncation, increments)
    count = step_count(h, T, steps)
    start = initial_state(problem, y0)
    m = problem.noises
    raw = _drawn(scheme, problem, seed, h * count, count) if dW is None else floats("dW", dW)
    if raw.shape != (count, m + further_rows(scheme.asks, m)):
        raise UsageError(
            expected=f"dW of shape {(count, m + further_rows(scheme.asks, m))}",
            received=f"shape {raw.shape}",
            remedy=f"one row a step{', with the ' + scheme.asks + ' that the scheme asks for' if scheme.asks else ''}",
        )
    used = np.concatenate([bounded.seen(raw[:, :m], h, k, scheme.increments), raw[:, m:]], axis=1)
    y = np.empty((problem.dimension, count + 1))
    y[:, 0] = start
    evaluations = divisions = continuations = 0
    for n in range(count):
        if scheme.solve is not None:
            solution = scheme.solve(problem, y[:, n], h, used[n])
            evaluations += int(solution.gradient_evaluations[0])
            divisions += 0 if solution.divisions is None else int(solution.divisions[0])
            continuations += 0 if solution.continuations is None else int(solution.continuations[0])
            if solution.status[0] != Status.CONVERGED:
                raise StepFailure(
                    problem=problem.name,
                    y=y[:, n],
                    delta=float(h + problem.c @ used[n]),
                    residual=float(solution.residual[0]),
                    status=Status(int(solution.status[0])).text,
                    iterations=int(solution.iterations[0]),
                )
            y[:, n + 1] = solution.value[:, 0]
        else:
            y[:, n + 1] = ask(scheme, problem, y[:, n], h, used[n])
    return Trajectory(
        np.arange(count + 1, dtype=np.float64) * h, y, used, evaluations, divisions, continuations
    )


def _drawn(scheme: Scheme, problem: Problem, seed: int, T: float, steps: int) -> Array:
    """Path 0 of this seed (N, m), with what the scheme asks for in further columns."""
    if scheme.asks:
        fine = areas.drawn(seed, T=T, steps=areas.MORE * steps, noises=problem.noises, paths=1)
        return fine.rows(steps, scheme.asks)[:, :, 0]
    return wiener.increments(seed, T=T, steps=steps, noises=problem.noises, refine=None)[:, :, 0]


def prepared(
    scheme: Scheme, truncation: int | Literal["own"] | None, increments: str | PointLaw | None
) -> tuple[Scheme, int | None]:
    """The scheme with the increments asked for, its own for None, and k: of increments of a few points None.

    Raises
    ------
    UsageError
        For a truncation of increments that are bounded as they are.
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
    return scheme, chosen_truncation(scheme, truncation)


def chosen_truncation(scheme: Scheme, truncation: int | Literal["own"] | None) -> int | None:
    """k of Remark 2.1: the scheme's own for "own"; a warning where it costs the scheme its order.

    What Remark 2.1 cuts off has a mean square O(h^{k+1}) a step, and order p has room for h^{2p+1}: k ≥ 2p.
    """
    k = scheme.truncation if truncation == "own" else truncation
    order = scheme.mean_square_order
    # k < 1 is no truncation at all, and refused by `truncate`.
    if k is not None and order is not None and 1 <= k < 2 * order:
        warnings.warn(
            f"Truncation k = {k} costs {scheme.name} its mean-square order {order:g}: the error stalls at order "
            f"{k / 2:g}. Remedy: k ≥ {2 * order:g} (its own is {scheme.truncation}), or None for no truncation.",
            TruncationWarning,
            stacklevel=4,
        )
    return k


def run_chunk(
    scheme: Scheme, problem: Problem, y0: Array, h: float, raw: Array, k: int | None, *, track: bool = True
) -> Ensemble:
    """Paths from y0 (d,) over the Wiener increments raw (N, m, M), truncated with k or as the scheme wants them.

    Further rows are what the scheme asks for beside them (`sepv.schemes._further_increments`).

    Without `track` the invariants are not followed, and their defects are zero.
    """
    batch = Batch(scheme, problem, y0, raw.shape[2], track=track)
    m = problem.noises
    for increment, further in zip(bounded.seen(raw[:, :m], h, k, scheme.increments), raw[:, m:], strict=True):
        batch.step(h, np.concatenate([increment, further]) if len(further) else increment)
    return batch.result(raw[:, :m].sum(axis=0))


class Batch:
    """Paths in NumPy, one step of all at a time; one whose step failed stays where it was."""

    def __init__(
        self,
        scheme: Scheme,
        problem: Problem,
        y0: Array,
        paths: int,
        *,
        track: bool = True,
        compensated: bool = False,
    ) -> None:
        if compensated and scheme.solve is None:
            raise UsageError(
                expected="an implicit scheme for compensated summation in NumPy",
                received=f"the scheme {scheme.name!r}, whose step returns a state and not its increment",
                remedy="engine='compiled', or compensated=False",
            )
        self.scheme, self.problem, self.track = scheme, problem, track
        self.y = np.repeat(y0[:, None], paths, axis=1)
        self.lost = np.zeros_like(self.y) if compensated else None
        self.status, self.failed = np.zeros(paths, dtype=np.int64), np.full(paths, -1)
        self.invariants = _invariants(problem, self.y)
        self.worst = np.zeros((2, paths))
        self.work = np.zeros(5, dtype=np.int64)
        self.alive = np.arange(paths)
        self.done = 0

    def step(self, h: float, dW: Array) -> None:
        """One step with the increments dW (m, M), truncated by the caller."""
        alive = self.alive
        self.done += 1
        if not alive.size:
            return
        before = self.y[:, alive]
        value, code, cost, change = _advance(self.scheme, self.problem, before, h, dW[:, alive])
        self.work += cost
        ok = code == Status.CONVERGED
        self.status[alive[~ok]], self.failed[alive[~ok]] = code[~ok], self.done - 1
        if self.lost is not None and change is not None:
            # Kahan: what the sum loses is kept and added to the next increment.
            wanted = change + self.lost[:, alive]
            value = before + wanted
            # Knuth's two-sum: a component next to zero is smaller than its increment.
            taken = value - before
            self.lost[:, alive] = (before - (value - taken)) + (wanted - taken)
        self.alive = alive = alive[ok]
        self.y[:, alive] = value[:, ok]
        if self.track and alive.size:
            drift = np.abs(_invariants(self.problem, self.y[:, alive]) - self.invariants[:, alive])
            self.worst[0, alive] = np.maximum(self.worst[0, alive], drift[0])
            self.worst[1, alive] = np.maximum(self.worst[1, alive], drift[1:].max(axis=0, initial=0.0))

    def result(self, W: Array, states: Array | None = None) -> Ensemble:
        """The ends so far."""
        gradients, structures, iterations, divisions, continuations = (int(v) for v in self.work)
        ends = Ensemble(
            self.y, W, self.status, self.failed, self.worst[0], self.worst[1], gradients, structures, iterations,
            divisions=divisions, continuations=continuations,
        )  # fmt: skip
        return ends if states is None else replace(ends, states=states)


def advance(
    scheme: Scheme, problem: Problem, y: Array, h: float, dW: Array
) -> tuple[Array, np.ndarray, np.ndarray]:
    """One step of a batch: value, status of each lane, (gradients, structures, iterations)."""
    value, code, cost, _ = _advance(scheme, problem, y, h, dW)
    return value, code, cost[:3]


def _advance(
    scheme: Scheme, problem: Problem, y: Array, h: float, dW: Array
) -> tuple[Array, np.ndarray, np.ndarray, Array | None]:
    """The same with divisions and continuations among the counts, and y1 − y0 where the scheme gives it."""
    if scheme.solve is not None:
        solution = scheme.solve(problem, y, h, dW)
        none = np.zeros(1, dtype=np.int64)
        cost = (
            solution.gradient_evaluations, solution.structure_evaluations, solution.iterations,
            none if solution.divisions is None else solution.divisions,
            none if solution.continuations is None else solution.continuations,
        )  # fmt: skip
        return solution.value, solution.status, np.array([int(c.sum()) for c in cost]), solution.change
    value, code = _batch_step(scheme, problem, y, h, dW)
    outside = ~np.all(np.isfinite(value), axis=0)
    code[outside & (code == 0)] = Status.OVERFLOW
    if problem.domain is not None:
        with np.errstate(invalid="ignore"):
            code[~np.asarray(problem.domain(value), dtype=bool) & (code == 0)] = Status.LEFT_DOMAIN
    return value, code, np.zeros(5, dtype=np.int64), None


def _batch_step(scheme: Scheme, problem: Problem, y: Array, h: float, dW: Array) -> tuple[Array, np.ndarray]:
    """The scheme's step for a batch, lane by lane where it takes no batches or a lane of it fails."""
    code = np.zeros(y.shape[1], dtype=np.int64)
    with np.errstate(all="ignore"):
        if scheme.batched:
            try:
                return answer(scheme, problem, y, h, dW), code
            except REFUSALS:
                pass
        value = np.full_like(y, np.nan)
        for lane in range(y.shape[1]):
            try:
                value[:, lane] = answer(scheme, problem, y[:, lane].copy(), h, dW[:, lane].copy())
            except REFUSALS:
                code[lane] = Status.NO_CONVERGENCE
    return value, code


def _invariants(problem: Problem, y: Array) -> Array:
    rows = [problem.hamiltonian(y)]
    for A in problem.casimirs:
        rows.append(sum(A[i, j] * (y[i] * y[j]) for i, j in zip(*np.nonzero(A), strict=True)))
    for b in problem.linear_casimirs:
        rows.append(sum(b[i] * y[i] for i in range(len(b))))
    return np.stack(rows)


def step_count(h: float, T: float | None, steps: int | None) -> int:
    """N with N h = T.

    Raises
    ------
    UsageError
        For h ≤ 0 or not finite, both or neither of T and steps, or a T that h does not divide.
    """
    if not is_number(h) or h <= 0:
        raise UsageError(
            expected="h, a finite step size > 0",
            received=f"h = {h!r}",
            remedy="backward steps are for `step` alone",
        )
    if (T is None) == (steps is None):
        raise UsageError(
            expected="one of T and steps",
            received=f"T = {T!r}, steps = {steps!r}",
            remedy="give exactly one of them",
        )
    if steps is not None:
        if not isinstance(steps, (int, np.integer)) or steps < 1:
            raise UsageError(
                expected="steps, an integer ≥ 1", received=repr(steps), remedy="take at least one step"
            )
        return int(steps)
    assert T is not None
    if not is_number(T):
        raise UsageError(expected="T, a finite number", received=repr(T), remedy="choose T = N h")
    count = round(T / h)
    # h·N = T up to the rounding of decimal step sizes such as 0.01.
    if count < 1 or abs(count * h - T) > 1e-12 * T:
        raise UsageError(
            expected="T, a positive multiple of h",
            received=f"T = {T!r}, h = {h!r}, T/h = {T / h!r}",
            remedy="choose h = T/N",
        )
    return count


def initial_state(problem: Problem, y0: ArrayLike | None) -> Array:
    """y0, or the problem's initial state, checked."""
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
    return y
