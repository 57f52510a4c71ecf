"""Two programs of one method make the same steps, up to roundings and to the tolerances of their
solvers.

Let y1 = y0 + R(y0, y1) be the equation of the method; an explicit method is one whose R does
not depend on y1. Program i solves it up to a residual r_i. Their distance e satisfies (I
− ∂R/∂y1)e = r_1 − r_2, so |e| ≤ ‖(I − ∂R/∂y1)⁻¹‖ (|r_1| + |r_2|). The steps are inside the
contraction radius, where the equation has one solution near y0: both programs follow the same
branch. `sepv.law.tolerance` derives r_i from the roundings of y, Δ and the stages, and from the
solver's stated tolerance. Over N steps of a path the residuals add up to N e^(2κ) r
(`sepv.law.middle`).

**Other equations.** The residual is derived for steps that combine values of ΔB∇H between y0 and
y1. A method that does not act through Δ may compute Itô's correction, whose rounding is added. If
two steps are still farther apart, the responses of both programs to their own roundings are
measured: |Φ(x + w e_k) − Φ(x)|, summed over the components k of x = (y, h, ΔW), where w is the
residual of y_k, and for h and ΔW_j the count of roundings times their size. A difference within the
sum of both responses is one that roundings may cause.

**Refusals.** If both programs refuse a step, they agree. If one refuses a step that the other
makes, the law counts and names it, and does not judge it: a solver may give up earlier than
another. NaN is an answer, unless both give it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from sepv.properties._way_back import moved

from sepv.console import counted
from sepv.errors import NotFinite, SepvError, Skipped, StepFailure, Unasked
from sepv.law import (
    Case,
    Cases,
    Effort,
    Finding,
    Law,
    Measurement,
    Middle,
    Run,
    Verdict,
    amplification,
    require,
    searched,
    state_ulp,
    step_residual,
)
from sepv.law.cases.clipped import clips, fits
from sepv.law.cases.ends import beyond, is_long
from sepv.law.cases.fixed_cases import may_be_refused
from sepv.law.search import FAR_OFF
from sepv.law.tolerance import accumulated, correction_rounding, operations
from sepv.problem import Array
from sepv.record import PolynomialMap
from sepv.schemes import (
    Scheme,
    StatefulStep,
    Systems,
    Twin,
    as_path,
    ask_next,
    has_memory,
    load_scheme,
    takes,
)

# The law holds only if both programs make at least this share of the steps that one of them makes.
BOTH_MIN_SHARE = 0.25
# The most components that a counterexample lists.
LISTED_COMPONENTS = 4


@dataclass
class Tally:
    """The counts of a search: steps of both, steps with equal bits,
    steps that both or one of them refuse.
    """

    steps: int = 0
    equal: int = 0
    both_refuse: int = 0
    largest: float = 0.0
    alone: Counter[str] = field(default_factory=Counter)
    shortest: dict[str, str] = field(default_factory=dict)

    @property
    def words(self) -> str:
        """One sentence about the steps, and one for each program that refuses steps alone."""
        least = f", distance/bound {self.largest:.2g} at most" if self.largest else ""
        refused = f"; {counted(self.both_refuse, 'more step')} refused by both" if self.both_refuse else ""
        made = f"{counted(self.steps, 'step')} of both, {self.equal} with equal bits{least}{refused}"
        return "\n".join(
            [made, *(f"{why}, {n} times, such as\n{self.shortest[why]}" for why, n in self.alone.items())]
        )


def pair(scheme: Scheme) -> Scheme | str:
    """The scheme with its twin loaded, and with the facts of both that decide which cases are asked
    of them.

    Both are exchanged if the twin alone computes in single precision. The result is the reason, if
    no case is for both.
    """
    given = scheme.twin
    if given is None:
        return "no second program: sepv verify A --agrees-with B, or sepv.verify(a, agrees_with=b)"
    first, second = scheme, load_scheme(given.scheme)
    names = (
        [first.name, second.name] if first.name != second.name else [first.name, f"{second.name} (its twin)"]
    )
    first, second = replace(first, name=names[0]), replace(second, name=names[1])
    if first.asks and second.asks and first.asks != second.asks:
        return f"{names[0]} asks for {first.asks}, and {names[1]} for {second.asks}"
    systems = _common(first.systems, second.systems)
    if systems is None:
        return f"{names[0]} is for systems of the class {first.systems}, {names[1]} for {second.systems}"
    still = first.deterministic or second.deterministic
    if still and systems.several_fields:
        return f"one of the two is for systems without noise, and systems of the class {systems} have noise"
    if first.dtype == "float64" != second.dtype:
        first, second = second, first
    step = first.step
    if has_memory(second) and not has_memory(first):
        step = StatefulStep(lambda _, y: y, first.step, lambda y: y)
    orders: dict[str, Any] = {"noise": False, "mean_square_order": None, "weak_order": None} if still else {}
    return replace(
        first,
        step=step,
        solve=None,
        batched=False,
        systems=systems,
        stages=max(first.stages, second.stages),
        solver_tolerance=max(first.solver_tolerance, second.solver_tolerance),
        problems=first.problems or second.problems,
        twin=Twin(second, given.bits),
        **orders,
    )


def _common(first: Systems, second: Systems) -> Systems | None:
    """The class of systems that both programs take: the narrower one of two,
    of which one contains the other.
    """
    for wide, narrow in ((first, second), (second, first)):
        if wide in (narrow, Systems.SINGLE) or (wide is Systems.HAMILTONIANS and narrow.several_fields):
            return narrow
    return None


def check_into(tally: Tally) -> Callable[[Scheme, Case], Measurement]:
    """The check of one case of a `pair`, which counts in `tally` what it meets."""

    def check(scheme: Scheme, case: Case) -> Measurement:
        return _compared(scheme, case, tally)

    return check


def _compared(scheme: Scheme, case: Case, tally: Tally) -> Measurement:
    """Measure the distance of both programs along the steps of a case,
    each from the state of its own path.
    """
    problem, y, h, dW = case.build()
    own, count = as_path(scheme)
    assert own.twin is not None
    other: Scheme = own.twin.scheme
    if not takes(other, problem, y, h, dW):
        raise Skipped(f"a longer step than {other.name} says it takes (longest_step)")
    if (other.solver_tolerance or other.deterministic) and beyond(case):
        raise Skipped(FAR_OFF)
    if other.truncation is not None and not fits(problem, h, dW, other.truncation) and clips(other, [case]):
        raise Unasked(f"increments beyond √h A_h, which {other.name} clips")
    (mine, refused), (its, its_refused) = (_path(s, case, count) for s in (own, other))
    if refused is not None or its_refused is not None:
        return _refused(own, other, case, (len(mine), refused), (len(its), its_refused), tally)
    tally.steps += 1
    off = [_apart(a, b) for a, b in zip(mine, its, strict=True)]
    sizes = [float(v.max()) for v in off]
    largest, unit = max(sizes), state_ulp(y, mine[-1], its[-1])
    if not largest:
        tally.equal += 1
        return Measurement(0.0, 0.0, "equal bits")
    rounding = _bound(scheme, other, case, mine[-1], its[-1], within=largest)
    tally.largest = max(tally.largest, largest / rounding)
    bound = 0.0 if own.twin.bits else rounding
    n = next((n for n, size in enumerate(sizes) if size > bound), sizes.index(largest))
    where = "" if count == 1 else f"step {n + 1} of {count}, "
    detail = f"{where}{own.name} {mine[n].tolist()}, {other.name} {its[n].tolist()}{_parts(off[n], bound)}"
    if own.twin.bits:
        within = "may" if largest <= rounding else "do not"
        detail += f"; roundings {within} cause it: they reach {rounding:.2g}"
    return Measurement(sizes[n] / unit, bound / unit, detail)


def _path(scheme: Scheme, case: Case, count: int) -> tuple[list[Array], Exception | None]:
    """The states after each of `count` steps from the case's y, up to the first refusal or NaN,
    and this error.
    """
    problem, y, h, dW = case.build()
    state: Any = None
    states: list[Array] = []
    for _ in range(count):
        try:
            with _of(scheme):
                y, state = ask_next(scheme, problem, y, state, h / count, dW / count)
        except (StepFailure, NotFinite) as error:
            return states, error
        y = y.copy()  # a program may use its own array again
        states.append(y)
    return states, None


@contextmanager
def _of(scheme: Scheme) -> Iterator[None]:
    """A context in which the message of a fault begins with the name of the program that made
    it.
    """
    try:
        yield
    except SepvError as error:
        if not isinstance(error, (StepFailure, Skipped)):
            error.args = (f"{scheme.name}: {error}",)
        raise


def _apart(a: Array, b: Array) -> Array:
    """The distances |a − b| (d,) of two states; of 0 and −0, whose bits differ,
    it is the least number above 0.
    """
    off = np.abs(a - b)
    return np.where((off == 0) & (np.signbit(a) != np.signbit(b)), np.nextafter(0.0, 1.0), off)


def _bound(scheme: Scheme, other: Scheme, case: Case, mine: Array, its: Array, *, within: float) -> float:
    """The bound of the distance of both ends (d,); responses are measured only if it is less than
    `within`.
    """
    problem, y, h, dW = case.build()
    own, count = as_path(scheme)
    facts = scheme if other.dtype == scheme.dtype else replace(scheme, dtype=other.dtype)
    residuals = [step_residual(problem, y, y1, h, dW, s) for y1, s in ((mine, scheme), (its, facts))]
    if isinstance(problem.gradient, PolynomialMap) and not all(
        "random-step" in s.claims for s in (own, other)
    ):
        rounding = accumulated(scheme) * correction_rounding(problem, y, mine, h / count)
        residuals = [r + rounding for r in residuals]
    bound = amplification(scheme, case) * float(np.max(residuals[0] + residuals[1]))
    if within <= bound:
        return bound
    return bound + sum(
        _response(s, case, count, y1, r)
        for s, y1, r in zip((own, other), (mine, its), residuals, strict=True)
    )


def _response(scheme: Scheme, case: Case, count: int, y1: Array, residual: Array) -> float:
    """The sum over y, h and ΔW of the changes of a program's end y1 when one number changes by its
    roundings.
    """
    problem, y, h, dW = case.build()
    d = len(y)

    def end(x: Array) -> Array:
        changed = replace(case, y=tuple(x[:d].tolist()), h=float(x[d]), dW=tuple(x[d + 1 :].tolist()))
        states, error = _path(scheme, changed, count)
        if error is not None:
            raise error
        return states[-1]

    x = np.concatenate([y, [h], dW])
    relative = 0.5 * scheme.eps * operations(problem, scheme.stages) * np.abs(x[d:])
    widths = np.concatenate([residual, relative])
    changes = [np.max(moved(end, x, y1, k, width)) for k, width in enumerate(widths)]
    return float(sum(changes))


def _parts(off: Array, bound: float) -> str:
    """The components of two states that are apart by more than the bound, with their distances,
    largest first.
    """
    parted = [k for k in np.argsort(-off).tolist() if off[k] > bound]
    if not parted:
        return ""
    against = f", bound {bound:.2g}" if bound else ""
    listed = ", ".join(f"component {k + 1} by {off[k]:.2g}" for k in parted[:LISTED_COMPONENTS])
    more = f" and {len(parted) - LISTED_COMPONENTS} more" if len(parted) > LISTED_COMPONENTS else ""
    return f"\napart: {listed}{more} (of {len(off)}){against}"


def _refused(
    own: Scheme, other: Scheme, case: Case, mine: tuple[int, Exception | None], its: tuple[int, Exception | None],
    tally: Tally,
) -> Measurement:  # fmt: skip
    """Judge steps of which one program refuses one, or both do;
    each is given as (number of steps made, error).
    """
    if mine[0] == its[0]:
        tally.both_refuse += 1
        return Measurement(0.0, 0.0, f"both refuse: {mine[1]}")
    (_, error), who, makes = (mine, own, other) if mine[0] < its[0] else (its, other, own)
    usual = case.h > 0 and not (beyond(case) or is_long(case) or may_be_refused(case))
    if isinstance(error, NotFinite) and usual:
        return Measurement(np.inf, 0.0, f"{makes.name} makes the step, and {error}")
    why = f"{who.name} refuses a step {'' if usual else 'of extreme size, or back in time, '}that {makes.name} makes"
    tally.alone[why] += 1
    example = f"{case.describe()}\n{str(error).partition(chr(10))[0]}"
    tally.shortest[why] = min(example, tally.shortest.get(why, example), key=len)
    raise Skipped(why) if usual else Unasked(why)


def _law(tally: Tally) -> Law:
    return searched(
        name="agreement",
        statement="the steps of two programs are the same, up to roundings and their solvers' tolerances",
        source="backward error",
        unit="ulp of y",
        middle=Middle.MAP,
        cases=Cases(damped=True),
        check=check_into(tally),
    )


def _run(own: Law, scheme: Scheme, this_run: Run) -> Finding:
    both, tally = pair(scheme), Tally()
    if isinstance(both, str):
        return own.finding(Verdict.NOT_APPLICABLE, message=both)
    assert both.twin is not None
    inner = _law(tally)
    finding = inner.run(own, both, this_run)
    named = f"{both.name} and {both.twin.scheme.name}"
    if finding.verdict not in (Verdict.HOLDS, Verdict.NOT_APPLICABLE):
        return replace(finding, message=f"{named}\n{finding.message}")
    text = f"{named}: {tally.words}"
    alone = sum(tally.alone.values())
    if not tally.steps and (tally.both_refuse or alone):
        return own.finding(Verdict.NOT_APPLICABLE, message=f"{text}\nno step was made by both", skipped=alone)
    if tally.steps < BOTH_MIN_SHARE * (tally.steps + alone):
        finding = replace(finding, verdict=Verdict.INCONCLUSIVE)
        text += f"\nboth make {tally.steps} of {tally.steps + alone} steps: too few for a verdict"
    return replace(finding, message=f"{text}\n{finding.message}".rstrip())


def _replay(own: Law, scheme: Scheme, witness: dict[str, Any]) -> Finding:
    both = pair(scheme)
    if isinstance(both, str):
        return own.finding(Verdict.NOT_APPLICABLE, message=both)
    return _law(Tally()).replay(own, both, witness)


law = replace(_law(Tally()), run=_run, replay=_replay)


def test_agreement(scheme: Scheme, effort: Effort) -> None:
    require(law, scheme, effort)
