"""The result of a run: the findings of its laws, counts, exit code, profiles, and JSON."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from sepv._arguments import did_you_mean
from sepv._version import __version__
from sepv.errors import UsageError, require_one_of
from sepv.files import finite
from sepv.law import Effort, Finding, Law, Verdict
from sepv.law.cases.case import has_words
from sepv.law.cases.users_problems import objects_of
from sepv.properties import load_laws
from sepv.schemes import NORMAL, OF_TWINS, Scheme, law_named, point_law
from sepv.verification._profiles import SUITE, Profiled, Requirement, missing, profiled


@dataclass(frozen=True, repr=False)
class Outcome:
    """The record of a run on one scheme; `Report`, which can be printed, documents its fields."""

    scheme: Scheme
    findings: tuple[Finding, ...]
    effort: Effort
    interrupted: bool = False
    pinned: frozenset[str] | None = None
    target: str = ""
    gaps: tuple[str, ...] = ()
    required: tuple[Requirement, ...] = ()
    pins: bool = False
    lost: str = ""

    @property
    def profiles(self) -> tuple[Profiled, ...]:
        """The profiles (sets of laws) whose laws were all measured, each with its result:
        found or not.
        """
        return profiled(self.findings)

    @property
    def missing(self) -> list[str]:
        """The required profiles (sets of laws) that were not found for the scheme,
        each with the reason.
        """
        return missing(self.profiles, self.required)

    @property
    def waived(self) -> tuple[str, ...]:
        """Laws that fail as expected."""
        return tuple(f.law for f in self.findings if f.waived)

    @property
    def problems(self) -> tuple[str, ...]:
        """The names of the scheme's problems, as given; empty for a whole class of systems,
        or if one has no name.
        """
        words = tuple(getattr(item, "text", "") for item in self.scheme.problems)
        return words if all(words) else ()

    @property
    def counts(self) -> dict[str, int]:
        """The number of laws with each verdict; the sum is the number of laws in the run.

        "not_measured" occurs only if the run was interrupted.
        """
        numbers = {v.value: sum(f.verdict is v for f in self.findings) for v in Verdict}
        if not numbers[Verdict.NOT_MEASURED.value]:
            del numbers[Verdict.NOT_MEASURED.value]
        return numbers

    @property
    def exit_code(self) -> int:
        """Exit code 0: claimed laws hold. 1: one does not, or an expected failure passes. 3: error.

        3 is also for a lost cluster, and 130 for Ctrl-C. The code is also 1 if a claimed law is
        inconclusive, if the scheme skipped all cases of a claimed law, if no law was measured, if a
        required profile was not found, or if a law is violated that the pin does not list.
        """
        if self.interrupted:
            return 3 if self.lost else 130
        if self.failing or self.missing:
            return 1
        if any(f.verdict is Verdict.ERROR for f in self.findings):
            return 3
        measured = (Verdict.HOLDS, Verdict.VIOLATED, Verdict.INCONCLUSIVE)
        return 0 if any(f.verdict in measured for f in self.findings) else 1

    @property
    def failing(self) -> tuple[Finding, ...]:
        """Findings for exit code 1: claims that do not hold, expected failures that pass,
        violations not in a pin.
        """
        return tuple(f for f in self.findings if fails(f, self.pinned))

    def finding(self, law: str) -> Finding:
        """The finding of one law.

        Raises
        ------
        UsageError
            For a law that is not in the report.
        """
        known, name = {f.law: f for f in self.findings}, law_named(str(law))
        remedy = "ask for one of these, or measure more laws"
        require_one_of("a law of this report", name, known, remedy, did_you_mean(law, known))
        return known[name]

    def replay(self, law: str) -> Finding:
        """Measure a law again, on the witness of its finding alone.

        Raises
        ------
        UsageError
            For a law that is not in the report, or whose finding has no witness, such as a law that
            holds.
        """
        finding = self.finding(law)
        if not finding.witness:
            raise UsageError(
                expected="a law with a witness, such as one that is violated",
                received=f"{finding.law}, which ended in: {finding.verdict.text}",
                remedy=f'measure it anew: sepv.verify(scheme, laws="{finding.law}")',
            )
        known: Law = load_laws([finding.law])[0]
        return replace(known.replay(known, self.scheme, finding.witness), claimed=finding.claimed)

    def again(self, finding: Finding) -> str:
        """The command that measures a finding again, or Python code if a command cannot name the
        scheme or problem.
        """
        if not finding.replay:
            return ""
        twin = self.scheme.twin if finding.law in OF_TWINS else None
        unnamed = twin is not None and not twin.words
        if self.target and not unnamed and (has_words(finding.witness) or self._own(finding)):
            return f"sepv verify {self.target} {finding.replay}"
        return f'report.replay("{finding.law}")  # in this Python process, with the report of sepv.verify(…)'

    def _own(self, finding: Finding) -> bool:
        """True if the target itself brings the problem of a witness,
        as one of `Scheme(…, problems=[…])`.
        """
        name = (finding.witness or {}).get("problem", {}).get("object")
        return [problem.name for problem in objects_of(self.scheme)].count(name) == 1

    def to_json(self) -> dict[str, Any]:
        """The report as a JSON object: suite, scheme, profiles, counts, laws."""
        scheme, effort, profiles = self.scheme, self.effort, self.profiles
        points, twin = point_law(scheme.increments), scheme.twin
        facts = ("mean_square_order", "weak_order", "order", "solver_tolerance", "truncation", "dtype")
        return {
            "suite": {
                "name": "sepv", "version": __version__, "laws_version": SUITE, "laws": len(self.findings),
                **{fact: getattr(effort, fact) for fact in EFFORT},
            },
            "scheme": {
                "name": scheme.name, "target": self.target, "source": scheme.source, "claims": sorted(scheme.claims),
                **{fact: getattr(scheme, fact) for fact in facts},
                "increments": NORMAL if points is None else points.name,
                **({"twin": {"name": twin.scheme.name, "target": twin.words, "bits": twin.bits}} if twin else {}),
            },
            "profiles": {
                "found": [p.name for p in profiles if not p.why],
                "not_found": {p.profile.name: p.why for p in profiles if p.why},
                "required": [r.name for r in self.required],
                "waived": list(self.waived),
            },
            "counts": self.counts,
            "laws": [_finding_json(f) for f in self.findings],
        }  # fmt: skip


# The fields of the effort in a report.
EFFORT = ("seed", "examples", "paths", "designs", "shrink_checks", "corpus")


def fails(f: Finding, pinned: frozenset[str] | None = None) -> bool:
    """True if a finding makes the exit code 1. With a pin (`pinned`),
    each violation that is not in the pin does so.
    """
    if f.verdict in (Verdict.ERROR, Verdict.NOT_MEASURED):
        return False  # errors and interrupts have other exit codes
    if f.expected is not None:
        return f.verdict is not Verdict.VIOLATED
    if not f.claimed:
        return pinned is not None and f.verdict is Verdict.VIOLATED
    # A law that is not applicable does not fail, unless the scheme skipped cases or the law held in
    # the pin.
    unasked = f.verdict is Verdict.NOT_APPLICABLE and not f.skipped and f.law not in (pinned or ())
    return f.verdict is not Verdict.HOLDS and not unasked


_TOLD_MEMBERS = (
    "law", "claimed", "verdict", "defect", "bound", "at_least", "unit", "source", "witness", "replay", "checks",
    "skipped", "share", "message", "expected", "seconds", "afresh", "power",
)  # fmt: skip


def _finding_json(finding: Finding) -> dict[str, Any]:
    fields = {key: getattr(finding, key) for key in _TOLD_MEMBERS}
    # A defect or an interval's end that is not finite becomes null: the message describes it.
    told: dict[str, Any] = finite(
        fields | {"verdict": finding.verdict.value, "seconds": round(finding.seconds, 3)}
    )
    return told
