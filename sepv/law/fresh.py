"""Calls of a scheme in a new process: replays of counterexamples,
and steps that must have the same bits there.

A step that keeps state between calls can violate a law after other calls, and obey the law in a
first call. The report then says "depends on earlier calls". One process replays all
counterexamples, if it can import the scheme by name.

A step that depends on the process, such as on the order of a set, on `hash` or `id`, or on random
numbers at import, repeats in one process. The law *contract* therefore compares some steps with
those of a second process, in which PYTHONHASHSEED is another one. This process starts and imports
while the law measures (`SecondProcess`).
"""

from __future__ import annotations

import os
import pickle
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

from sepv.children import Child, NoLine
from sepv.errors import SepvError
from sepv.law._law import Finding, Run, Verdict
from sepv.law.cases.case import Case, from_json, has_words
from sepv.law.cases.users_problems import objects_of
from sepv.schemes import Scheme, Twin, ask

# The new process is ended after this many seconds if it has not answered.
FRESH_ANSWER_SECONDS = 60.0


@dataclass(frozen=True)
class FreshQuestion:
    """Questions to a new process about a scheme: pairs (law, witness) to replay,
    and witnesses whose step it makes.
    """

    target: str
    problems: Any
    replays: Sequence[tuple[str, Any]] = ()
    steps: Sequence[Any] = ()
    twin: Twin | None = None


def words_of(target: Any, problems: Any, worker: str) -> dict[str, Any]:
    """The words in `Run` of a scheme that a new process, of the module `worker`,
    can import by name; else no words.
    """
    named = isinstance(target, str) and ":" in target and _words(problems)
    return {"target": target, "problems": problems, "worker": worker} if named else {}


class SecondProcess:
    """A process with another PYTHONHASHSEED that imports a scheme,
    then makes the steps of some cases.
    """

    def __init__(self, run: Run) -> None:
        self.question, self.child = FreshQuestion(run.target, run.problems), None
        other = "2" if os.environ.get("PYTHONHASHSEED") == "1" else "1"
        with suppress(OSError):
            self.child = _process(run.worker, PYTHONHASHSEED=other)

    child: Child | None

    def steps(self, witnesses: Sequence[dict[str, Any]]) -> list[list[str] | None]:
        """y1 of each case in hexadecimal digits, or None for a step that failed;
        [] if the process did not answer.
        """
        return _answered(self.child, replace(self.question, steps=witnesses)) if self.child else []

    def end(self) -> None:
        """End the process, if it has not ended, with what the scheme left running there."""
        if self.child:
            self.child.end()


def asked_afresh(
    target: Any, findings: Sequence[Finding], worker: str, problems: Any = None, twin: Twin | None = None
) -> tuple[Finding, ...]:
    """The findings; for a violation, `Finding.afresh` is set to the verdict of a replay in a new
    process.

    `worker` is the module of that process.
    """
    named = words_of(target, problems, worker) and (twin is None or isinstance(twin.scheme, str))
    again = [f for f in findings if _may_be_replayed(f)] if named else []
    verdicts: dict[str, str] = {}
    if again:
        with suppress(OSError):
            replays = [(f.law, f.witness) for f in again]
            answered = _answered(_process(worker), FreshQuestion(target, problems, replays, twin=twin))
            verdicts = dict(zip((f.law for f in again), answered, strict=False))
    return tuple(replace(f, afresh=verdicts.get(f.law, f.afresh)) for f in findings)


def answers(
    question: FreshQuestion, load: Callable[..., Scheme], replay: Callable[..., Finding]
) -> list[Any]:
    """In the new process: the verdicts of the replays, then the steps."""
    target, problems = question.target, question.problems
    verdicts = [
        replay(target, law, witness, problems, question.twin).verdict.value
        for law, witness in question.replays
    ]
    if not question.steps:
        return verdicts
    scheme = load(target, (), problems)
    return verdicts + [step_in_digits(scheme, from_json(w, objects_of(scheme))) for w in question.steps]


def step_in_digits(scheme: Scheme, case: Case) -> list[str] | None:
    """y1 of a case in hexadecimal digits; None if the step fails."""
    with suppress(SepvError):
        return [v.hex() for v in ask(scheme, *case.build()).tolist()]
    return None


def _process(worker: str, **environment: str) -> Child:
    return Child.of_module(worker, log=True, environment=environment)


def _answered(child: Child, question: FreshQuestion) -> list[Any]:
    """The new process's answers; [] if none came. The process is ended."""
    try:
        kind, answer = child.ask((sys.path, os.getcwd(), pickle.dumps(question)), FRESH_ANSWER_SECONDS)
    except NoLine:
        return []
    finally:
        child.end()
    return list(answer) if kind == "answers" else []


def _may_be_replayed(finding: Finding) -> bool:
    """True for a violation by a single step; the replay of a violation by sampled paths would take
    too long.
    """
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
