"""Statistical verdicts: paths are added until the verdict is clear,
or is inconclusive at the end of the budget.

FALSE_ALARM bounds the nominal probability that a whole run of all laws accuses a correct scheme by
chance. A look is a number of paths after which a verdict is tried, at given step sizes. FALSE_ALARM
is split evenly over the statistical laws, the problems and the possible looks, those at halved step
sizes included (Bonferroni): the probability that any interval misses at a look is an equal part of
it. Intervals are asymptotic, so the bound is an extrapolation. `benchmarks.coverage` counts how
often intervals of lower confidence miss.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
from sepv.properties._by_name import load_laws
from sepv.properties._failed_step import row
from sepv.properties._longest_step import divisor
from sepv.properties._orders.convergence import StrongErrors, first, join, strong_errors
from sepv.properties._orders.tilting import tilted_errors
from sepv.properties._sampled import sparing
from sepv.properties._setups import TILTED_ORDER, Setup, setups_for

from sepv.errors import Skipped
from sepv.law import Effort, Finding, Law, Run, Verdict, first_order
from sepv.law.advice import is_explicit
from sepv.law.along_paths import watching
from sepv.law.cases.users_problems import sources
from sepv.problem import Problem, one_field
from sepv.schemes import Scheme, guarded

FALSE_ALARM = 1e-4
FIRST_LOOK = 512
# The factor between the numbers of paths of successive looks. If there are fewer looks, each has
# more of FALSE_ALARM.
PATHS_GROWTH = 4
# A scheme without batches gets the budget of paths divided by PATHS_DIVISOR_WITHOUT_BATCHES, but at
# least FIRST_LOOK paths.
PATHS_DIVISOR_WITHOUT_BATCHES = 8
# The paths of an early look at a scheme without batches. This look may decide "holds", for most
# schemes after 8,000 steps, but not "violated". All laws together need less than 30,000 steps of
# the scheme (`python -m benchmarks.steps`).
EARLY_PATHS = 95
# The error probability of an interval that confirms an order of a scheme without batches. It may be
# large, because laws about one step detect a lower order by quadrature, and sampling only shows
# that steps compose.
ALPHA_TO_HOLD = 1e-3
# If at most the share REFUSED_SHARE of the paths cannot be solved, the step sizes are halved, at
# most REFUSED_MAX_HALVINGS times. A scheme may refuse a step with a large increment, as a
# fixed-point iteration does if it is no contraction, and still show its order at smaller steps. The
# results would be biased if such paths were left out.
REFUSED_SHARE, REFUSED_MAX_HALVINGS = 1 / 4, 2
# SLOPE_MARGIN is the margin between an order and its bound. If an undecided slope's interval is
# narrower, steps are too long and more paths do not help. Then the step sizes are halved once. This
# raises the slope only if the order is right.
SLOPE_MARGIN = 0.25
# If a slope or a limit violates its law, it is measured again with REPEAT_REFINEMENT times the
# steps.
REPEAT_REFINEMENT = 8
# A violation counts only if the reference's error is at most REFERENCE_ERROR_SHARE times the
# scheme's error at the finest step. This changes a slope over step sizes that differ by a factor of
# 4 by at most log(1 + REFERENCE_ERROR_SHARE)/log 4 = 0.16.
REFERENCE_ERROR_SHARE = 1 / 4
# Errors below TOLERANCE_LIKE_ERROR times the state's size that fall by less than a factor of 1.5
# may come from a solver's tolerance.
TOLERANCE_LIKE_ERROR = 1e-5
# Multiples of the number of paths, tried in order to report how many paths would decide.
_DECIDING_MULTIPLES = tuple(4**k for k in range(1, 9))


@dataclass(frozen=True)
class Assessment:
    """An assessment of the errors of one problem: a verdict,
    and a number with its interval in the unit of the law.

    `order` is the order that the errors show, for a law about an order; None if they show none.
    """

    verdict: Verdict
    value: float
    low: float
    high: float
    bound: float
    text: str = ""
    order: float | None = None


# A test (problem, errors, alpha, more) at level alpha, with intervals as if there were `more` times
# the paths.
Assess = Callable[[Problem, StrongErrors, float, float], Assessment]


def is_tilted(scheme: Scheme) -> bool:
    """True if `sepv.properties._orders.tilting` draws the paths of a scheme,
    so that its errors carry weights.
    """
    # With several fields or damping the exact solution depends on the whole path. `tilted_errors`
    # uses only W(T).
    own = any(not one_field(problem) for item in sources(scheme) for problem in item.problems)
    order = None if own or one_field not in scheme.systems.facts else scheme.mean_square_order
    return order is not None and order >= TILTED_ORDER


def hold_level(scheme: Scheme, run: Run) -> float:
    """Return the error probability of intervals that confirm an order:
    ALPHA_TO_HOLD if steps are spared, else 0.
    """
    return ALPHA_TO_HOLD if sparing(scheme, run.effort) else 0.0


def budget(scheme: Scheme, effort: Effort) -> int:
    """Return the largest number of paths of a law, which is smaller for a scheme that takes one
    state at a time.
    """
    return (
        effort.paths
        if scheme.batched
        else min(effort.paths, max(FIRST_LOOK, effort.paths // PATHS_DIVISOR_WITHOUT_BATCHES))
    )


def looks(paths: int, *, early: bool = False) -> list[int]:
    """Return the numbers of paths after which to judge: 512, 2048, … to the budget,
    EARLY_PATHS first if requested.
    """
    counts = [min(FIRST_LOOK, paths)]
    while counts[-1] < paths:
        counts.append(min(counts[-1] * PATHS_GROWTH, paths))
    return [EARLY_PATHS, *counts] if early and counts[0] > EARLY_PATHS else counts


@cache
def part_of_law() -> float:
    """Return the part of FALSE_ALARM for one statistical law of the suite."""
    return FALSE_ALARM / sum(law.statistical for law in load_laws())


def share(scheme: Scheme, effort: Effort, problems: int) -> float:
    """Return the part of FALSE_ALARM for one problem at one look;
    each halving of steps repeats the looks.
    """
    return part_of_law() / (problems * len(looks(budget(scheme, effort))) * (1 + REFUSED_MAX_HALVINGS))


def sampled(scheme: Scheme, setup: Setup, paths: int, run: Run) -> StrongErrors:
    """Return the errors of the first `paths` paths of a setup, computed once for all laws of a
    run.
    """
    order = scheme.mean_square_order
    have = run.paths.get(setup)
    done = have.squared.shape[1] if have else 0
    if done < paths:
        problem, guarded_scheme = setup.build(), guarded(scheme)
        how: dict[str, Any] = {
            "T": setup.T, "steps": setup.steps, "unit": setup.unit, "paths": range(done, paths),
            "seed": run.effort.seed, "watch": watching(run, scheme),
        }  # fmt: skip
        if order is not None and is_tilted(scheme):
            more = tilted_errors(guarded_scheme, problem, order=order, **how)
        else:
            more = strong_errors(guarded_scheme, problem, **how)
        have = join([have, more]) if have else more
        run.paths[setup] = have
    assert have is not None
    return have if any(have.failures) else first(have, paths)  # failed paths are not judged


def judge(
    law: Law, scheme: Scheme, run: Run, assess: Assess, *,
    at_least: bool = True, setups: Sequence[Setup] | None = None, confirm: Assess | None = None,
) -> Finding:  # fmt: skip
    """Return the worst verdict over the problems, with more paths as needed.

    If `at_least`, bounds are lower bounds.

    `setups` are by default those of the scheme. A violation is measured again at finer steps, and
    judged by `confirm` (by default `assess`).
    """
    assert law.statistical, f"{law.name} judges paths, but has no part of FALSE_ALARM"
    confirm = confirm or assess
    setups = [_taken(scheme, s) for s in (setups_for(scheme, run.effort) if setups is None else setups)]
    alpha = share(scheme, run.effort, len(setups))
    judged: list[tuple[Setup, StrongErrors, Assessment]] = []
    lines: list[str] = []
    skipped: list[Skipped] = []
    for setup in setups:
        try:
            used, errors, assessment, refused = _judge_one(
                scheme, setup, run, assess, alpha, slope=at_least, confirm=confirm
            )
        except Skipped as skip:  # programs may refuse some problems
            skipped.append(skip)
            lines.append(f"{setup.problem}: skipped, {skip.reason}")
            continue
        if assessment is None:
            return _failed(law, setup, errors)
        judged.append((used, errors, assessment))
        if refused:
            lines.append(f"{refused}; judged with {', '.join(map(str, used.steps))} steps instead")
        needed = f"{law.unit} {'≥' if at_least else '≤'} {assessment.bound:.3g}"
        lacks = "" if assessment.verdict is Verdict.HOLDS else f", {needed} needed"
        lines.append(f"{setup.problem}: {assessment.text} from {errors.squared.shape[1]} paths{lacks}")
    if not judged:
        raise skipped[0]
    order = (Verdict.VIOLATED, Verdict.INCONCLUSIVE, Verdict.HOLDS)
    verdict = min((a.verdict for *_, a in judged), key=order.index)
    sign = 1.0 if at_least else -1.0
    worst = min((a for *_, a in judged if a.verdict is verdict), key=lambda a: sign * (a.value - a.bound))
    measured = [_measured(*each) for each in judged]
    if verdict is not Verdict.HOLDS:
        lines += [_errors_text(m) for m in measured]
        lines += _explained(scheme, run, assess, alpha, verdict, judged)
    return law.finding(
        verdict, defect=worst.value, bound=worst.bound, at_least=at_least,
        checks=sum(m["paths"] for m in measured), message="\n".join(lines),
        witness={"seed": run.effort.seed, "paths": run.effort.paths, "alpha": alpha, "measured": measured},
        replay=f"--law {law.name} --seed {run.effort.seed} --paths {run.effort.paths}",
    )  # fmt: skip


def _taken(scheme: Scheme, setup: Setup) -> Setup:
    """Return the setup with more steps if the scheme states a longest step that the coarsest step
    may exceed.
    """
    if scheme.longest_step is None:
        return setup
    factor = divisor(scheme, setup.build(), setup.T / setup.steps[0])
    return replace(setup, steps=tuple(factor * n for n in setup.steps))


def _explained(
    scheme: Scheme, run: Run, assess: Assess, alpha: float, verdict: Verdict,
    judged: Sequence[tuple[Setup, StrongErrors, Assessment]],
) -> list[str]:  # fmt: skip
    """Explain a law that does not hold: how many paths would decide, the worst path,
    the level of the intervals.
    """
    decisive = [(setup, errors) for setup, errors, a in judged if a.verdict is verdict]
    lines = []
    if verdict is Verdict.INCONCLUSIVE:
        lines += [_wanted(scheme, setup, assess, errors, alpha) for setup, errors in decisive]
    setup, errors = decisive[0]
    flat = errors.rms()[-2] < 1.5 * errors.rms()[-1] < 1.5 * TOLERANCE_LIKE_ERROR * errors.scale
    problem = setup.build()
    causes = first_order(scheme, problem) if verdict is Verdict.VIOLATED else []
    lines += causes
    step = setup.T / errors.steps[-1], np.zeros(problem.noises)
    tolerance = verdict is Verdict.VIOLATED and flat and not scheme.solver_tolerance and not causes
    if tolerance and not is_explicit(scheme, problem, np.array(problem.initial, dtype=np.float64), *step):
        lines.append(
            f"errors of {errors.rms()[-1]:.1e} do not fall; if it is the scheme's own solver: "
            "Scheme(…, solver_tolerance=…)"
        )
    lines.append(worst_path(problem, errors, run.effort.seed, drawn=not is_tilted(scheme)))
    statement = (
        f"intervals miss with nominal probability {alpha:.1e}; in a whole run nominally ≤ {FALSE_ALARM:g}"
    )
    return [*lines, statement]


def worst_path(problem: Problem, errors: StrongErrors, seed: int, *, drawn: bool) -> str:
    """Describe the path with the largest error at the finest step: y0, W(T), y(T),
    the scheme's end, the increments.

    `drawn` is True if paths are those of `sepv.simulate.increments`, not of
    `sepv.properties._orders.tilting`.
    """
    sizes = np.nan_to_num(errors.squared[-1], nan=np.inf)
    k = int(np.argmax(np.where(errors.weights[-1] > 0, sizes, -1.0)))
    exact = errors.ends[-1, :, k]
    came = exact + errors.errors[-1, :, k] / errors.weights[-1, k]
    text = (
        f"{problem.name}, path {k} of seed {seed}: from y0 = {row(problem.initial)} with W(T) = "
        f"{row(errors.W[-1, :, k])}: y(T) = {row(exact)} expected, {row(came)} came with {errors.steps[-1]} steps"
    )
    if not drawn or errors.reference:
        return text
    return (
        f"{text}; its increments are sepv.simulate.increments({seed}, T={errors.T!r}, steps={errors.steps[-1]}, "
        f"noises={problem.noises}, paths=range({k}, {k + 1}))"
    )


def _judge_one(
    scheme: Scheme,
    setup: Setup,
    run: Run,
    assess: Assess,
    alpha: float,
    *,
    slope: bool,
    confirm: Assess,
) -> tuple[Setup, StrongErrors, Assessment | None, str]:
    """Judge one problem at its step sizes, or at halved ones if paths failed or a `slope` is too
    near its bound.

    A violation is measured again at finer steps, by the test `confirm`. The returned string says
    why step sizes were halved. If paths fail at the smallest sizes too, the assessment is None.
    `share` counts the looks at halved steps.
    """
    why, halved = "", 0
    while True:
        used = replace(setup, steps=tuple(n << halved for n in setup.steps))
        errors, assessment = _look(scheme, used, run, assess, alpha, leave=slope and not halved)
        if assessment is None:
            if (
                halved == REFUSED_MAX_HALVINGS
                or max(errors.failures) > REFUSED_SHARE * errors.squared.shape[1]
            ):
                break
            why = _failures(setup, errors)
        elif slope and not halved and _near(assessment):
            why = f"{setup.problem}: {assessment.text} with {', '.join(map(str, used.steps))} steps is near the bound"
        else:
            break
        halved += 1
    if assessment is not None and assessment.verdict is Verdict.VIOLATED:
        assessment = _confirmed(scheme, used, run, confirm, alpha, assessment, slope=slope)
        unknown = errors.reference > REFERENCE_ERROR_SHARE * errors.rms()[-1]
        if unknown and assessment.verdict is Verdict.VIOLATED:
            doubt = f"{assessment.text}, but the reference is known to {errors.reference:.1e} only"
            assessment = replace(assessment, verdict=Verdict.INCONCLUSIVE, text=doubt)
    return used, errors, assessment, why


def _confirmed(
    scheme: Scheme,
    setup: Setup,
    run: Run,
    assess: Assess,
    alpha: float,
    assessment: Assessment,
    *,
    slope: bool,
) -> Assessment:
    """Measure a violation again with REPEAT_REFINEMENT times the steps.

    The law holds if it holds there, else it may be undecided.

    A scheme that divides long steps, or computes them by another formula, shows its order and its
    limit only at smaller step sizes. A slope is measured again from two step sizes. Its violation
    stands if the new estimate is too low.
    """
    sizes = setup.steps[-2:] if slope else setup.steps
    finer, fine = replace(setup, steps=tuple(REPEAT_REFINEMENT * n for n in sizes)), None
    if not sparing(scheme, run.effort):
        _, fine = _look(scheme, finer, run, assess, alpha)
    elif not any((errors := sampled(scheme, finer, EARLY_PATHS, run)).failures):
        fine = assess(setup.build(), errors, alpha, 1.0)
    if fine is None or fine.verdict is Verdict.VIOLATED:
        return assessment
    if slope and fine.verdict is not Verdict.HOLDS and fine.value <= fine.bound:
        return assessment
    text = f"{assessment.text}, but {fine.text.rstrip(',')} with {', '.join(map(str, finer.steps))} steps"
    verdict = Verdict.HOLDS if fine.verdict is Verdict.HOLDS else Verdict.INCONCLUSIVE
    return replace(fine, verdict=verdict, text=text)


def _near(assessment: Assessment) -> bool:
    """True if a slope is undecided although its interval is narrower than SLOPE_MARGIN."""
    return assessment.verdict is Verdict.INCONCLUSIVE and assessment.high - assessment.low < SLOPE_MARGIN


def _look(
    scheme: Scheme, setup: Setup, run: Run, assess: Assess, alpha: float, *, leave: bool = False
) -> tuple[StrongErrors, Assessment | None]:
    """Draw more paths of one problem while the verdict is undecided.

    If `leave`, stop at a slope near its bound too.

    If paths fail, the assessment is None.
    """
    problem = setup.build()
    most = budget(scheme, run.effort)
    for paths in looks(most, early=sparing(scheme, run.effort)):
        errors = sampled(scheme, setup, paths, run)
        if any(errors.failures):
            return errors, None
        assessment = assess(problem, errors, alpha, 1.0)
        # An early look decides no violation, because with few paths the intervals of heavy tails
        # are too short.
        early = paths < min(FIRST_LOOK, most)
        settled = assessment.verdict is Verdict.VIOLATED or (leave and _near(assessment))
        if assessment.verdict is Verdict.HOLDS or (settled and not early):
            break
    return errors, assessment


def _wanted(scheme: Scheme, setup: Setup, assess: Assess, errors: StrongErrors, alpha: float) -> str:
    """Say how many paths would decide if the means stayed unchanged."""
    if errors.reference > REFERENCE_ERROR_SHARE * errors.rms()[-1]:
        return f"{setup.problem}: more paths would not settle it, because the reference is not known better"
    paths, problem = errors.squared.shape[1], setup.build()
    for factor in _DECIDING_MULTIPLES:
        if assess(problem, errors, alpha, factor).verdict is not Verdict.INCONCLUSIVE:
            wanted = paths * factor
            steps, option = (
                wanted * sum(setup.steps),
                wanted if scheme.batched else wanted * PATHS_DIVISOR_WITHOUT_BATCHES,
            )
            more = "" if scheme.batched else "; a step that takes batches, (d, M), gets so many by itself"
            return f"{setup.problem}: about {wanted} paths, {steps} steps, would settle it (--paths {option}{more})"
    return f"{setup.problem}: more paths would not settle it, at these steps it is too near the bound"


def _measured(setup: Setup, errors: StrongErrors, assessment: Assessment) -> dict[str, Any]:
    return {
        "problem": setup.problem, "T": setup.T, "steps": errors.steps, "paths": errors.squared.shape[1],
        "rms_error": errors.rms().tolist(), "estimate": assessment.value, "interval": [assessment.low, assessment.high],
        **({} if assessment.order is None else {"order": assessment.order}),
    }  # fmt: skip


def _errors_text(m: dict[str, Any]) -> str:
    errors = ", ".join(f"{e:.3g}" for e in m["rms_error"])
    return f"{m['problem']}, T = {m['T']:g}: rms error {errors} with {', '.join(map(str, m['steps']))} steps"


def _failures(setup: Setup, errors: StrongErrors) -> str:
    counts = ", ".join(f"{n} with {s} steps" for n, s in zip(errors.failures, errors.steps, strict=True) if n)
    drawn = errors.squared.shape[1]
    return (
        f"{setup.problem}: of {drawn} paths some were not solved, not finite or out of the domain: {counts}"
    )


def _failed(law: Law, setup: Setup, errors: StrongErrors) -> Finding:
    text = f"{_failures(setup, errors)}\n{errors.failed}".strip()
    return law.finding(Verdict.ERROR, checks=errors.squared.shape[1], message=text)
