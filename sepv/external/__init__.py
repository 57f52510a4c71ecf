"""Schemes in other languages: a long-lived child process that speaks JSON lines (docs/protocol.md).

One thread and non-blocking pipes: nothing here waits without a deadline, for reading or for writing, so a
child that never answers, or never reads, cannot stop the suite. Whatever goes wrong in an exchange ends the
whole process group; the next call starts a fresh one, so that a case that crashes can still be shrunk.
"""

from __future__ import annotations

from sepv.external._check import Check as Check
from sepv.external._check import check_protocol as check_protocol
from sepv.external._check import describe as describe
from sepv.external._errors import ProgramError as ProgramError
from sepv.external._program import Program as Program
from sepv.external._program import load_program as load_program
