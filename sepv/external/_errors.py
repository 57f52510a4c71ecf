"""What can be wrong with a program, one class for each way, and its text for a terminal or a page."""

from __future__ import annotations

from sepv._terminal import printable
from sepv.errors import SchemeFault, SepvError, StepFailure, TargetError
from sepv.problem import Array


class ProgramError(SepvError):
    """A program that does not keep the protocol; the base of all that end in the verdict "error"."""

    def __init__(self, *, expected: str, received: str, remedy: str, log: str = "") -> None:
        self.expected, self.received, self.remedy, self.log = expected, received, remedy, log
        tail = "\nThe end of its stderr:\n" + "\n".join(f"  | {s}" for s in log.splitlines()) if log else ""
        # Not super(): StartFailure is a TargetError too, whose own constructor says the same without the log.
        SepvError.__init__(self, f"Expected {expected}.\nReceived {received}.\nRemedy: {remedy}{tail}")


class StartFailure(ProgramError, TargetError):
    """A program that cannot be started."""


class CallTimeout(ProgramError):
    """No whole answer within the time of one call."""


class RunTimeout(ProgramError):
    """The time for the whole run is used up."""


class NeverReads(ProgramError):
    """The message was not read within the time of one call."""


class ProgramExit(ProgramError):
    """The program ended, crashed, or closed its input or output, where an answer was due."""


class LineTooLong(ProgramError):
    """More bytes than a line may have."""


class NotJson(ProgramError):
    """A line that is not JSON in UTF-8."""


class WrongId(ProgramError):
    """An answer that does not carry the id of its question."""


class BadAnswer(ProgramError):
    """JSON that is not an answer: keys missing, of the wrong type, or another protocol."""


class WrongShape(SchemeFault):
    """States of the wrong number or dimension."""


class NotFinite(SchemeFault):
    """A state with NaN, an infinity, or a number beyond binary64."""


class StepRefused(StepFailure):
    """The program answered "error": it says itself that this step cannot be made."""

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
    return clean(line.decode(errors="backslashreplace"), most)


def clean(text: str, most: int = 200) -> str:
    """A program's text for a terminal or a page: no control characters, not endless."""
    return printable(text[:most], kept="") + ("…" if len(text) > most else "")
