"""Replay of counterexamples in a new process, which has made no other call of the scheme.

A step that keeps state between calls can violate a law after other calls, and obey the law in a first call. The report
then says "depends on earlier calls". One process replays all counterexamples, if it can import the scheme by name.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

from sepv.verification._cases.case import has_words
from sepv.verification._law import Finding, Verdict

# The new process is ended after this many seconds if it has not answered.
SECONDS = 60.0
_ANSWER = (
    "from sepv.verification import _fresh, _verify\n"  # `_verify` imports this file, which cannot import it
    "_fresh.answer(_verify.replay)"
)


def asked_afresh(target: Any, findings: Sequence[Finding], problems: Any = None) -> tuple[Finding, ...]:
    """The findings; for a violation, `Finding.afresh` is set to the verdict of a replay in a new process."""
    named = isinstance(target, str) and ":" in target and _words(problems)
    again = [f for f in findings if _may_be_replayed(f)] if named else []
    if not again:
        return tuple(findings)
    question = {
        "path": sys.path,
        "target": target,
        "problems": problems,
        "asked": [[f.law, f.witness] for f in again],
    }
    try:
        done = subprocess.run(
            [sys.executable, "-c", _ANSWER],
            input=json.dumps(question), capture_output=True, text=True, timeout=SECONDS, check=True,
        )  # fmt: skip
        verdicts = dict(zip((f.law for f in again), json.loads(done.stdout), strict=True))
    except (OSError, subprocess.SubprocessError, ValueError):
        return tuple(findings)
    return tuple(replace(f, afresh=verdicts.get(f.law, "")) for f in findings)


def _may_be_replayed(finding: Finding) -> bool:
    """True for a violation by a single step; the replay of a violation by sampled paths would take too long."""
    witness = finding.witness or {}
    return (
        finding.verdict is Verdict.VIOLATED
        and finding.expected is None
        and {"problem", "y"} <= set(witness)
        and has_words(witness)
    )


def _words(problems: Any) -> bool:
    listed = problems if isinstance(problems, list | tuple) else [problems]
    return problems is None or all(isinstance(p, str) for p in listed)


def answer(replay: Callable[..., Finding]) -> None:
    """Replay witnesses in the new process: read them from stdin, write verdicts to stdout. Schemes print to stderr."""
    out = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    question = json.load(sys.stdin)
    sys.path[:] = question["path"]
    witnesses = ((law, witness) for law, witness in question["asked"])
    findings = [replay(question["target"], law, witness, question["problems"]) for law, witness in witnesses]
    json.dump([f.verdict.value for f in findings], out)
    out.close()
