"""Calls of a scheme in a new process: replays of counterexamples, and steps that must have the same bits there.

A step that keeps state between calls can violate a law after other calls, and obey the law in a first call. The report
then says "depends on earlier calls". One process replays all counterexamples, if it can import the scheme by name.

A step that depends on the process, such as on the order of a set, on `hash` or `id`, or on random numbers at import,
repeats in one process. The law *contract* therefore compares some steps with those of a second process, in which
PYTHONHASHSEED is another one. This process starts and imports while the law measures (`SecondProcess`).
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

from sepv.errors import SepvError
from sepv.schemes import Scheme, Twin, ask
from sepv.verification._cases.case import Case, from_json, has_words
from sepv.verification._cases.users_problems import objects_of
from sepv.verification._law import Finding, Verdict

# The new process is ended after this many seconds if it has not answered.
SECONDS = 60.0
_ANSWER = (
    "from sepv.verification import _fresh, _verify\n"  # `_verify` imports this file, which cannot import it
    "_fresh.answer(_verify.replay)"
)
_STEPS = _ANSWER.replace("answer(_verify.replay)", "make_steps(_verify.load_candidate)")


def words_of(target: Any, problems: Any) -> dict[str, Any]:
    """The `Run.target` and `Run.problems` of a scheme that a new process can import by name; else no words."""
    named = isinstance(target, str) and ":" in target and _words(problems)
    return {"target": target, "problems": problems} if named else {}


class SecondProcess:
    """A process with another PYTHONHASHSEED that imports a scheme, then makes the steps of some cases."""

    def __init__(self, target: str, problems: Any) -> None:
        other = "2" if os.environ.get("PYTHONHASHSEED") == "1" else "1"
        self.process = subprocess.Popen(
            [sys.executable, "-c", _STEPS], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
            text=True, env={**os.environ, "PYTHONHASHSEED": other},
        )  # fmt: skip
        self.question = {"path": sys.path, "target": target, "problems": problems}

    def steps(self, witnesses: Sequence[dict[str, Any]]) -> list[list[str] | None]:
        """y1 of each case in hexadecimal digits, or None for a step that failed; [] if the process did not answer."""
        try:
            answer, _ = self.process.communicate(
                json.dumps({**self.question, "asked": witnesses}), timeout=SECONDS
            )
            return list(json.loads(answer))
        except (OSError, subprocess.SubprocessError, ValueError):
            return []
        finally:
            self.end()

    def end(self) -> None:
        """End the process, if it has not ended, and close its pipes."""
        self.process.kill()
        self.process.wait()
        for pipe in (self.process.stdin, self.process.stdout):
            if pipe is not None:
                with suppress(OSError):  # what was not yet sent to an ended process
                    pipe.close()


def asked_afresh(
    target: Any, findings: Sequence[Finding], problems: Any = None, twin: Twin | None = None
) -> tuple[Finding, ...]:
    """The findings; for a violation, `Finding.afresh` is set to the verdict of a replay in a new process."""
    named = words_of(target, problems) and (twin is None or isinstance(twin.scheme, str))
    again = [f for f in findings if _may_be_replayed(f)] if named else []
    if not again:
        return tuple(findings)
    question = {
        "path": sys.path,
        "target": target,
        "problems": problems,
        "twin": twin and [twin.scheme, twin.bits],
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
    return tuple(replace(f, afresh=verdicts.get(f.law, f.afresh)) for f in findings)


def _may_be_replayed(finding: Finding) -> bool:
    """True for a violation by a single step; the replay of a violation by sampled paths would take too long."""
    witness = finding.witness or {}
    return (
        finding.verdict is Verdict.VIOLATED
        and not finding.afresh  # a second process has shown it already
        and finding.expected is None
        and {"problem", "y"} <= set(witness)
        and has_words(witness)
    )


def _words(problems: Any) -> bool:
    listed = problems if isinstance(problems, list | tuple) else [problems]
    return problems is None or all(isinstance(p, str) for p in listed)


def answer(replay: Callable[..., Finding]) -> None:
    """Replay witnesses in the new process: read them from stdin, write verdicts to stdout. Schemes print to stderr."""

    def verdicts(question: Any) -> list[str]:
        target, problems = question["target"], question["problems"]
        twin = question["twin"] and Twin(*question["twin"])
        return [
            replay(target, law, witness, problems, twin).verdict.value for law, witness in question["asked"]
        ]

    _answered(verdicts)


def make_steps(load: Callable[..., Scheme]) -> None:
    """Make the steps of cases in the new process; `load` loads the scheme."""

    def steps(question: Any) -> list[list[str] | None]:
        scheme = load(question["target"], (), question["problems"])
        return [step_in_digits(scheme, from_json(data, objects_of(scheme))) for data in question["asked"]]

    _answered(steps)


def step_in_digits(scheme: Scheme, case: Case) -> list[str] | None:
    """y1 of a case in hexadecimal digits; None if the step fails."""
    with suppress(SepvError):
        return [v.hex() for v in ask(scheme, *case.build()).tolist()]
    return None


def _answered(reply: Callable[[Any], Any]) -> None:
    out = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    question = json.load(sys.stdin)
    sys.path[:] = question["path"]
    json.dump(reply(question), out)
    out.close()
