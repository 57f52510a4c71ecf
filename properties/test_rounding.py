"""Brouwer's law: over many steps the energy of an energy-preserving scheme moves like a random walk
of roundings.

If the solver of a scheme stops at a tolerance, its residuals have one sign, and the energy drifts
linearly.

Let D be the defect of H after n steps in ulp of H, and w the change of H in a step y1 = y0 + z by
the rounding of this sum alone. So w√n is the predicted random walk (`sepv.law.tolerance`). Three
quantities are judged:

- size: the root mean square of D over paths is at most ALLOWED_WALK·w√n at every checkpoint;
- drift: the mean of D over P paths is at most ALLOWED_BIAS·w·n plus Student's t of level
ROUNDING_LEVEL times the
  standard error of the mean, which is the larger of the sample's and w√(n/P);
- growth: the mean of D²/n at the last checkpoint is at most q times its value at the first
  checkpoint, or q w² if that is larger, with the quantile q of level ROUNDING_LEVEL of Fisher's F
  with (P, P) degrees of freedom.

If D is a sum of independent roundings, drift and growth fail with probability at most
ROUNDING_LEVEL each in each of four runs, and so with less than 1e-6 in all.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from sepv.properties._failed_step import failed_step
from sepv.properties._longest_step import divisor
from sepv.properties._orders.local_errors import two_noises
from sepv.properties._problems_of import as_taken, problems_of, units_for
from sepv.properties._sampled import DEEP_EXAMPLES, DEEPER, sparing
from sepv.reference.problem import exact_problem

from sepv import problems
from sepv.core.newton import Status
from sepv.errors import Skipped
from sepv.exact import FlowFailure, exact_flow
from sepv.law import Effort, Finding, Law, Run, Verdict, energy_ulp, require
from sepv.law.along_paths import watching
from sepv.law.cases.from_problem import describe
from sepv.law.cases.of_law import NOT_KEPT, UNDAMPED
from sepv.law.tolerance import rounding_variances
from sepv.law.units import units_of
from sepv.problem import Array, Problem, damping_of, one_field, one_hamiltonian, vector_field
from sepv.record import EPS, TINY
from sepv.schemes import Scheme, Systems, guarded
from sepv.simulate import Carried, Watch, advance, wiener
from sepv.simulate import truncation as bounded
from sepv.statistics import fishers_f, students_t

ROUNDING_PATHS = 60
# (problem, h, steps): two long runs; one with large steps, which show a solver that stops early;
# one with B(y) and a quartic H, because some errors cancel if B or H is simple. The smallest
# visible drift depends on paths times steps.
TOP_RUN = ("quartic-top", 2.0**-5, 128)
PROBLEM_RUNS = (("rigid-body", 0.01, 256), ("pendulum", 0.01, 256), ("rigid-body", 0.125, 128), TOP_RUN)
# Runs (problem, h, steps) of schemes for Nambu systems.
NAMBU_RUNS = (PROBLEM_RUNS[0], ("lotka-volterra", 2.0**-8, 256), PROBLEM_RUNS[2])
# Runs (problem, h, steps) of schemes for several structures.
SEVERAL_RUNS = (("commuting-rotations", 0.01, 256), ("commuting-oscillators", 0.01, 256))
# The number of paths for a scheme that takes one state at a time. Each problem then has one run, of
# half the steps and the largest h. Paths times steps fall from 46,080 to 7,168, and the smallest
# visible drift is 2.1 times as large.
SPARED_ROUNDING_PATHS = 28
FIRST_CHECKPOINT = 32  # the number of steps of the first checkpoint; each later one has twice as many
# The allowed root mean square of D, as a multiple of the predicted walk w√n (`sepv.law.tolerance`).
# Schemes of sepv are at 1, which 60 paths measure to 9 %. The factor allows for other orders of
# operations, with up to a hundred roundings of y in a step.
ALLOWED_WALK = 10.0
# The allowed mean change of H in a step of a correct scheme, as a share of w: rounding to nearest
# is slightly biased, and an iteration has a residual. In 10⁸ steps this share is 7e-4 for the
# pendulum, else less (docs/long-times.md).
ALLOWED_BIAS = 2.0**-6
# The probability with which each test of drift or growth rejects independent roundings.
ROUNDING_LEVEL = 1e-7
# If the noises change the random time by less than ALIKE_TIMES times the time itself, paths start
# from states spread over SPREAD_STATES units of time of the orbit. Over a short piece of an orbit
# roundings of a correct scheme need not average out (Kepler near its pericentre: 0.09 w a step),
# and without noise all paths would be equal.
ALIKE_TIMES, SPREAD_STATES = 0.25, 256
# Defects are cut off at DEFECT_CUT, so that squares stay finite. Roundings above EXPLODED_ROUNDING
# (exploding paths) do not count.
DEFECT_CUT, EXPLODED_ROUNDING = 1e150, 1e100
# If the operations of H cannot be recorded, H is computed in binary64 at worst. The law then needs
# an error below UNRECORDED_MAX_ULP ulp of H, which a constant in H, or terms that cancel, may
# exceed.
UNRECORDED_MAX_ULP = 1024.0


def run(law: Law, scheme: Scheme, this_run: Run) -> Finding:
    """Judge size, drift and growth of the energy defects of all runs,
    in ulp of H over √n after n steps.
    """
    judged: list[JudgedRounding] = []
    effort = this_run.effort
    lines, broken, skipped, checks = [], [], [], 0
    ratio = scheme.eps / EPS  # the scheme's rounding relative to that of binary64
    watch = watching(this_run, scheme)
    deeper = DEEPER if effort.examples >= DEEP_EXAMPLES else 1
    spared = sparing(scheme, effort)
    paths, runs = (
        (SPARED_ROUNDING_PATHS, _fewer(runs_for(scheme))) if spared else (ROUNDING_PATHS, runs_for(scheme))
    )
    for problem, h, usual in runs:
        size = h if scheme.longest_step is None else h / divisor(scheme, problem, h)
        label, steps = f"{problem.name}, h = {size:g}", usual * deeper
        try:
            defects, predicted, failed = energy_walk(scheme, problem, size, steps, effort.seed, paths, watch)
        except Skipped as reason:
            skipped.append(f"{label}: {reason}")
            continue
        alive = np.isfinite(defects[-1])
        if alive.sum() < paths // 2:
            if why := escaping(problem, _increments(scheme, problem, size, steps, effort.seed, paths), size):
                skipped.append(f"{label}: {why}")
                continue
            broken.append(f"{label}: {paths - alive.sum()} of {paths} paths failed; {failed}")
            continue
        checks += int(alive.sum())
        judgement = judge(defects[:, alive] / ratio, predicted, scheme.solver_tolerance / ratio)
        judged += judgement
        lost = "" if alive.all() else f", {paths - alive.sum()} paths failed; {failed}"
        lines.append(f"{label}, {steps} steps: " + ", ".join(r.text for r in judgement) + lost)
    if not judged and not broken:
        return law.finding(Verdict.NOT_APPLICABLE, message="\n".join(skipped))
    worst = max(judged, key=lambda r: r.size / r.allowed, default=JudgedRounding("", 0.0, 1.0, ""))
    verdict = Verdict.ERROR if broken else Verdict.HOLDS
    finding = law.finding(
        verdict if worst.size <= worst.allowed else Verdict.VIOLATED,
        defect=worst.size,
        bound=worst.allowed,
        checks=checks,
        message="\n".join(lines + broken + skipped),
        witness={"seed": effort.seed, "paths": effort.paths, "examples": effort.examples},
        replay=f"--law {law.name} --seed {effort.seed} --paths {effort.paths}",
    )
    return finding if ratio == 1 else replace(finding, unit=f"{law.unit}, float32")


class JudgedRounding(NamedTuple):
    """A judged quantity (size, drift or growth) in ulp of H over √n after n steps, and its
    limit.
    """

    name: str
    size: float
    allowed: float
    text: str


def judge(defects: Array, predicted: float, solver_tolerance: float = 0.0) -> list[JudgedRounding]:
    """Judge size, drift and growth of energy defects (checkpoints, paths) after FIRST_CHECKPOINT,
    2·FIRST_CHECKPOINT, 4·FIRST_CHECKPOINT, … steps.

    A solver's stated tolerance, relative to |y|, may change H by `solver_tolerance` |∇H||y| a step
    in one direction.
    """
    paths = defects.shape[1]
    n = FIRST_CHECKPOINT * 2.0 ** np.arange(len(defects))
    last, root = float(n[-1]), float(np.sqrt(n[-1]))
    stated = solver_tolerance / EPS * root
    rms = np.sqrt(np.mean(defects**2, axis=1) / n)
    largest = float(np.max(rms))
    size = JudgedRounding(
        "size",
        largest,
        ALLOWED_WALK * predicted + stated + TINY,
        f"at most {largest:.3g} ulp of H per √n, predicted {predicted:.3g}",
    )
    mean = float(np.mean(defects[-1]))
    error = max(float(np.std(defects[-1], ddof=1)), predicted * root) / np.sqrt(paths)
    allowed = ALLOWED_BIAS * predicted * last + students_t(ROUNDING_LEVEL / 2, paths - 1) * error
    drift = JudgedRounding(
        "drift",
        abs(mean) / root,
        allowed / root + stated + TINY,
        f"mean at the end {mean / (error + TINY):+.1f} standard errors",
    )
    before = max(float(rms[0]), predicted)
    growth = JudgedRounding(
        "growth",
        float(rms[-1]),
        before / fishers_f(ROUNDING_LEVEL, paths) ** 0.5 + stated + TINY,
        f"growth n^{np.polyfit(np.log(n), np.log(rms * np.sqrt(n) + 1e-300), 1)[0]:.2f}",
    )
    return [size, growth, drift]


def runs_for(scheme: Scheme) -> list[tuple[Problem, float, int]]:
    """List runs (problem, h, steps), on the problems that the scheme is given for or else on those
    of its class.
    """
    users = problems_of(scheme)
    if users is not None:
        users = tuple(problem for problem in users if one_hamiltonian(problem))
    if users and all(map(damping_of, users)):
        raise Skipped(UNDAMPED)
    if one_hamiltonian not in scheme.systems.facts or users == ():
        raise Skipped(NOT_KEPT)
    if users is None:
        runs: dict[str, Any] = {Systems.NAMBU: NAMBU_RUNS, Systems.SEVERAL: SEVERAL_RUNS}
        names, *lengths = zip(*runs.get(scheme.systems, PROBLEM_RUNS), strict=True)
        return list(zip(as_taken(scheme, map(_named, names)), *lengths, strict=True))
    share = max(1, -(-len(users) // 2))
    # Numbers of steps are FIRST_CHECKPOINT times a power of two, so that the last step is a
    # checkpoint.
    long, short = (
        FIRST_CHECKPOINT * 2 ** max(1, int(np.log2(steps / FIRST_CHECKPOINT / share))) for steps in (256, 128)
    )
    times = [units_of(p).time for p in users]
    return [
        (p, share * t, n)
        for share, n in ((0.01, long), (0.125, short))
        for p, t in zip(users, times, strict=True)
    ]


def _named(name: str) -> Problem:
    return two_noises() if name == TOP_RUN[0] else problems.by_name(name)


def _fewer(runs: list[tuple[Problem, float, int]]) -> list[tuple[Problem, float, int]]:
    """Keep only the last run of each problem, which has the largest h,
    and halve its number of steps.
    """
    last = {problem.name: (problem, h, max(2 * FIRST_CHECKPOINT, steps // 2)) for problem, h, steps in runs}
    return list(last.values())


@lru_cache(maxsize=16)
def _spread(problem: Problem, paths: int) -> Array:
    """Compute P = `paths` states (d, P) along the drift's flow over SPREAD_STATES units of time,
    to six digits.

    If the flow ends early, the states are near the initial state. If one leaves the domain, all are
    the initial state.
    """
    from scipy.integrate import solve_ivp  # takes half a second; only users' problems need it

    start, end = np.array(problem.initial, dtype=np.float64), SPREAD_STATES * units_of(problem).time
    share = np.arange(paths) / paths
    near = 1e-6 * float(np.max(np.abs(start)))

    def field(_: float, state: Array) -> Array:
        return vector_field(problem, state)

    with np.errstate(all="ignore"):
        flow = solve_ivp(field, (0.0, end), start, "DOP853", end * share, rtol=1e-6, atol=near or 1e-6)
    # A flow that ends too early returns fewer states than paths.
    moved = flow.y if flow.y.shape[1] == paths else start[:, None] * (1 + share / 1024)
    inside = problem.domain is None or np.all(problem.domain(moved))
    return moved if inside else np.repeat(start[:, None], paths, axis=1)


def _increments(scheme: Scheme, problem: Problem, h: float, steps: int, seed: int, paths: int) -> Array:
    """Return the increments (steps, m, paths) that the scheme gets."""
    raw = wiener.increments(seed, T=h * steps, steps=steps, noises=problem.noises, paths=paths)
    return bounded.seen(raw, h, scheme.truncation, scheme.increments, units_for(scheme, problem).time)


def escaping(problem: Problem, dW: Array, h: float) -> str:
    """Say why the exact solution does not exist on half of the paths; empty if it does,
    or if nothing tells.

    The solution is the flow of f = B∇H at the random time θ = t + Σ c_jW_j. If the flow cannot be
    followed to the median, over the paths, of the largest or of the smallest θ, it ends on half of
    them, and a failed step is no fault.
    """
    if not one_field(problem):
        return ""
    theta = np.cumsum(h + np.tensordot(dW, problem.c, axes=(1, 0)), axis=0)
    ends = [min(0.0, float(np.median(theta.min(axis=0)))), max(0.0, float(np.median(theta.max(axis=0))))]
    try:
        exact_flow(problem, ends, np.asarray(problem.initial, dtype=np.float64))
    except FlowFailure as failure:
        return f"the exact solution escapes on half of the paths. {str(failure).partition(chr(10))[0]}"
    return ""


def energy_walk(
    scheme: Scheme, problem: Problem, h: float, steps: int, seed: int, paths: int = ROUNDING_PATHS,
    watch: Watch | None = None,
) -> tuple[np.ndarray, float, str]:  # fmt: skip
    """Return energy defects (checkpoints, paths), the change of H by a step's rounding,
    and a text on a failed step.

    Defects have a sign, and are NaN for failed paths. H is in extended precision. The unit is the
    ulp of H. `watch` sees each step.
    """
    guarded_scheme, exact = guarded(scheme), exact_problem(describe(problem), 30)
    dW = _increments(scheme, problem, h, steps, seed, paths)
    y0 = np.array(problem.initial, dtype=np.float64)
    y = np.repeat(y0[:, None], paths, axis=1)
    if (scheme.problems or not problem.noises) and float(problem.c.sum()) < ALIKE_TIMES * np.sqrt(h * steps):
        y = _spread(problem, paths).copy()
    H0, unit = [exact.hamiltonian(exact.state(start)) for start in y.T], float(energy_ulp(problem, y0, y0))
    if exact.uncertainty(y0) > UNRECORDED_MAX_ULP * unit:
        raise Skipped("the code of H hides its operations, and rounds it by more than H may change")
    rows: list[np.ndarray] = []
    carried = Carried(scheme)
    alive, checkpoint, failed = np.arange(paths), FIRST_CHECKPOINT, ""
    # `spent` sums variances of a path's roundings; `widths` has their root mean square per step at
    # each checkpoint.
    spent, widths = np.zeros(paths), []
    for n in range(1, steps + 1):
        value, status, *_ = advance(guarded_scheme, problem, y[:, alive], h, dW[n - 1][:, alive], carried)
        if not failed and np.any(status != Status.CONVERGED):
            k = alive[status != Status.CONVERGED][0]
            failed = f"path {k} of seed {seed} in step {n}, " + failed_step(
                scheme, problem, y[:, k], h, dW[n - 1][:, k]
            )
        solved = status == Status.CONVERGED
        alive = alive[solved]
        carried.keep(solved)
        if watch is not None and alive.size:
            watch(problem, y[:, alive], value[:, solved], h, dW[n - 1][:, alive])
        y[:, alive] = value[:, solved]
        spent[alive] += rounding_variances(problem.gradient(y[:, alive]), y[:, alive])
        if n == checkpoint:
            if not rows and unit <= TINY and alive.size:
                # If y0 = 0 or the drift rests at y0, the ulp of H at y0 is 0: the unit is that of
                # reached states.
                unit = float(np.median(energy_ulp(problem, y[:, alive], y[:, alive])))
            row = np.full(paths, np.nan)
            for k in alive:
                defect = float(exact.hamiltonian(exact.state(y[:, k])) - H0[k]) / unit
                row[k] = max(-DEFECT_CUT, min(DEFECT_CUT, defect))
            rows.append(row)
            width = np.full(paths, np.nan)
            width[alive] = np.sqrt(spent[alive] / n) / unit
            widths.append(width)
            checkpoint *= 2
        if not alive.size:
            return np.full((1, paths), np.nan), 0.0, failed
    return *in_own_roundings(np.array(rows), np.array(widths)), failed


def in_own_roundings(defects: Array, widths: Array) -> tuple[Array, float]:
    """Scale defects (checkpoints, paths) as if roundings had one size on all paths.
    Also return this size, for a step.

    `widths` has the root mean square rounding of a step on each path up to each checkpoint. Widths
    vary a lot if paths start at the origin or at different states. A defect divided by √n times its
    path's width is still normal.
    """
    alive = np.isfinite(widths)
    known = np.where(
        alive & (widths < EXPLODED_ROUNDING), widths, 0.0
    )  # an exploding path does not raise its limit
    common = float(np.sqrt(np.sum(known**2) / max(1, np.count_nonzero(alive))))
    own = np.where(known > 0, np.maximum(known, common / SPREAD_STATES), common)
    return (defects * (common / own) if common else defects), common


def replay(law: Law, scheme: Scheme, witness: dict[str, Any]) -> Finding:
    """Repeat the run of a witness (a stored counterexample),
    with its seed and numbers of examples and paths.
    """
    effort = Effort(
        seed=int(witness["seed"]), examples=int(witness.get("examples", 100)), paths=int(witness["paths"])
    )
    return run(law, scheme, Run(effort))


law = Law(
    name="rounding",
    statement="the energy error of n steps is about √n independent roundings, without a drift",
    source="Prop. 3.1",
    unit="ulp H·√n",
    cost=0.4,
    steps=46080,
    spared=7168,
    run=run,
    replay=replay,
    statistical=True,
)


def test_rounding(scheme: Scheme, effort: Effort) -> None:
    require(law, scheme, effort)
