"""Many paths in NumPy, advanced together step by step. A path that fails stops with its status;
the others go on.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from sepv._arguments import optional
from sepv.console import Column, Table, facts, html
from sepv.core.newton import Status
from sepv.errors import UsageError
from sepv.problem import Array, Problem, invariants, known_invariants
from sepv.schemes import REFUSAL_ERRORS, PathSolver, Scheme, StatefulStep, carry, joined_lanes, lanes
from sepv.simulate import _truncation as bounded
from sepv.simulate._results.reductions import Summary

# The number of paths computed together: enough to hide the cost of NumPy's calls, and few enough
# for small arrays.
CHUNK = 1024
# The arrays of an `Ensemble` by name, with the names of all their axes but the last, which is the
# path.
AXES: dict[str, tuple[str, ...]] = {
    "y": ("component",),
    "W": ("noise",),
    "status": (),
    "failed_step": (),
    "energy_defect": (),
    "casimir_defect": (),
    "states": ("component", "time"),
}
# A function that sees each step of a batch: the problem, y0 and y1 (d, M), h and dW (m, M).
Watch = Callable[[Problem, Array, Array, float, Array], None]


@dataclass(frozen=True, repr=False)
class Ensemble:
    """The ends of many paths.

    Attributes
    ----------
    y : (d, M)
        States at T; for a failed path, the last state reached.
    W : (m, M)
        The sums W(T) of untruncated increments; the exact solution is the flow at the random time
        T + Σ c_j W_j(T).
    status : (M,)
        `sepv.core.newton.Status` of each path: 0 if every step converged.
    failed_step : (M,)
        The number (from 0) of the step that failed, −1 if none did.
    energy_defect, casimir_defect : (M,)
        The largest |H(y_n) − H(y_0)| over the path, and the largest |C(y_n) − C(y_0)| of any
        quadratic or linear Casimir C, evaluated in binary64.
    gradient_evaluations, structure_evaluations, iterations : int
        Counts of work over all paths and steps; zero for a scheme that does not report them.
    times, states : (K,), (d, K, M)
        The chosen times, and the states at these times, component first:
        `problem.hamiltonian(states)` is (K, M). For a failed path a state is the last one reached.
    engine : the name of the engine that ran.
    reason : why the compiled engine was not used, or why a functional of `reduce` did not run on a
        card.
    divisions : int
        The number of steps and parts of steps that were divided, over all paths
        (`sepv.schemes.divided`).
    continuations : int
        The number of fractions of steps that were solved by continuation
        (`sepv.schemes.continued`).
    repeated : int
        The number of chunks computed again because a worker raised or died.
    reduced : dict of summaries
        The summary of each functional in `reduce=`. With `reduce=` and without `store=`, the arrays
        have no paths.
    about : dict
        Problem, scheme, step size, seed, version.
    problem : Problem, optional
        The problem of the paths, for `energy` and `casimirs`.
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
    problem: Problem | None = field(default=None, repr=False)

    def __repr__(self) -> str:
        """One line: the paths, the problem, the scheme and the times; the arrays are not
        printed.
        """
        (d, M), K = self.y.shape, len(self.times)
        failed = "" if not M else f", {np.count_nonzero(np.asarray(self.status))} failed"
        kept = f", states at {K} times" if K else ""
        names = " of ".join(str(self.about[key]) for key in ("scheme", "problem") if key in self.about)
        reduced = f", reduced: {', '.join(self.reduced)}" if self.reduced else ""
        return (
            f"<Ensemble of {M} paths, d = {d}{failed}{kept}{reduced}; {names or 'no scheme'}, {self.engine}>"
        )

    def energy(self) -> Array:
        """H along the paths in binary64, (K, M) at `times`, or (M,) at T if no times were
        chosen.
        """
        return np.asarray(known_invariants(self.problem, self._kept())[0])

    def casimirs(self) -> Array:
        """The n quadratic and linear Casimirs, in the order of the problem: (n, K, M) at `times`,
        or (n, M) at T.
        """
        return np.asarray(known_invariants(self.problem, self._kept())[1:])

    def _kept(self) -> Array:
        """The states at `times`, (d, K, M), or the ends (d, M) if no times were chosen,
        read from a store if any.
        """
        return np.asarray(self.states[...] if len(self.times) else self.y[...])

    def _require_paths(self) -> None:
        """Raise UsageError for an ensemble that has only summaries of its paths."""
        if self.reduced and not self.y.shape[-1]:
            raise UsageError(
                expected="an ensemble with its paths", received="one that was reduced: its paths are gone",
                remedy="Ensemble.reduced has its summaries; store= keeps the paths",
            )  # fmt: skip

    def _repr_html_(self) -> str:
        """Tables for a notebook: the paths and their defects, and the summaries of `reduce=`."""
        M, status = self.y.shape[1], np.asarray(self.status)
        rows = [(key, str(self.about[key])) for key in ("scheme", "problem") if key in self.about]
        if M:
            rows.append(("paths", f"{M:,}, {np.count_nonzero(status):,} failed"))
            for name, defects in (("H", self.energy_defect), ("a Casimir", self.casimir_defect)):
                rows.append((f"largest change of {name}", f"{np.max(np.asarray(defects)):.3g}"))
        if K := len(self.times):
            rows.append(("states", f"at {K:,} times from t = {self.times[0]:g} to {self.times[-1]:g}"))
        rows.append(("engine", self.engine + (f" ({self.reason})" if self.reason else "")))
        if not self.reduced:
            return html(facts("Ensemble", rows))
        numbers = ("mean", "standard_error", "minimum", "maximum")
        heads = (
            Column("functional"),
            *(Column(n.replace("_", " "), right=True) for n in ("count", *numbers)),
        )
        lines = [
            (name, f"{s.count:,}", *(f"{getattr(s, n):.6g}" for n in numbers))
            for name, s in self.reduced.items()
        ]
        return html(facts("Ensemble", rows)) + html(Table(heads, lines))

    def plot(self) -> Any:
        """Draw the states, and the share of paths by the largest change of H and of a Casimir.

        At chosen times, a component is drawn by its median and the band between its quantiles of 5
        % and 95 %, of at most six components. Without times, the ends of at most 2,000 paths are
        drawn, y2 against y1. Failed paths are left out.

        Returns
        -------
        matplotlib.figure.Figure
            A notebook shows it; `savefig` writes it to a file.

        Raises
        ------
        UsageError
            If matplotlib, the extra ``plots``, is not installed, or if the ensemble has only
            summaries of its paths.
        """
        from sepv.simulate._drawn import ensemble_figure

        self._require_paths()
        return ensemble_figure(self)

    def to_xarray(self) -> Any:
        """Return an `xarray.Dataset` with the dimensions path, time, component and noise,
        and with `about` as `attrs`.

        If times were chosen, it also has `energy` and `casimirs` at these times. Data of an
        ensemble with `store=` stay on disk, and are read when they are indexed; its energies are
        not computed, because that reads all states.

        Raise UsageError if xarray (extra `store`) is not installed, or if the ensemble has only
        summaries of its paths.
        """
        xarray = optional("xarray", "xarray, for to_xarray()", "pip install xarray")
        self._require_paths()
        attrs = {k: v for k, v in self.about.items() if isinstance(v, (str, int, float))}
        if hasattr(self.y, "store_path"):
            # The arrays stay on disk; indexing reads them.
            kept = xarray.open_zarr(
                self.y.store_path.store, consolidated=False, mask_and_scale=False, drop_variables=["work"]
            )
            data: dict[str, Any] = dict(kept.data_vars)
        else:
            data = {name: ((*axes, "path"), getattr(self, name)) for name, axes in AXES.items()}
            if self.problem is not None and len(self.times):
                data["energy"] = (("time", "path"), self.energy())
                if len(casimirs := self.casimirs()):
                    data["casimirs"] = (("casimir", "time", "path"), casimirs)
        attrs["engine"] = self.engine
        if not len(self.times):
            data.pop("states", None)
            return xarray.Dataset(data, attrs=attrs)
        return xarray.Dataset(data, coords={"time": ("time", self.times)}, attrs=attrs)


def run_chunk(
    scheme: Scheme, problem: Problem, y0: Array, h: float, raw: Array, k: int | None, *, track: bool = True,
    watch: Watch | None = None,
) -> Ensemble:  # fmt: skip
    """Run paths from y0 (d,) with the Wiener increments `raw` (N, m, M);
    `_truncation.seen` bounds them, given k.

    If the scheme needs more than increments, such as areas (`sepv.schemes._further_increments`),
    they are in further rows of `raw`. With track=False the invariants are not computed, and their
    defects are zero. `watch` sees each step.
    """
    batch = Batch(scheme, problem, y0, raw.shape[2], track=track, watch=watch)
    m = problem.noises
    used = bounded.seen(raw[:, :m], h, k, scheme.increments)
    if isinstance(scheme.step, PathSolver):
        paths = np.stack([scheme.step.states(problem, y0, h, dW) for dW in used.transpose(2, 0, 1)], axis=2)
        for states, increment in zip(paths[1:], used, strict=True):
            batch.step(h, increment, states)
        return batch.result(raw.sum(axis=0))
    for increment, further in zip(used, raw[:, m:], strict=True):
        batch.step(h, np.concatenate([increment, further]) if len(further) else increment)
    return batch.result(raw[:, :m].sum(axis=0))


class Batch:
    """Paths in NumPy, advanced together; a path whose step failed keeps the state before this
    step.
    """

    def __init__(
        self, scheme: Scheme, problem: Problem, y0: Array, paths: int, *, track: bool = True, compensated: bool = False,
        watch: Watch | None = None,
    ) -> None:  # fmt: skip
        if compensated and scheme.solve is None:
            raise UsageError(
                expected="an implicit scheme for compensated summation in NumPy",
                received=f"the scheme {scheme.name!r}, whose step returns a state and not its increment",
                remedy="engine='compiled', or compensated=False",
            )
        self.scheme, self.problem, self.track, self.watch = scheme, problem, track, watch
        self.y = np.repeat(y0[:, None], paths, axis=1)
        self.lost = np.zeros_like(self.y) if compensated else None
        self.status, self.failed = np.zeros(paths, dtype=np.int64), np.full(paths, -1)
        self.invariants = invariants(problem, self.y)
        self.worst = np.zeros((2, paths))
        self.work = np.zeros(5, dtype=np.int64)
        self.alive = np.arange(paths)
        self.carried = Carried(scheme)
        self.done = 0

    def step(self, h: float, dW: Array, known: Array | None = None) -> None:
        """Take one step with truncated increments dW (m, M). If `known` (d, M) is given,
        it is the step's result.
        """
        alive = self.alive
        self.done += 1
        if not alive.size:
            return
        before = self.y[:, alive]
        if known is not None:
            value, cost, change = known[:, alive], np.zeros(5, dtype=np.int64), None
            code = judged(self.problem, value, np.zeros(alive.size, dtype=np.int64))
        else:
            value, code, cost, change = advance(
                self.scheme, self.problem, before, h, dW[:, alive], self.carried
            )
        self.work += cost
        ok = code == Status.CONVERGED
        self.status[alive[~ok]], self.failed[alive[~ok]] = code[~ok], self.done - 1
        if self.lost is not None and change is not None:
            # Kahan's summation: the rounding of the sum is kept and added to the next increment.
            wanted = change + self.lost[:, alive]
            value = before + wanted
            # Knuth's two-sum, because a component near zero may be smaller than its increment.
            taken = value - before
            self.lost[:, alive] = (before - (value - taken)) + (wanted - taken)
        if self.watch is not None and ok.any():
            self.watch(self.problem, before[:, ok], value[:, ok], h, dW[:, alive[ok]])
        self.alive = alive = alive[ok]
        self.carried.keep(ok)
        self.y[:, alive] = value[:, ok]
        if self.track and alive.size:
            drift = np.abs(invariants(self.problem, self.y[:, alive]) - self.invariants[:, alive])
            self.worst[0, alive] = np.maximum(self.worst[0, alive], drift[0])
            self.worst[1, alive] = np.maximum(self.worst[1, alive], drift[1:].max(axis=0, initial=0.0))

    def result(self, W: Array, states: Array | None = None) -> Ensemble:
        """The `Ensemble` of the paths at the present step,
        from sums W of their increments and `states` kept before.
        """
        gradients, structures, iterations, divisions, continuations = (int(v) for v in self.work)
        ends = Ensemble(
            self.y, W, self.status, self.failed, self.worst[0], self.worst[1], gradients, structures, iterations,
            divisions=divisions, continuations=continuations,
        )  # fmt: skip
        return ends if states is None else replace(ends, states=states)


class Carried:
    """The data that a `StatefulStep` carries from step to step, for each path of a batch;
    empty for other schemes.
    """

    def __init__(self, scheme: Scheme) -> None:
        self.batched = scheme.batched
        self.states: Any = None  # a list with one entry per path if the scheme takes no batches

    def of(self, lane: int) -> Any:
        """The carried state of one path, as a batch of one if the scheme takes batches;
        None before the first step.
        """
        if self.states is None or not self.batched:
            return self.states and self.states[lane]
        return lanes(self.states, [lane])

    def keep(self, alive: np.ndarray) -> None:
        """Keep the carried states of the paths marked in `alive`,
        and drop those of the other paths.
        """
        if self.states is not None and not alive.all():
            kept = np.flatnonzero(alive)
            self.states = lanes(self.states, kept) if self.batched else [self.states[k] for k in kept]


def advance(
    scheme: Scheme, problem: Problem, y: Array, h: float, dW: Array, carried: Carried | None = None
) -> tuple[Array, np.ndarray, np.ndarray, Array | None]:
    """Take a step of a batch: return y1, each path's status, five counts of work,
    and y1 − y0 if the scheme gives it.

    The counts are evaluations of ∇H and B, iterations, divisions and continuations. `carried` holds
    the data that a `StatefulStep` carries, and is updated. If it is not given, the step is the
    first one of the paths.
    """
    if scheme.solve is not None:
        solution = scheme.solve(problem, y, h, dW)
        cost = (
            solution.gradient_evaluations, solution.structure_evaluations, solution.iterations, solution.divisions,
            solution.continuations,
        )  # fmt: skip
        work = np.array([0 if c is None else int(c.sum()) for c in cost])
        return solution.value, solution.status, work, solution.change
    value, code = batch_step(scheme, problem, y, h, dW, carried or Carried(scheme))
    return value, judged(problem, value, code), np.zeros(5, dtype=np.int64), None


def judged(problem: Problem, y: Array, code: np.ndarray) -> np.ndarray:
    """Set `code` in place to a failure for paths whose state y is not finite or is outside the
    problem's domain.
    """
    code[~np.all(np.isfinite(y), axis=0) & (code == 0)] = Status.OVERFLOW
    if problem.domain is not None:
        with np.errstate(invalid="ignore"):
            code[~np.asarray(problem.domain(y), dtype=bool) & (code == 0)] = Status.LEFT_DOMAIN
    return code


def batch_step(
    scheme: Scheme, problem: Problem, y: Array, h: float, dW: Array, carried: Carried
) -> tuple[Array, np.ndarray]:
    """Call the scheme for a whole batch, or path by path if the scheme takes no batches or refuses
    this batch.
    """
    code = np.zeros(y.shape[1], dtype=np.int64)
    value = np.full_like(y, np.nan)
    y, dW = (np.asarray(a, dtype=scheme.dtype) for a in (y, dW))
    stateful = isinstance(scheme.step, StatefulStep)
    with np.errstate(all="ignore"):
        if scheme.batched:
            try:
                whole, carried.states = carry(scheme, problem, y, carried.states, h, dW)
                return np.asarray(whole, dtype=np.float64), code
            except REFUSAL_ERRORS:
                pass
        states = list[Any]()
        for lane in range(y.shape[1]):
            here = [lane] if scheme.batched and stateful else lane
            state: Any = carried.of(lane) if stateful else None
            try:
                end, state = carry(scheme, problem, y[:, here].copy(), state, h, dW[:, here].copy())
                value[:, here] = end
            except REFUSAL_ERRORS:
                code[lane] = Status.NO_CONVERGENCE
            states.append(state)
    if stateful:
        # A failed path takes no further step. If it carries no state yet, another path's state
        # fills its place.
        there = next((s for s in states if s is not None), None)
        states = [there if s is None else s for s in states]
        carried.states = joined_lanes(states) if scheme.batched and there is not None else states
    return value, code
