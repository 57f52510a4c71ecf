"""Messages of a process to the one that watches it, so that its results survive a crash and the crash has a name.

``sepv`` on the command line runs in a process that another one watches (`sepv.commands._watch`). The measurement of a
law is work with a key. Its result is sent to the watcher, so that after a crash the other laws go on in a new process.
Without a watcher nothing here has any effect.
"""

from __future__ import annotations

import pickle
import signal
import time
from collections.abc import Callable, Mapping
from contextvars import ContextVar
from dataclasses import dataclass, field
from mmap import mmap
from typing import Any, TypeVar

T = TypeVar("T")

# The most bytes of a note, and the bytes of its length before it.
BYTES, _SIZE = 1 << 20, 4

# The kinds of messages: work begins, its result, it ended without one; Ctrl-C is answered, or was lost; the end.
BEGIN, RESULT, BACK, ANSWERED, LOST, END = b"b", b"r", b"k", b"a", b"l", b"e"


class Crashed(Exception):
    """The work ended its process; `note` is a case as JSON, a step in words, or None if neither was noted.

    `violated` is a case as JSON that had violated the law before, or None.
    """

    def __init__(self, status: str, note: bytes = b"") -> None:
        self.status = status
        self.note: dict[str, Any] | str | None = None
        self.violated: dict[str, Any] | None = None
        if note:
            self.note, self.violated = pickle.loads(note)
        super().__init__(f"the process ended with {status}")


class Notes:
    """The last note, in memory that two processes share: writing it is no system call, and it survives a crash."""

    def __init__(self, file: int = -1) -> None:
        self.memory = mmap(file, BYTES)

    def put(self, text: bytes) -> None:
        """Replace the note; a text that is too long leaves none."""
        size = len(text) if len(text) <= BYTES - _SIZE else 0
        self.memory[_SIZE : _SIZE + size] = text[:size]
        self.memory[:_SIZE] = size.to_bytes(_SIZE, "big")

    def get(self) -> bytes:
        """The note; empty if there is none."""
        return self.memory[_SIZE : _SIZE + int.from_bytes(self.memory[:_SIZE], "big")]


@dataclass
class Journal:
    """The connection of a process to its watcher: a channel for messages, and a place for notes.

    `results` and `crashes` are those of earlier processes of the run by the key of their work.
    """

    send: Callable[[bytes, bytes], None]
    notes: Notes
    results: Mapping[str, bytes] = field(default_factory=dict)
    crashes: Mapping[str, tuple[str, bytes]] = field(default_factory=dict)
    # The number of cases noted by the current work, and the time of the last one.
    cases: int = 0
    since: float = 0.0
    # A case that violates, found by the current work.
    violated: dict[str, Any] | None = None


_journal: ContextVar[Journal | None] = ContextVar("journal", default=None)


def open_journal(journal: Journal) -> None:
    """Mark this process as watched from now on."""
    _journal.set(journal)


def current_journal() -> Journal | None:
    """The journal of this process, for another thread; None if nobody watches."""
    return _journal.get()


def attempted(key: str, work: Callable[[], T], *, kept: bool = True) -> T:
    """Do the work of a key and return its result. If `kept`, it is computed once in a run, and must be picklable.

    Raises
    ------
    Crashed
        If an earlier process of this run died of it.
    """
    journal = _journal.get()
    if journal is None:
        return work()
    if key in journal.results:
        result: T = pickle.loads(journal.results[key])
        return result
    if key in journal.crashes:
        raise Crashed(*journal.crashes[key])
    journal.cases, journal.violated = 0, None
    journal.notes.put(b"")
    journal.send(BEGIN, key.encode())
    done = BACK, b""
    try:
        outcome = work()
        done = (RESULT, pickle.dumps(outcome)) if kept else done
    finally:
        journal.send(*done)
    return outcome


def note_case(case: Callable[[], dict[str, Any]]) -> None:
    """Note the current case, in case it ends this process."""
    journal = _journal.get()
    if journal is not None:
        journal.cases, journal.since = journal.cases + 1, time.monotonic()
        journal.notes.put(pickle.dumps((case(), journal.violated)))


def note_violation(case: Callable[[], dict[str, Any]]) -> None:
    """Note a case that violates the current law: a later crash must not hide it."""
    journal = _journal.get()
    if journal is not None:
        journal.violated = case()


def note_step(step: Callable[[], str]) -> None:
    """Note the current step in words, in case it ends this process, unless it belongs to a case that is noted."""
    journal = _journal.get()
    if journal is not None and not journal.cases:
        journal.notes.put(pickle.dumps((step(), None)))


def interruption_answered() -> None:
    """Report that Ctrl-C was seen, and that this process will end by itself: it hears no other one."""
    journal = _journal.get()
    if journal is not None:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        journal.send(ANSWERED, b"")


def ended_with(returncode: int) -> str:
    """Describe how a process ended, from its return code in `subprocess`: signal SIGSEGV, exit code 9."""
    if returncode >= 0:
        return f"exit code {returncode}"
    known = next((s.name for s in signal.Signals if s == -returncode), str(-returncode))
    return f"signal {known}" + (" (is memory short?)" if known == "SIGKILL" else "")
