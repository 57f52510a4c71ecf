"""The log of a search over single steps, and the finding that follows from the log."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import cache, partial
from typing import Any

from sepv.console import counted
from sepv.errors import SepvError, StepFailure
from sepv.law._law import Finding, Law, Measurement, Verdict
from sepv.law.advice import advice
from sepv.law.cases import case as cases_of
from sepv.law.cases.case import Case
from sepv.law.power_of_h import least_power, words
from sepv.schemes import Scheme

Check = Callable[[Scheme, Case], Measurement]
# The share of a law's cases that must be measured if the scheme states its longest step, or if the
# law says nothing of the others. No share is required of a scheme that skips cases because of their
# problems: it may be made for few problems. If one case shows that a law says nothing of the
# scheme, its premise is asked first (`sepv.law.search`).
MEASURED_MIN_SHARE = 0.25


class SearchLog:
    """The log of one search: number of measurements, the worst,
    a violation or an unmeasurable case, skipped cases.
    """

    def __init__(self) -> None:
        self.checks = 0
        self.worst: Measurement | None = None
        self.violation: tuple[Case, Measurement] | None = None
        self.found: tuple[Case, Measurement] | None = None  # the first violation, before simplification
        self.largest = 0.0  # defect of the violation, before simplification
        self.fault: tuple[Case, Exception] | None = None
        self.crash: tuple[Case, Exception] | None = None  # a fault that no violation may hide
        self.skipped: dict[str, int] = {}
        self.unasked = 0  # skipped cases of which the law says nothing
        self.lacking = 0  # skipped cases that every scheme for the class must take
        self.share: float | None = None  # the measured share of the design, if cases were left out

    @property
    def failed(self) -> bool:
        """True if a case violated the law or could not be measured."""
        return self.violation is not None or self.fault is not None

    @property
    def refused(self) -> int:
        """The number of cases that the scheme refused."""
        return sum(self.skipped.values())

    def skip(self, reason: str, *, may: bool = False) -> None:
        """Log a case that was skipped; `may` is True if a correct scheme may refuse this case."""
        self.checks -= 1
        self.lacking += not may
        self.skipped[reason] = self.skipped.get(reason, 0) + 1


def conclude(law: Law, scheme: Scheme, log: SearchLog, check: Check) -> Finding:
    """The finding of a finished search. A violation gets advice on its cause,
    for which `check` measures more cases.
    """
    seen: dict[str, Any] = {"checks": log.checks}
    # The defect is that of the simplified witness; before simplification it may have been larger.
    measured = log.worst if log.violation is None else log.violation[1]
    if measured:
        seen |= {"defect": measured.defect, "bound": measured.bound}
    if log.violation is not None:
        case, measured = log.violation
        # Without noise both kinds of advice halve the same step, which is measured once.
        again = cache(partial(_measured_again, scheme, check))
        hints = advice(law, scheme, case, measured, log.largest, again)
        if law.preserves:
            seen["power"] = least_power([log.violation, log.found], again)
            hints += f"\n{words(seen['power'])}"
        message = f"{case.describe()}\n{measured.detail}{hints}"
        if log.crash is None:
            return law.finding(Verdict.VIOLATED, message=message, **_witness(law, case), **seen)
        # The crash decides the verdict: a scheme that does not always return was not measured
        # completely.
        dead, error = log.crash
        again = _witness(law, dead)["replay"]
        message = (
            f"crashed:\n{dead.describe()}\n{error}\nIts replay: {again}\nviolated, elsewhere:\n{message}"
        )
        seen["traceback"] = getattr(error, "traceback", "")
        return law.finding(Verdict.ERROR, message=message, **_witness(law, case), **seen)
    if log.fault is not None:
        case, error = log.fault
        kind = "not solved" if isinstance(error, StepFailure) else "not measured"
        seen |= {
            "message": f"{kind}:\n{case.describe()}\n{error}",
            "traceback": getattr(error, "traceback", ""),
        }
        return law.finding(Verdict.ERROR, **_witness(law, case), **seen)
    skipped = "\n".join(f"{counted(n, 'case')} skipped: {reason}" for reason, n in log.skipped.items())
    if log.checks <= MEASURED_MIN_SHARE * (log.checks + log.unasked):
        verdict = Verdict.NOT_APPLICABLE if skipped else Verdict.ERROR
        refused = 0 if log.unasked else log.refused
        return law.finding(verdict, message=skipped or "no case was measured", skipped=refused)
    verdict = Verdict.HOLDS
    if log.share is not None and log.share < MEASURED_MIN_SHARE and scheme.longest_step is not None:
        verdict = Verdict.INCONCLUSIVE
        few = f"only {100 * log.share:.0f} % of the cases were measured"
        skipped = f"{few}: a law holds on {100 * MEASURED_MIN_SHARE:.0f} % at least\n{skipped}"
    return law.finding(verdict, message=skipped, skipped=log.refused, share=log.share, **seen)


def _witness(law: Law, case: Case) -> dict[str, Any]:
    replay = f"--law {law.name} --replay {cases_of.to_token(case)}"
    return {"witness": cases_of.to_json(case), "replay": replay}


def _measured_again(scheme: Scheme, check: Check, case: Case) -> Measurement | None:
    """The measurement of a further case that advice needs;
    None if the scheme or the law raises an error.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            return check(scheme, case)
        except (SepvError, ArithmeticError):
            return None
