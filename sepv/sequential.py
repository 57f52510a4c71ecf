"""Statistical verdicts: more paths only while the verdict is open, up to a budget, then inconclusive.

The probability that a law calls a correct scheme violated, or a wrong one correct, through chance in
the paths is at most FALSE_ALARM: it is split evenly over the problems and the looks (Bonferroni), each
look judging by an interval of that level.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from sepv import problems
from sepv.candidate import guarded
from sepv.convergence import Estimate, StrongErrors, above_floor, join, strong_errors
from sepv.errors import Skipped
from sepv.given import problems_of, reach
from sepv.law import Effort, Finding, Law, Verdict
from sepv.problem import NamedProblem, Problem
from sepv.scheme import Scheme
from sepv.tilting import tilted_errors

FALSE_ALARM = 1e-4
FIRST_LOOK = 256
# From this claimed order on the mean square error lives on increments too rare for plain sampling.
TILTED = 1.5
# At these orders finer steps are at the rounding floor.
FEW = ((6, (16, 24, 32)), (5, (16, 32, 64)))


@dataclass(frozen=True)
class Setup:
    """A problem, an end time and increasing numbers of steps over it."""

    problem: str
    T: float
    steps: tuple[int, ...]
    given: Problem | None = None

    def build(self) -> Problem:
        """The problem itself."""
        return problems.by_name(self.problem) if self.given is None else self.given


# A non-constant B with one noise, and a non-quadratic H with two: no large step of theirs is unsolvable.
SETUPS = (Setup("rigid-body", 1.0, (8, 16, 32, 64, 128)), Setup("pendulum", 1.0, (8, 16, 32, 64, 128)))


# Nambu systems; Lotka-Volterra at steps that have solutions.
NAMBU_SETUPS = (SETUPS[0], Setup("lotka-volterra", 0.25, (32, 64, 128, 256, 512)))


# Several structures and Hamiltonians whose flows commute; the law "commutation" looks at those that do not.
SEVERAL_SETUPS = tuple(
    Setup(name, 1.0, (8, 16, 32, 64, 128)) for name in ("commuting-rotations", "commuting-oscillators")
)


def setups_for(scheme: Scheme) -> Sequence[Setup]:
    """The problems on which schemes for its class of systems are judged."""
    own = problems_of(scheme)
    if own is not None:
        return tuple(_setup(problem) for problem in own)
    return {"nambu": NAMBU_SETUPS, "several": SEVERAL_SETUPS}.get(scheme.systems, SETUPS)


def _setup(problem: Problem) -> Setup:
    """A user's problem: as the paper's where it is one of those, else over a time that its slopes allow."""
    data = problem.data
    for known in (*SETUPS, *NAMBU_SETUPS, *SEVERAL_SETUPS):
        if isinstance(data, NamedProblem) and known.problem == data.name:
            return replace(known, given=problem)
    return Setup(problem.name, reach(problem), SETUPS[0].steps, problem)


def steps_for(setup: Setup, truncation: int | None, order: float | None) -> tuple[int, ...]:
    """The numbers of steps at which a scheme is judged.

    The coarsest is left out where increments are not truncated or weighted towards the large ones: they then are
    steps of more than 1, far from any asymptotics, and one explicit path that runs away is the whole mean square.
    """
    if order is not None and order >= TILTED:
        return next((steps for least, steps in FEW if order >= least), setup.steps[1:])
    return setup.steps[1:] if truncation is None else setup.steps


def at_the_floor(law: Law, scheme: Scheme, effort: Effort) -> Finding | None:
    """The finding of a law about a slope, where a problem leaves less than two errors above rounding."""
    for setup in setups_for(scheme):
        try:
            errors = sampled(scheme, setup, looks(effort)[0], effort)
        except Skipped:
            continue  # `judge` names it
        if above_floor(errors).sum() < 2 and not any(errors.failures):
            return law.finding(
                Verdict.INCONCLUSIVE,
                message=f"{setup.problem}: errors at the rounding floor, no slope is left to see",
            )
    return None


def looks(effort: Effort) -> list[int]:
    """Numbers of paths after which to judge: 256, 512, … up to the budget."""
    counts = [min(FIRST_LOOK, effort.paths)]
    while counts[-1] * 2 <= effort.paths:
        counts.append(counts[-1] * 2)
    return counts


def sampled(scheme: Scheme, setup: Setup, paths: int, effort: Effort) -> StrongErrors:
    """The errors of the first `paths` paths, computed once for all laws of a run."""
    order = scheme.mean_square_order
    key = (id(scheme.step), scheme.truncation, order, setup)
    have: StrongErrors | None = effort.cache.get(key)
    done = have.squared.shape[1] if have else 0
    if done < paths:
        problem, wanted = setup.build(), range(done, paths)
        asked, levels = guarded(scheme), steps_for(setup, scheme.truncation, order)
        if order is not None and order >= TILTED:
            more = tilted_errors(
                asked, problem, T=setup.T, steps=levels, paths=wanted, seed=effort.seed, order=order
            )
        else:
            more = strong_errors(asked, problem, T=setup.T, steps=levels, paths=wanted, seed=effort.seed)
        have = join([have, more]) if have else more
        effort.cache[key] = have
    assert have is not None
    return _first(have, paths)


def judge(
    law: Law,
    scheme: Scheme,
    effort: Effort,
    estimate: Callable[[StrongErrors, float], Estimate],
    threshold: float,
    show: Callable[[float], float] = float,
    setups: Sequence[Setup] | None = None,
) -> Finding:
    """Whether the estimate lies above the threshold on every problem.

    Parameters
    ----------
    show : how an estimate is shown to a reader (an order as it is, a logarithm as its exponential).
    """
    setups = setups_for(scheme) if setups is None else setups
    alpha = FALSE_ALARM / (len(setups) * len(looks(effort)))
    verdicts, values, lines, measured = [], [], [], []
    skipped: list[Skipped] = []
    for setup in setups:
        try:
            verdict, value, errors = _judge_one(scheme, setup, effort, estimate, alpha, threshold)
        except Skipped as skip:  # a program need not take every problem
            skipped.append(skip)
            lines.append(f"{setup.problem}: skipped, {skip.reason}")
            continue
        if value is None:
            return _failed(law, setup, errors)
        verdicts.append(verdict)
        values.append(value)
        measured.append(_measured(setup, errors, value, show))
        lines.append(_interval_text(measured[-1]))
    if not values:
        raise skipped[0]
    worst = min(values, key=lambda value: value.value)
    verdict = next((v for v in (Verdict.VIOLATED, Verdict.INCONCLUSIVE) if v in verdicts), Verdict.HOLDS)
    if verdict is not Verdict.HOLDS:
        lines += [_errors_text(m) for m in measured]
        lines.append(
            f"intervals miss with probability {alpha:.1e}; false alarms of the law ≤ {FALSE_ALARM:g}"
        )
    return law.finding(
        verdict,
        defect=show(worst.value),
        bound=show(threshold),
        at_least=True,
        checks=sum(m["paths"] for m in measured),
        message="\n".join(lines),
        witness={"seed": effort.seed, "paths": effort.paths, "alpha": alpha, "measured": measured},
        replay=f"--law {law.name} --seed {effort.seed} --paths {effort.paths}",
    )


def _judge_one(
    scheme: Scheme,
    setup: Setup,
    effort: Effort,
    estimate: Callable[[StrongErrors, float], Estimate],
    alpha: float,
    threshold: float,
) -> tuple[Verdict, Estimate | None, StrongErrors]:
    """More paths of one problem while the interval contains the threshold; no estimate where paths failed."""
    for paths in looks(effort):
        errors = sampled(scheme, setup, paths, effort)
        if any(errors.failures):
            return Verdict.ERROR, None, errors
        value = estimate(errors, alpha)
        if value.low > threshold:
            return Verdict.HOLDS, value, errors
        if value.high < threshold:
            return Verdict.VIOLATED, value, errors
    return Verdict.INCONCLUSIVE, value, errors


def _measured(
    setup: Setup, errors: StrongErrors, value: Estimate, show: Callable[[float], float]
) -> dict[str, Any]:
    return {
        "problem": setup.problem,
        "T": setup.T,
        "steps": errors.steps,
        "paths": errors.squared.shape[1],
        "rms_error": errors.rms().tolist(),
        "estimate": show(value.value),
        "interval": sorted((show(value.low), show(value.high))),
    }


def _interval_text(m: dict[str, Any]) -> str:
    low, high = m["interval"]
    return f"{m['problem']}: {m['estimate']:.3g} in [{low:.3g}, {high:.3g}] from {m['paths']} paths"


def _errors_text(m: dict[str, Any]) -> str:
    errors = ", ".join(f"{e:.3g}" for e in m["rms_error"])
    return f"{m['problem']}, T = {m['T']:g}: rms error {errors} with {', '.join(map(str, m['steps']))} steps"


def _failed(law: Law, setup: Setup, errors: StrongErrors) -> Finding:
    counts = ", ".join(f"{n} with {s} steps" for n, s in zip(errors.failures, errors.steps, strict=True) if n)
    return law.finding(
        Verdict.ERROR,
        checks=errors.squared.shape[1],
        message=f"{setup.problem}, of {errors.squared.shape[1]} paths were not solved, not finite or out of the "
        f"domain: {counts}",
    )


def _first(errors: StrongErrors, paths: int) -> StrongErrors:
    return StrongErrors(
        errors.T,
        errors.steps,
        errors.squared[:, :paths],
        errors.errors[:, :, :paths],
        errors.failures,
        errors.scale,
        errors.floor,
        errors.reference,
    )
