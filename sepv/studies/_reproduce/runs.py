"""The computations behind the panels: one long path of a scheme, and errors against the exact flow.

Each is a plain function of names and numbers, so that it runs in any process, and each runs the
scheme's own step: nothing here knows a formula of a scheme.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sepv import problems, schemes
from sepv.errors import UsageError
from sepv.exact import exact_flow
from sepv.problem import Array, Problem
from sepv.record._binary64 import EPS
from sepv.schemes import Scheme
from sepv.simulate import _truncation as bounded
from sepv.simulate import _wiener as wiener
from sepv.simulate import ensemble
from sepv.simulate._batch import Batch
from sepv.studies._reproduce.job import Job, Size
from sepv.verification._orders.convergence import StrongErrors

# Of the sample that is shown.
POINTS = 1000


@dataclass(frozen=True)
class Run:
    """Samples of one scheme over one stretch of time; the first sample is the one that is shown.

    Attributes
    ----------
    t, y : (K,), (d, K)
        The first sample, at every `stride`-th step and at the end.
    energy : (N+1,)
        H along the first sample, at every step.
    casimir : (N+1,)
        The first quadratic Casimir yᵀAy along it; empty where there is none.
    theta : (K,)
        The exact solution's time t + Σ c_j W_j(t) at `t`.
    checkpoints : (L,) of int
        Steps (powers of two and the last) at which all samples were looked at:
    energies : (L, M)
        their energies there.
    stopped : int
        The step at which the first sample failed or left the domain, −1 where it did not.
    """

    scheme: str
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
        """N, the steps that were asked for."""
        return int(self.checkpoints[-1])


def long_run(
    scheme: str,
    problem: str,
    *,
    h: float,
    steps: int,
    seed: int,
    samples: int = 1,
    engine: str = "auto",
) -> Run:
    """`samples` paths from the problem's initial state with the scheme's own step.

    Sample 0 sees the same Wiener path whatever the scheme. A sample that fails, or leaves the domain,
    stays where it was and counts no further; the first one's curve ends there.
    """
    method, system = schemes.by_name(scheme), problems.by_name(problem)
    checkpoints = np.array([*(2**i for i in range(steps.bit_length()) if 2**i < steps), steps])
    raw = wiener.increments(seed, T=h * steps, steps=steps, noises=system.noises, paths=range(samples))
    first, energies, failed = _follow(method, system, h, raw, checkpoints, engine)
    stopped = failed + 1 if failed >= 0 else -1
    shown = first[:, : stopped if stopped > 0 else steps + 1]
    kept = np.unique(np.append(np.arange(0, shown.shape[1], max(1, steps // POINTS)), shown.shape[1] - 1))
    W = np.concatenate([np.zeros((system.noises, 1)), np.cumsum(raw[:, :, 0].T, axis=1)], axis=1)
    t = np.arange(steps + 1) * h
    return Run(
        scheme=scheme,
        h=h,
        t=t[kept],
        y=shown[:, kept],
        theta=(t + system.c @ W)[kept],
        energy=system.hamiltonian(shown),
        casimir=np.einsum("in,ij,jn->n", shown, system.casimirs[0], shown)
        if system.casimirs
        else np.empty(0),
        checkpoints=checkpoints,
        energies=energies,
        stopped=stopped,
    )


def job(
    figure: str,
    scheme: str,
    problem: str,
    size: Size,
    *,
    h: float,
    steps: int,
    seconds: float,
    samples: int = 1,
) -> Job:
    """The job of a long run."""
    arguments = {
        "scheme": scheme,
        "problem": problem,
        "h": h,
        "steps": steps,
        "samples": samples,
        **size.given,
    }
    return Job((figure, "run", scheme), long_run, arguments, seconds)


def _follow(
    method: Scheme, system: Problem, h: float, raw: Array, checkpoints: np.ndarray, engine: str
) -> tuple[Array, Array, int]:
    """The first sample at every step (d, N+1), all energies at the checkpoints, and the step at which it failed."""
    steps = raw.shape[0]
    if engine == "numpy":
        return _follow_numpy(method, system, h, raw, checkpoints)
    try:
        # Every step of one sample, then the checkpoints of all: not everything has to be kept.
        every = ensemble(
            method, system, h=h, steps=steps, dW=raw[:, :, :1], times=np.arange(1, steps + 1) * h, engine="compiled"
        )  # fmt: skip
    except UsageError:
        if engine != "auto":
            raise
        return _follow_numpy(method, system, h, raw, checkpoints)
    all_ = ensemble(method, system, h=h, steps=steps, dW=raw, times=checkpoints * h, engine="compiled")
    start = np.array(system.initial, dtype=np.float64)[:, None]
    first = np.concatenate([start, every.states[:, :, 0].T], axis=1)
    return first, np.stack([system.hamiltonian(y) for y in all_.states]), int(every.failed_step[0])


def _follow_numpy(
    method: Scheme, system: Problem, h: float, raw: Array, checkpoints: np.ndarray
) -> tuple[Array, Array, int]:
    """The same in one sweep: a NumPy step costs hardly more for many samples than for one."""
    batch = Batch(method, system, np.array(system.initial, dtype=np.float64), raw.shape[2], track=False)
    first = np.empty((system.dimension, raw.shape[0] + 1))
    first[:, 0] = batch.y[:, 0]
    energies: list[Array] = []
    for n, increment in enumerate(bounded.seen(raw, h, method.truncation, method.increments)):
        batch.step(h, increment)
        first[:, n + 1] = batch.y[:, 0]
        if n + 1 == checkpoints[len(energies)]:
            energies.append(system.hamiltonian(batch.y))
    return first, np.stack(energies), int(batch.failed[0])


def errors(
    scheme: str,
    problem: str,
    *,
    T: float,
    steps: Sequence[int],
    samples: int,
    first: int,
    seed: int,
    engine: str = "auto",
) -> StrongErrors:
    """Errors against the exact flow of the samples numbered from `first`, all step sizes on the same paths."""
    method, system = schemes.by_name(scheme), problems.by_name(problem)
    paths = range(first, first + samples)
    return errors_of(method, system, T=T, steps=steps, paths=paths, seed=seed, engine=engine)


def errors_of(
    method: Scheme,
    system: Problem,
    *,
    T: float,
    steps: Sequence[int],
    paths: range,
    seed: int,
    engine: str = "auto",
) -> StrongErrors:
    """The same of a scheme and a problem, of whatever name."""
    fine = wiener.increments(seed, T=T, steps=steps[-1], noises=system.noises, paths=paths)
    exact = exact_flow(system, system.random_step(T, fine.sum(axis=0))).y
    found, failures = [], []
    for count in steps:
        raw = wiener.coarsen(fine, steps[-1] // count)
        ends = ensemble(method, system, h=T / count, steps=count, dW=raw, engine=engine)
        found.append(ends.y - exact)
        failures.append(int(np.count_nonzero(ends.status)))
    gaps = np.stack(found)
    with np.errstate(over="ignore"):
        squared = np.sum(gaps**2, axis=1)
    return StrongErrors(T, tuple(steps), squared, gaps, tuple(failures), float(np.max(np.abs(exact))))


def truncated(problem: str, *, T: float, steps: Sequence[int], samples: int, seed: int) -> list[int]:
    """How many increments Remark 2.1 truncates with k = 2, for each number of steps."""
    noises = problems.by_name(problem).noises
    fine = wiener.increments(seed, T=T, steps=steps[-1], noises=noises, paths=range(samples))
    found = []
    for count in steps:
        raw = wiener.coarsen(fine, steps[-1] // count)
        found.append(int(np.count_nonzero(bounded.truncate(raw, T / count) != raw)))
    return found


def rounding_bound(steps: int) -> float:
    """How far the relative value of an exactly preserved invariant walks by rounding in `steps` steps.

    A step rounds the update of y, by half an ulp of each component, and leaves a residual of the same
    size: a quadratic invariant moves by at most 2 eps of itself. Signs are as good as random, so that by
    Azuma's inequality the walk exceeds 8 eps √N with probability below 1e-3. Measured: 0.3 eps √N.
    """
    return 8 * EPS * float(np.sqrt(steps))
