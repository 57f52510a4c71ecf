"""The computations behind the plots: a long path of a scheme, its invariants,
and errors against the exact flow.

Each computation is a plain function of names and numbers, so that it can run in any process. Each
calls the scheme's own step; no formula of a scheme is repeated.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from sepv import problems, schemes
from sepv.exact import exact_flow
from sepv.pictures import Series
from sepv.problem import Array, Problem
from sepv.properties import StrongErrors
from sepv.properties import energy_rounding_walk as rounding_walk
from sepv.record import EPS
from sepv.schemes import Scheme
from sepv.simulate import Task, ensemble, wiener
from sepv.simulate import choose_engine as choose
from sepv.simulate import run_task as run
from sepv.simulate import truncation as bounded

from .judge import decide
from .record import Job, Results, Size, Statement, sentence, series, stated_in

# A drift of more than this many times the rounding bound is not rounding.
DRIFT_FACTOR = 1e3
# The largest number of points that are kept of the sample that figures show.
DRAWN_MAX_POINTS = 1000


@dataclass(frozen=True)
class SampledRun:
    """Samples of one scheme on one time interval; figures show the first sample.

    t, y : times (K,) and states (d, K) of the first sample, thinned to about DRAWN_MAX_POINTS
        steps, with its end
    energy, casimir : (N+1,), H and the first quadratic Casimir yᵀAy along the first sample; empty
        without a Casimir
    theta : (K,), the exact solution's time t + Σ c_j W_j(t) at `t`
    checkpoints, energies : numbers of steps (L,) (powers of two, and N), and H of all samples at
        these steps (L, M)
    stopped : the step at which the first sample failed or left the domain, −1 if it did not
    """

    scheme: str
    problem: str
    h: float
    t: Array
    y: Array
    theta: Array
    energy: Array
    casimir: Array
    checkpoints: np.ndarray
    energies: Array
    stopped: int

    @property
    def steps(self) -> int:
        """The number N of steps of the run, even if the first sample stopped earlier."""
        return int(self.checkpoints[-1])


# Seconds of one implicit step in NumPy, and of one explicit step, from which the time left is
# estimated.
STEP_SECONDS = {"energy-preserving": 500e-6, "midpoint": 600e-6, "discrete-gradient": 2000e-6}
EXPLICIT_STEP_SECONDS = 110e-6


@dataclass(frozen=True)
class LongRuns:
    """The long runs of a figure, in which each scheme named in `shown` follows the same Wiener
    path.

    If `shared` is true, a quick reproduction takes only a fraction of the steps.

    samples, others : the number of samples for the schemes in this mapping, and for all other
        schemes
    """

    figure: str
    problem: str
    h: float
    steps: int
    shown: tuple[str, ...]
    samples: Mapping[str, int] = field(default_factory=dict)
    others: int = 1
    shared: bool = True

    def jobs(self, size: Size) -> list[Job]:
        """The jobs of the runs: one for each scheme."""
        steps = size.steps(self.steps) if self.shared else self.steps
        given = {"problem": self.problem, "h": self.h, "steps": steps, **size.given}
        samples = {name: self.samples.get(name, self.others) for name in self.shown}
        return [
            Job((self.figure, "run", n), long_run, {"scheme": n, "samples": M, **given},
                steps * STEP_SECONDS.get(n, EXPLICIT_STEP_SECONDS))
            for n, M in samples.items()
        ]  # fmt: skip

    def by_scheme(self, results: Results) -> dict[str, SampledRun]:
        """The finished runs by name of the scheme, from the results of the jobs."""
        return {name: results[self.figure, "run", name] for name in self.shown}


def long_run(
    scheme: str, problem: str, *, h: float, steps: int, seed: int, samples: int = 1, engine: str = "auto"
) -> SampledRun:
    """Run one scheme over a long time: `samples` paths from the problem's initial state in steps
    of h.

    Sample 0 has the same Wiener path for all schemes. A sample that fails, or leaves the domain,
    keeps its last state and is not stepped further. If this happens to sample 0, its curve ends at
    this step.
    """
    method, system = schemes.by_name(scheme), problems.by_name(problem)
    checkpoints = np.array([*(2**i for i in range(steps.bit_length()) if 2**i < steps), steps])
    raw = wiener.increments(seed, T=h * steps, steps=steps, noises=system.noises, paths=range(samples))
    first, energies, failed = _follow(method, system, h, raw, checkpoints, engine)
    stopped = failed + 1 if failed >= 0 else -1
    shown = first[:, : stopped if stopped > 0 else steps + 1]
    kept = np.unique(
        np.append(np.arange(0, shown.shape[1], max(1, steps // DRAWN_MAX_POINTS)), shown.shape[1] - 1)
    )
    W = np.concatenate([np.zeros((system.noises, 1)), np.cumsum(raw[:, :, 0].T, axis=1)], axis=1)
    t = np.arange(steps + 1) * h
    A = system.casimirs[0] if system.casimirs else None
    return SampledRun(
        scheme=scheme, problem=problem, h=h, t=t[kept], y=shown[:, kept], theta=(t + system.c @ W)[kept],
        energy=system.hamiltonian(shown),
        casimir=np.empty(0) if A is None else np.einsum("in,ij,jn->n", shown, A, shown),
        checkpoints=checkpoints, energies=energies, stopped=stopped,
    )  # fmt: skip


def _follow(
    method: Scheme, system: Problem, h: float, raw: Array, checkpoints: np.ndarray, engine: str
) -> tuple[Array, Array, int]:
    """Take all steps; return the first sample (d, N+1) and its failed step,
    and H of all samples at `checkpoints`.
    """
    steps, _, samples = raw.shape
    target, _ = choose(engine, method, system, compensated=False)
    start = np.array(system.initial, dtype=np.float64)
    ends = run(Task(
        scheme=method, problem=system, y0=start, h=h, steps=steps, first=0, count=samples, seed=0, refine=None,
        truncation=method.truncation, stops=tuple(range(1, steps + 1)), compensated=False, engine=target.name, dW=raw,
        track=False,
    ))  # fmt: skip
    first = np.concatenate([start[:, None], ends.states[:, :, 0]], axis=1)
    energies = system.hamiltonian(ends.states[:, checkpoints - 1])
    return first, energies, int(ends.failed_step[0])


def errors(
    scheme: str | Scheme, problem: str | Problem, *, T: float, steps: Sequence[int], samples: int, seed: int,
    engine: str = "auto",
) -> StrongErrors:  # fmt: skip
    """The errors at T against the exact flow, for paths 0 to `samples` − 1;
    all step sizes share their Wiener paths.
    """
    method = schemes.by_name(scheme) if isinstance(scheme, str) else scheme
    system = problems.by_name(problem) if isinstance(problem, str) else problem
    fine = wiener.increments(seed, T=T, steps=steps[-1], noises=system.noises, paths=range(samples))
    exact = exact_flow(system, system.random_step(T, fine.sum(axis=0))).y
    end_errors, failures = [], []
    for count, raw in coarsened(fine, steps):
        ends = ensemble(method, system, h=T / count, steps=count, dW=raw, engine=engine)
        end_errors.append(ends.y - exact)
        failures.append(int(np.count_nonzero(ends.status)))
    gaps = np.stack(end_errors)
    with np.errstate(over="ignore"):
        squared = np.sum(gaps**2, axis=1)
    return StrongErrors(T, tuple(steps), squared, gaps, tuple(failures), float(np.max(np.abs(exact))))


def truncated(problem: str, *, T: float, steps: Sequence[int], samples: int, seed: int) -> list[int]:
    """The number of increments that Remark 2.1's truncation with k = 2 changes,
    for each number of steps.
    """
    noises = problems.by_name(problem).noises
    fine = wiener.increments(seed, T=T, steps=steps[-1], noises=noises, paths=range(samples))
    return [int(np.sum(bounded.truncate(raw, T / n) != raw)) for n, raw in coarsened(fine, steps)]


def coarsened(fine: Array, steps: Sequence[int]) -> Iterator[tuple[int, Array]]:
    """For each number N of steps, the pair of N and the increments (N, m, M) over these steps.

    The increments are sums of the increments `fine` over the finest grid, which has steps[-1]
    steps.
    """
    return ((count, wiener.coarsen(fine, steps[-1] // count)) for count in steps)


def rounding_bound(steps: int) -> float:
    """A bound on the relative change of an invariant, in `steps` steps,
    of a scheme that keeps it except for rounding.

    The invariant is quadratic: rounding moves it by at most 2 eps of its value in a step. For H see
    `rounding_walk`.
    """
    return 8 * EPS * float(np.sqrt(steps))


def curve(run: SampledRun, values: Array) -> Series:
    """The curve of an invariant along the first sample of a run, thinned to about 600 steps;
    the last step is kept.
    """
    kept = np.unique(np.append(np.arange(0, values.size, max(1, values.size // 600)), values.size - 1))
    return series(run.scheme, kept * run.h, values[kept], scheme=run.scheme)


def bound(run: SampledRun, what: str, *, constant: bool = True) -> float:
    """A bound on the change of the invariant `what` by rounding along a run,
    relative to its value at the start.

    Rounding moves y_i by eps |y_i|, hence H by eps Σ|∂_iH y_i|. If `constant` (the paper says that
    H is kept), the largest sum along the path is taken, else the sum at the start.
    """
    system = problems.by_name(run.problem)
    if what == "Casimir":
        return rounding_bound(run.steps)
    start = abs(float(system.hamiltonian(run.y[:, 0])))
    return float(rounding_walk(system, run.y if constant else run.y[:, :1], run.steps) / start)


def drift(values: Array) -> float:
    """The largest change of an invariant's `values` from the first value,
    relative to the first value.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        return float(np.nanmax(np.abs(values - values[0])) / abs(values[0]))


def statements(
    by_scheme: Mapping[str, SampledRun], what: str, keep: Collection[str], place: str, **places: str
) -> list[Statement]:
    """The statements of all runs on the invariant `what`: the schemes in `keep` keep it,
    the others do not.

    `place` is where the paper says this; `places` has other places in the paper for single schemes.
    """
    return [
        statement(r, what, constant=n in keep, source=stated_in(n, places.get(n, place)))
        for n, r in by_scheme.items()
    ]


def statement(run: SampledRun, what: str, *, constant: bool, source: str) -> Statement:
    """The paper's statement that a scheme keeps the invariant `what`, or, if `constant` is false,
    does not keep it.

    `what` is "energy" or "Casimir".
    """
    moved = drift(run.energy if what == "energy" else run.casimir)
    limit = bound(run, what, constant=constant)
    kept, lost = moved <= limit, moved > DRIFT_FACTOR * limit or run.stopped > 0
    stopped = f"; the sample left the domain at step {run.stopped}" if run.stopped > 0 else ""
    return Statement(
        f"{sentence(run.scheme)} {'keeps' if constant else 'does not keep'} the {what}", source,
        decide(kept, lost) if constant else decide(lost, kept),
        f"largest relative change {moved:.2g} over {run.steps} steps{stopped}",
        f"rounding can do {limit:.1e} (8 eps √N); "
        + ("at most that" if constant else f"more than {DRIFT_FACTOR:g} times that"),
    )  # fmt: skip
