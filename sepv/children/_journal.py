"""Messages from a process to its watcher, so that finished results survive a crash and the crash is
described.

A command of ``sepv`` runs in a child process; its parent is the watcher (`sepv.commands._watch`).
The work of a run is divided into pieces, one for each law measured; a text, the key, names a piece.
Each result is sent to the watcher, so that after a crash, or after a kill at a piece's time limit,
a new process measures the remaining laws. Without a watcher no message is sent.
"""

from __future__ import annotations

import gc
import math
import os
import pickle
import signal
import sys
import time
from binascii import a2b_base64, b2a_base64, crc32
from collections.abc import Callable, Mapping
from contextlib import suppress
from contextvars import ContextVar
from dataclasses import dataclass, field
from mmap import mmap
from typing import Any, TypeVar

T = TypeVar("T")


# The name of the environment variable with which a child gets the key.
KEY_NAME = "SEPV_LINES"
# A random text that this process and its children alone know. It leaves the environment at once,
# so that no program of a scheme inherits it.
KEY = os.environ.pop(KEY_NAME, "").encode() or os.urandom(16).hex().encode()


def packed(message: Any) -> bytes:
    """Any object that can be pickled, as one line: the key, a checksum and the pickle."""
    data = b2a_base64(pickle.dumps(message))
    return b"%b%08x%b" % (KEY, crc32(data), data)


def unpacked(line: bytes) -> Any:
    """The object of a line of `packed`, without its end; None for another line,
    which goes to stderr.

    A scheme's code, or what an interpreter runs as it starts, may write into a pipe of this
    package. Only a line with the key is unpickled, as a pickle can call any function. Text before
    the key is another's, and was not ended.
    """
    before, key, rest = line.rpartition(KEY)
    data = rest[8:] + b"\n"
    whole = bool(key) and b"%08x" % crc32(data) == rest[:8]
    if others := before if whole else line:
        with suppress(OSError, AttributeError):  # sys.stderr is None if it was closed
            sys.stderr.write(others.decode(errors="replace") + "\n")
    return pickle.loads(a2b_base64(data)) if whole else None


# The size of the shared memory in bytes, and how many of these bytes hold the length of the note
# that follows.
MEMORY_BYTES, _SIZE = 1 << 20, 4

# The number of new objects after which Python searches for cycles of objects, chosen for the speed
# of `sepv verify`.
OBJECTS = 5000

# Seconds after a time limit until the process that watches kills: a step that can be interrupted
# has then ended.
KILL_GRACE = 5.0
# The longest time between two looks at the clock.
LOOK_MAX_SECONDS = 0.5


class Message:
    """The kinds of messages."""

    STARTED, BEGIN, RESULT, BACK = (
        "the command runs",
        "work begins",
        "its result",
        "work ended without a result",
    )
    ANSWERED, LOST, END = "Ctrl-C is handled", "Ctrl-C was lost", "all is done but for Python's own end"


class TimeLimit:
    """A time limit that another process enforces, in seconds in which that process ran.

    While the whole job is stopped (Ctrl-Z, or a laptop asleep), no time passes: a look counts at
    most two ticks.
    """

    def __init__(self, seconds: float) -> None:
        self.left, self.looked = seconds + KILL_GRACE, time.monotonic()

    def passed(self) -> bool:
        """True if the time is over. To be asked once in LOOK_MAX_SECONDS seconds."""
        now = time.monotonic()
        self.left -= min(now - self.looked, 2 * LOOK_MAX_SECONDS)
        self.looked = now
        return self.left <= 0


WAS_KILLED = "was killed"


def out_of_time(seconds: float) -> str:
    """Describe the end of a process that was killed at its time limit."""
    return f"{WAS_KILLED}: no end within {seconds:g} s (--timeout) and {KILL_GRACE:g} s more"


class Crashed(Exception):
    """The work crashed its process, or was killed with it at a time limit; `status` says so,
    after "the process".

    `late` is True for a kill at a time limit. `note` is what the process noted last: an input as
    JSON, or a step of the scheme in words; None if it noted nothing. `violated` is an earlier
    input, as JSON, that violated the law, or None.
    """

    def __init__(self, status: str, note: bytes = b"") -> None:
        self.status, self.late = status, status.startswith(WAS_KILLED)
        self.note: dict[str, Any] | str | None = None
        self.violated: dict[str, Any] | None = None
        if note:
            self.note, self.violated = pickle.loads(note)
        super().__init__(f"the process {status}")


class Notes:
    """The note on what a process does now, in memory that it shares with its watcher,
    so that it survives a crash.
    """

    def __init__(self, file: int = -1) -> None:
        self.memory = mmap(file, MEMORY_BYTES)

    def put(self, text: bytes) -> None:
        """Replace the note; if the text is too long, the note is empty."""
        size = len(text) if len(text) <= MEMORY_BYTES - _SIZE else 0
        self.memory[_SIZE : _SIZE + size] = text[:size]
        self.memory[:_SIZE] = size.to_bytes(_SIZE, "big")

    def get(self) -> bytes:
        """The note; empty if there is none."""
        return self.memory[_SIZE : _SIZE + int.from_bytes(self.memory[:_SIZE], "big")]


@dataclass
class Journal:
    """The connection of a process to its watcher: a channel for messages, and a place for notes.

    `results` and `crashes` hold the results and crashes of earlier processes of the run, by the key
    of the work.
    """

    send: Callable[[str, Any], None]
    notes: Notes
    results: Mapping[str, bytes] = field(default_factory=dict)
    crashes: Mapping[str, tuple[str, bytes]] = field(default_factory=dict)
    # The number of cases noted by the current work, and the time of the last note.
    cases: int = 0
    since: float = 0.0
    # A case that violates the law which the current work measures.
    violated: dict[str, Any] | None = None


_journal: ContextVar[Journal | None] = ContextVar("journal", default=None)


def open_journal(journal: Journal) -> None:
    """Mark this process as watched from now on."""
    _journal.set(journal)


def current_journal() -> Journal | None:
    """The journal of this process, for another thread; None if nobody watches."""
    return _journal.get()


def attempted(key: str, work: Callable[[], T], *, kept: bool = True, seconds: float = math.inf) -> T:
    """Do the work with this key and return its result. If `kept`, the result is pickled,
    and computed once in a run.

    `seconds` is the work's own time limit. KILL_GRACE seconds later the watcher kills a process
    that does not keep it.

    Raises
    ------
    Crashed
        If this work crashed an earlier process of the run, or did not end.
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
    journal.send(Message.BEGIN, (key, seconds))
    done: tuple[str, Any] = Message.BACK, None
    try:
        outcome = work()
        done = (Message.RESULT, pickle.dumps(outcome)) if kept else done
    finally:
        journal.send(*done)
    return outcome


def note_case(case: Callable[[], dict[str, Any]]) -> None:
    """Note the current case, one input to a law, so that the watcher can report it if it crashes
    this process.
    """
    journal = _journal.get()
    if journal is not None:
        journal.cases, journal.since = journal.cases + 1, time.monotonic()
        journal.notes.put(pickle.dumps((case(), journal.violated)))


def note_violation(case: Callable[[], dict[str, Any]]) -> None:
    """Note an input that violates the current law, so that a later crash does not hide the
    violation.
    """
    journal = _journal.get()
    if journal is not None:
        journal.violated = case()


def note_step(step: Callable[[], str]) -> None:
    """Note the current step in words, in case it crashes;
    ignored once the current measurement has noted an input.
    """
    journal = _journal.get()
    if journal is not None and not journal.cases:
        journal.notes.put(pickle.dumps((step(), None)))


def command_started() -> None:
    """Tell the watcher that all is imported: what crashes the process from now on is the scheme,
    or a library of it.
    """
    journal = _journal.get()
    if journal is not None:
        journal.send(Message.STARTED, None)


def interruption_answered() -> None:
    """Tell the watcher that this process saw Ctrl-C and will end by itself;
    further Ctrl-C are ignored.
    """
    journal = _journal.get()
    if journal is not None:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        journal.send(Message.ANSWERED, None)


def ended_with(returncode: int) -> str:
    """Describe how a process ended, from its return code in `subprocess`: signal SIGSEGV,
    exit code 9.
    """
    if returncode >= 0:
        return f"exit code {returncode}"
    known = next((s.name for s in signal.Signals if s == -returncode), str(-returncode))
    return f"signal {known}" + (" (is memory short?)" if known == "SIGKILL" else "")


def collect_seldom() -> None:
    """Let the garbage collector run seldom: cases are many small objects without cycles."""
    gc.set_threshold(max(OBJECTS, gc.get_threshold()[0]))
