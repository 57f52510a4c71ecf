"""Errors of an external program, one class for each kind,
and functions that make its text safe to show.
"""

from __future__ import annotations

from sepv.console import printable
from sepv.errors import SchemeFault, SepvError, StepFailure, TargetError
from sepv.problem import Array


class ProgramError(SepvError):
    """A program does not keep the protocol. This is the base class of the errors with the verdict
    "error".
    """

    def __init__(self, *, expected: str, received: str, remedy: str, log: str = "") -> None:
        self.expected, self.received, self.remedy, self.log = expected, received, remedy, log
        tail = "\nThe end of its stderr:\n" + "\n".join(f"  | {s}" for s in log.splitlines()) if log else ""
        # Not super(), because StartFailure is a TargetError too, whose constructor writes the
        # message without the log.
        SepvError.__init__(self, f"Expected {expected}.\nReceived {received}.\nRemedy: {remedy}{tail}")


class StartFailure(ProgramError, TargetError):
    """A program cannot be started."""


class CallTimeout(ProgramError):
    """The program gave no complete answer within the time of one call."""


class RunTimeout(ProgramError):
    """The time for the whole run is used up."""


class NeverReads(ProgramError):
    """The program did not read the whole message within the time of one call."""


class ProgramExit(ProgramError):
    """The program ended, crashed, or closed its input or output before it answered."""


class LineTooLong(ProgramError):
    """A line of the program has more bytes than allowed."""


class NotJson(ProgramError):
    """A line of the program is not JSON in UTF-8."""


class WrongId(ProgramError):
    """An answer does not have the id of the message that it answers."""


class BadAnswer(ProgramError):
    """A JSON answer has missing keys, wrong types, or another protocol."""


class WrongShape(SchemeFault):
    """An answer has the wrong number of states, or the wrong dimension."""


class NotFiniteAnswer(SchemeFault):
    """A returned state has NaN, an infinity, or a number outside of the range of binary64."""


class StepRefused(StepFailure):
    """The program answered "error": it reports that this step cannot be made."""

    def __init__(self, *, problem: str, y: Array, delta: float, reason: str) -> None:
        self.problem, self.y, self.delta, self.reason = problem, y, delta, reason
        self.residual, self.status, self.iterations = float("nan"), reason, 0
        SepvError.__init__(
            self,
            f"The program could not make the step: {reason}\n"
            f"problem {problem}, y = {[float(v) for v in y]}, Δ = {delta!r}.\n"
            "Remedy: a smaller h, or a truncation of the increments (Remark 2.1).",
        )


def shown(line: bytes, most: int = 200) -> str:
    """Return a program's line as clean text for a message,
    in which bytes that are not UTF-8 are escaped.
    """
    return clean(line.decode(errors="backslashreplace"), most)


def clean(text: str, most: int = 200) -> str:
    """Return a program's text for a terminal or a page,
    without control characters and cut to `most` characters.
    """
    return printable(text[:most], allowed="") + ("…" if len(text) > most else "")
