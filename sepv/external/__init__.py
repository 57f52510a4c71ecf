"""Schemes in other languages: a long-lived child process that speaks JSON lines (docs/protocol.md).

One thread and non-blocking pipes: every read and write has a deadline, so a child that never answers, or never reads,
cannot stop the suite. Any failure of an exchange ends the whole process group. The next call starts a fresh one, so a
case that crashes can still be shrunk.
"""

from __future__ import annotations

from sepv.external._check import Check as Check
from sepv.external._check import check_protocol as check_protocol
from sepv.external._check import describe as describe
from sepv.external._errors import ProgramError as ProgramError
from sepv.external._program import Program as Program
from sepv.external._program import load_program as load_program
