"""A second measurement of another person's report, on the reader's scheme:
all counterexamples and some of the laws.

The report is not trusted: nothing that it names is loaded or run, and none of its text is shown. It
cannot cause more work than the reader allows, because its effort is cut to the reader's, a schema
bounds its witnesses (the stored counterexamples), and all witnesses share the time limit of one
law.
"""

from __future__ import annotations

import math
import random
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from sepv.errors import UsageError
from sepv.files import fault, finite, made, read_json, require_schema, schema
from sepv.law import Effort, Run, Verdict
from sepv.properties import load_laws, renamed
from sepv.schemes import Scheme
from sepv.verification._expected_failures import ExpectedFailure
from sepv.verification._outcome import EFFORT
from sepv.verification._profiles import SUITE
from sepv.verification._verify import measure

# The largest file in bytes: a report of all laws has 30 kB, a witness of 64 dimensions 2 MB; more
# takes long to check.
REPORT_MAX_BYTES = 2**22
# The most numbers in B′ for a witness's batch (2^27 bytes; sepv's have a hundredth), and the
# largest degree of H.
_MOST_NUMBERS, _MOST_DEGREE = 2**24, 64
# The share of the laws that is measured again; at least one law is.
MEASURED_AGAIN_SHARE = 0.25
# The bits of a defect depend on these: if one differs, or is not in the report, only verdicts are
# compared.
_BITS = ("sepv", "python", "numpy", "scipy", "hypothesis", "mpmath", "platform", "simd")
_FACTS = ("mean_square_order", "weak_order", "order", "solver_tolerance", "truncation")


@dataclass(frozen=True)
class Again:
    """One repeated measurement: the result, and its difference from the report (empty if there is
    none).
    """

    what: str
    came: str
    differs: str = ""


def read_report(path: str | Path) -> dict[str, Any]:
    """Read a report of ``sepv verify --json``; a UsageError if it contradicts itself or is of
    another suite version.
    """
    words = {"expected": "a report of `sepv verify --json`", "remedy": "write it with this version of sepv"}
    report: dict[str, Any] = read_json(path, REPORT_MAX_BYTES, **words)
    require_schema(report, "report", path, **words)
    names, suite = [f["law"] for f in report["laws"]], report["suite"]
    counts = {v.value: sum(f["verdict"] == v.value for f in report["laws"]) for v in Verdict}
    wrong = ""
    if suite.get("laws_version") != SUITE:
        wrong = f"suite version {suite.get('laws_version')}, and this is {SUITE}"
    elif len(set(names)) != len(names) or suite["laws"] != len(names):
        wrong = "a law twice, or not as many laws as it says"
    elif counts != dict.fromkeys(counts, 0) | report["counts"]:
        wrong = "counts that are not those of its laws"
    if wrong:
        raise UsageError(received=f"{path}: {wrong}", **words)
    load_laws(names)
    present: dict[str, Any] = renamed(report)
    return present


def against(
    report: dict[str, Any], scheme: Scheme, allowed: Effort, timeout: float = 600.0, laws: Iterable[str] = ()
) -> Iterator[Again]:
    """Replay each counterexample of a report, and measure again `laws` or else a random quarter of
    the report's laws.

    The author of the report cannot know which quarter is drawn. Verdicts must agree with the
    report. Defects must agree to the last digit if effort, versions and kind of processor are those
    of the report.

    Parameters
    ----------
    report : dict
        The result of `read_report`.
    scheme : Scheme
        The scheme as the reader loaded it, with its problems.
    allowed : Effort
        The largest effort that is allowed; it is used if the report states a larger effort.
    timeout : float
        The most seconds for one law, and for all counterexamples together.
    """
    facts = {key: (report["scheme"].get(key), getattr(scheme, key)) for key in _FACTS}
    facts["dtype"] = (report["scheme"].get("dtype", "float64"), scheme.dtype)
    other = [
        f"{key} {measured}, reported {stated}"
        for key, (stated, measured) in facts.items()
        if measured != stated
    ]
    yield Again("what the scheme states", "the same" * (not other), ", ".join(other))
    stated = {key: report["suite"][key] for key in EFFORT if key in report["suite"]}
    cut = {k: v if k in ("seed", "corpus") else min(v, getattr(allowed, k)) for k, v in stated.items()}
    effort, theirs, here = replace(allowed, **cut), report.get("made", {}), made("report")
    bits = len(stated) == len(EFFORT) and cut == stated and all(theirs.get(k) == here[k] for k in _BITS)
    reported = {f["law"]: f for f in report["laws"] if f["verdict"] != Verdict.NOT_MEASURED.value}
    run, end = Run(effort), time.monotonic() + timeout
    for name, f in reported.items():
        if f["verdict"] == Verdict.VIOLATED.value and f["witness"] is not None:
            yield _counterexample(name, f["witness"], scheme, run, end - time.monotonic())
    searched = [name for name, f in reported.items() if f["expected"] is None]
    drawn = random.SystemRandom().sample(searched, math.ceil(MEASURED_AGAIN_SHARE * len(searched)))
    for law in load_laws(set(laws or drawn) & set(searched)):
        finding, wanted = measure(law, scheme, run, timeout), reported[law.name]
        differs = (
            ""
            if finding.verdict.value == wanted["verdict"]
            else f"reported {Verdict(wanted['verdict']).text}"
        )
        if bits and not differs and finite(finding.defect) != wanted["defect"]:
            differs = f"a defect of {finding.defect}, reported {wanted['defect']}"
        yield Again(law.name, finding.verdict.text, differs)


def _counterexample(law: str, witness: Any, scheme: Scheme, run: Run, seconds: float) -> Again:
    """Replay a counterexample of the report, unless it needs too much work,
    or code that this run did not name.
    """
    what, wrong = f"counterexample of {law}", _too_much(witness, scheme, run.effort)
    if wrong or seconds <= 0:
        return Again(what, "not replayed", wrong or "no time is left (--timeout)")
    try:
        failure = ExpectedFailure(law, "reported", witness)
        finding = measure(load_laws([law])[0], scheme, run, seconds, failure)
    except UsageError as error:
        return Again(what, "not replayed", error.received)
    return Again(
        what, finding.verdict.text, "" if finding.verdict is Verdict.VIOLATED else "reported violated"
    )


def _too_much(witness: dict[str, Any], scheme: Scheme, effort: Effort) -> str:
    """The reason not to replay a witness: unnamed code, a wrong form, or too much work.
    Empty if there is none.
    """
    if "problem" not in witness:
        most = {"paths": effort.paths, "examples": effort.examples, "seed": 2**128}
        sizes = {key: witness[key] for key in most if key in witness}
        over = [k for k, n in sizes.items() if type(n) is not int or not 0 <= n <= most[k]]
        return ", ".join(f"{k} is no number from 0 to {most[k]} (--deep allows more)" for k in over)
    if wrong := fault(witness, schema("witness")):
        return wrong
    problem = witness["problem"]
    if ":" in problem.get("given", "") and problem["given"] not in {
        getattr(p, "text", p) for p in scheme.problems
    }:
        return f"its problem {problem['given']!r:.80} is code: add -p with it where you trust it"
    degree = max((k for exponents, _ in problem.get("hamiltonian", ()) for k in exponents), default=0)
    if len(witness["y"]) ** 3 * witness.get("batch", 0) > _MOST_NUMBERS or degree > _MOST_DEGREE:
        return f"a batch or a degree that is more than {_MOST_NUMBERS} numbers or {_MOST_DEGREE}"
    return ""
