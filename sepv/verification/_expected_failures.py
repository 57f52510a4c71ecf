"""A TOML file of claims and of known violations of a scheme;
a run fails on new violations and on repaired ones.

    scheme = "mypkg.mymodule:step"     # the scheme; a run with another scheme gets a note
    claims = ["contract", "casimir"]   # laws that must hold, unless the scheme states its claims
    measured = ["contract", "casimir", "energy", "weak-order"]   # measured for the file
    problems = ["rigid-body"]          # the scheme's problems, for a run without -p

    [[expected]]                       # a law that the scheme is known to break
    law = "energy"
    reason = "B is taken at y_n in the drift"
    witness = "eNp1j88K…"              # as printed after --replay; or a table { seed, paths }

A known violation is measured on its witness (the stored counterexample) and not searched for. So it
needs only one measurement and never fails by chance. The run fails if a claimed law that is not
listed is violated, or if a listed law is no longer violated. A file with ``claims`` is a pin, a
record of the laws as they were measured (`pin`). With a pin even a violation of an unclaimed law
must be listed, and the report names laws that were not measured for the pin.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from sepv._arguments import did_you_mean
from sepv.errors import UsageError, require_one_of
from sepv.files import read_bounded
from sepv.law import Finding, Verdict
from sepv.law.cases import case as cases
from sepv.schemes import law_named

_ENTRY = {"law", "reason", "witness"}
# The largest effort that a witness of a statistical law may state, eight times the nightly effort.
_MAX_EFFORT = {"paths": 2**17, "examples": 8000}
_FAILURE_KEYS = {"expected", "claims", "measured", "scheme", "problems"}
_EXAMPLE = '[[expected]] with law = "…", reason = "…", witness = "…"; `--pin FILE` makes a first one'


@dataclass(frozen=True)
class ExpectedFailure:
    """One entry of a file of expected failures: the law, the reason why it fails,
    and a counterexample as JSON.
    """

    law: str
    reason: str
    witness: dict[str, Any]


@dataclass(frozen=True)
class Expectations:
    """The contents of a file of expected failures: claims, failures, measured laws,
    the scheme and its problems.

    A value that the file does not state is None or empty.
    """

    claims: frozenset[str] | None = None
    failures: dict[str, ExpectedFailure] = field(default_factory=dict)
    measured: frozenset[str] | None = None
    scheme: str | None = None
    problems: tuple[str, ...] = ()

    @property
    def is_pin(self) -> bool:
        """True if the file is a pin, which must list every violation,
        also of laws that the scheme does not claim.
        """
        return self.claims is not None

    def gaps(self, laws: Iterable[str], scheme: str, problems: Iterable[str] = ()) -> list[str]:
        """Sentences about a run that differs from the file: in the scheme, in the problems,
        or in the laws measured.
        """
        measured, guarded, gaps = list(laws), {*self.failures, *(self.claims or ())}, []
        if self.scheme is not None and self.scheme != scheme:
            gaps.append(
                f"The file of --expected was written for {_line(self.scheme)}, and this is {_line(scheme)}: "
                f"where it is the same scheme, write scheme = {_quoted(scheme)} there, else --pin a file of its own."
            )
        if self.problems and {*problems} != {*self.problems}:
            now = ", ".join(map(_line, problems)) or "every system"
            gaps.append(f"The pin is about {', '.join(map(_line, self.problems))}, and this run about {now}.")
        known = None if self.measured is None else self.measured | guarded
        new = [law for law in measured if known is not None and law not in known]
        kinds = (
            ("Not in the pin, which was written without them", new),
            ("In the pin and not measured now", sorted(guarded - set(measured)) if self.is_pin else ()),
        )
        return gaps + [f"{words}: {', '.join(which)}." for words, which in kinds if which]


def load(path: str | Path, laws: Iterable[str]) -> Expectations:
    """Read a file of claims and expected failures; `laws` are the names of all laws.

    Raises a UsageError for a file that is missing or not TOML, an unknown or repeated law, a
    missing reason or witness, or a law that is both claimed and expected to fail.
    """
    try:
        data = tomllib.loads(read_bounded(path).decode())
    except OSError as error:
        raise UsageError(
            expected="a file of expected failures", received=f"{path}: {error.strerror}", remedy=_EXAMPLE
        ) from error
    except (ValueError, RecursionError) as error:
        raise UsageError(expected=f"TOML in {path}", received=str(error), remedy=_EXAMPLE) from error
    entries = data.get("expected", [])
    if set(data) - _FAILURE_KEYS or not isinstance(entries, list):
        raise UsageError(
            expected=f"claims and tables [[expected]] in {path}",
            received=f"keys {sorted(data)}",
            remedy=_EXAMPLE,
        )
    known, failures = tuple(laws), dict[str, ExpectedFailure]()
    for number, entry in enumerate(entries, start=1):
        failure = _entry(entry, f"{path}, entry {number}", known)
        if failure.law in failures:
            raise UsageError(
                expected="each law once", received=f"{failure.law!r} twice in {path}", remedy="keep one entry"
            )
        failures[failure.law] = failure
    claims, measured = (_names(key, data.get(key), str(path), known) for key in ("claims", "measured"))
    both = sorted((claims or frozenset()) & set(failures))
    if both:
        raise UsageError(
            expected=f"each law of {path} either claimed or expected to fail",
            received=f"both: {', '.join(both)}",
            remedy="a law that the scheme breaks is no claim: take it out of claims",
        )
    scheme = data.get("scheme")
    if not isinstance(scheme, str | None):
        raise UsageError(
            expected=f"scheme in {path}, a name in quotes",
            received=f"{scheme!r}",
            remedy="correct it, or leave it out",
        )
    problems = data.get("problems", [])
    if not isinstance(problems, list) or not all(isinstance(p, str) for p in problems):
        raise UsageError(
            expected=f"problems in {path}, a list of names as -p takes them",
            received=f"{problems!r:.80}",
            remedy="correct it, or write the file anew with --pin",
        )
    return Expectations(claims, failures, measured, scheme, tuple(problems))


def _names(key: str, value: Any, path: str, known: tuple[str, ...]) -> frozenset[str] | None:
    if value is None:
        return None
    remedy = "correct the names, or write the file anew with --pin"
    if not isinstance(value, list):
        raise UsageError(expected=f"{key} in {path}, a list of laws", received=f"{value!r}", remedy=remedy)
    names = frozenset(law_named(name) if isinstance(name, str) else name for name in value)
    for name in names:
        require_one_of(f"{key} in {path}, a list of laws", name, known, remedy, did_you_mean(name, known))
    return names


def _entry(entry: Any, where: str, known: tuple[str, ...]) -> ExpectedFailure:
    if not isinstance(entry, dict) or set(entry) != _ENTRY:
        keys = sorted(entry) if isinstance(entry, dict) else type(entry).__name__
        raise UsageError(expected=f"law, reason and witness in {where}", received=f"{keys}", remedy=_EXAMPLE)
    law, reason, witness = entry["law"], entry["reason"], entry["witness"]
    law = law_named(law) if isinstance(law, str) else law
    require_one_of(f"a law in {where}", law, known, received=did_you_mean(law, known))
    if not isinstance(reason, str) or not reason.strip():
        raise UsageError(
            expected=f"a reason in {where}", received=repr(reason), remedy="say why this failure is expected"
        )
    try:
        if isinstance(witness, str):
            witness = cases.witness_of(witness)
        elif isinstance(witness, dict) and "problem" in witness:
            cases.require_witness(witness)
        elif not isinstance(witness, dict) or not all(_drawn(k, v) for k, v in witness.items()):
            raise UsageError(
                expected="a token, or a table of integers such as { seed = 0, paths = 8192 } with "
                + ", ".join(f"{key} ≤ {most}" for key, most in _MAX_EFFORT.items()),
                received=f"{witness!r:.60}",
                remedy="copy what the report prints after --replay",
            )
    except UsageError as error:
        raise UsageError(
            expected=f"a witness in {where}: {error.expected}", received=error.received, remedy=error.remedy
        ) from error
    return ExpectedFailure(law, reason, witness)


def _drawn(key: str, value: Any) -> bool:
    """True if a witness of a statistical law may have `key` = `value`;
    _MAX_EFFORT bounds the work of its replay.
    """
    return type(value) is int and 0 <= value <= _MAX_EFFORT.get(key, value)


def to_toml(scheme: str, findings: Iterable[Finding]) -> str:
    """Text of a new file of expected failures, which lists the violated claimed laws;
    a person adds the reasons.

    A violation of an unclaimed law is no failure and is not listed: if a scheme later obeys the
    law, no build may fail.
    """
    listed = [f for f in findings if f.claimed or f.expected is not None]
    entries = _entries(f for f in listed if f.verdict is Verdict.VIOLATED)
    title = f"# Expected failures of {_line(scheme)}. Replace each reason by yours."
    lines = [title, f"scheme = {_quoted(scheme)}", *(entries or ["# No claimed law is violated."])]
    return "\n".join(lines) + "\n"


def pin(scheme: str, findings: Iterable[Finding], problems: Iterable[str] = ()) -> str:
    """Text of a pin, a file that records a run: laws that hold become claims,
    and violations are listed.

    A law that neither holds nor is violated is listed under `measured` alone, so this pin does not
    guard it.
    """
    measured = [f for f in findings if f.verdict is not Verdict.NOT_MEASURED]
    held = [f.law for f in measured if f.verdict is Verdict.HOLDS]
    lines = [
        f"# What sepv found of {_line(scheme)}: these laws must hold from now on, and the violations below stay as",
        "# they are. Both ways: a law that breaks turns the run red, and so does one that no longer fails.",
        f"scheme = {_quoted(scheme)}",
        f"claims = [{', '.join(_quoted(law) for law in held)}]",
        "# All that were asked for: a law that is not here is named when it is measured.",
        f"measured = [{', '.join(_quoted(f.law) for f in measured)}]",
    ]
    if problems := list(problems):
        lines += ["# What the scheme is for: a run without -p takes these."]
        lines += [f"problems = [{', '.join(map(_quoted, problems))}]"]
    return "\n".join([*lines, *_entries(f for f in measured if f.verdict is Verdict.VIOLATED)]) + "\n"


def _entries(findings: Iterable[Finding]) -> list[str]:
    lines = []
    for f in findings:
        sized = f.defect is not None and f.bound is not None
        size = f": {f.defect:.3g} {f.unit} against {f.bound:.3g}" if sized else ""
        reason = _quoted(f.expected or "violated when this file was written" + size)
        entry = f"law = {_quoted(f.law)}", f"reason = {reason}", f"witness = {_witness(f.witness or {})}"
        lines += ["", "[[expected]]", *entry]
    return lines


def _witness(witness: dict[str, Any]) -> str:
    if "problem" in witness:
        return _quoted(cases.to_token(cases.from_json(witness)))
    numbers = {k: v for k, v in witness.items() if isinstance(v, int)}
    return "{ " + ", ".join(f"{k} = {v}" for k, v in numbers.items()) + " }"


def _quoted(text: str) -> str:
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return '"' + "".join(c if c.isprintable() else f"\\U{ord(c):08x}" for c in escaped) + '"'


def _line(text: str) -> str:
    return "".join(c if c.isprintable() else " " for c in text)
