"""Schemes in other languages: a child process that answers JSON lines (docs/protocol.md)
until it is stopped.

With one thread and non-blocking pipes every read and write has a deadline. So a child that never
answers or never reads cannot stop the suite. Any failure of an exchange ends the whole process
group, and the next call starts a new process. So a case that crashes the program can still be
simplified.
"""

from __future__ import annotations

from sepv.external._check import Check as Check
from sepv.external._check import check_protocol as check_protocol
from sepv.external._check import describe as describe
from sepv.external._errors import ProgramError as ProgramError
from sepv.external._program import Program as Program
from sepv.external._program import load_program as load_program
