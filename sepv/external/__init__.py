"""The door for other languages: a long-lived child process that speaks JSON lines (docs/protocol.md).

One thread and non-blocking pipes: nothing here waits without a deadline, for reading or for writing, so a
child that never answers, or never reads, cannot stop the suite. Whatever goes wrong in an exchange ends the
whole process group; the next call starts a fresh one, so that a case that crashes can still be shrunk.
"""

from __future__ import annotations

from sepv.errors import Skipped as Skipped
from sepv.external.check import Check as Check
from sepv.external.check import check_protocol as check_protocol
from sepv.external.check import describe as describe
from sepv.external.errors import BadAnswer as BadAnswer
from sepv.external.errors import CallTimeout as CallTimeout
from sepv.external.errors import LineTooLong as LineTooLong
from sepv.external.errors import NeverReads as NeverReads
from sepv.external.errors import NotFinite as NotFinite
from sepv.external.errors import NotJson as NotJson
from sepv.external.errors import ProgramError as ProgramError
from sepv.external.errors import ProgramExit as ProgramExit
from sepv.external.errors import RunTimeout as RunTimeout
from sepv.external.errors import StartFailure as StartFailure
from sepv.external.errors import StepRefused as StepRefused
from sepv.external.errors import WrongId as WrongId
from sepv.external.errors import WrongShape as WrongShape
from sepv.external.messages import Hello as Hello
from sepv.external.program import Program as Program
from sepv.external.program import load_program as load_program
