"""A command runs in a child process, and its parent watches it,
so that a crash or Ctrl-C always ends with a message.

Python delivers Ctrl-C to whatever code runs: a destructor swallows it, a long call into compiled
code does not see it. A segmentation fault ends everything. So the watcher, the parent, runs no
other code. It forks before any import that could start threads, and stores the child's messages
(`sepv.children`), with which a new child continues after a crash.

The child is a fork, which keeps the terminal's process group and stdin: break points and Ctrl-Z
depend on both. A new interpreter would also import all again, which is most of the time of a quick
command.
"""

from __future__ import annotations

import atexit
import math
import os
import signal
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any, NoReturn

from sepv.children import (
    LOOK_MAX_SECONDS,
    Journal,
    Message,
    Notes,
    TimeLimit,
    Watched,
    ended_with,
    kill_tree,
    open_journal,
    out_of_time,
    packed,
    unpacked,
)
from sepv.errors import said

# Seconds until Ctrl-C is sent again, until a lost Ctrl-C is sent again, until a child that does not
# answer is killed.
CTRL_C_AGAIN, LOST_CTRL_C_AGAIN, ANSWER_SECONDS = 0.5, 0.05, 1.2
# Seconds within which a Ctrl-C from the terminal and one from the watcher count as one.
SAME_INTERRUPT_SECONDS = 0.2
# Signals that end a process from outside, which is no crash.
END_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP) if os.name == "posix" else ()
EXIT_CRASHED, EXIT_INTERRUPTED = 3, 130
# The exit code EX_SOFTWARE of sysexits.h: a defect of this package, or of the system; distinct from
# every verdict.
EXIT_DEFECT = 70
# Seconds for what is registered with atexit, after all is written. A helper process of a scheme may
# never end.
ATEXIT_SECONDS = 5.0


@dataclass
class _Heard:
    """The messages that the processes of a run have sent:
    results and crashes by the key of their work.
    """

    results: dict[str, bytes] = field(default_factory=dict)
    crashes: dict[str, tuple[str, bytes]] = field(default_factory=dict)
    begun: str | None = None
    seconds: float = math.inf
    limit: TimeLimit | None = None
    started: bool = False
    answered: bool = False
    lost: bool = False
    code: int | None = None
    notes: Notes = field(default_factory=Notes)

    def hear(self, kind: str, what: Any) -> None:
        """Record a message."""
        if kind == Message.STARTED:
            self.started = True
        elif kind == Message.BEGIN:
            self.begun, self.seconds = what
            self.limit = TimeLimit(self.seconds)
        elif kind in (Message.RESULT, Message.BACK):
            if kind == Message.RESULT and self.begun is not None:
                self.results[self.begun] = what
            self.begun = self.limit = None
        elif kind == Message.ANSWERED:
            self.answered = True
        elif kind == Message.LOST:
            self.lost = True
        elif kind == Message.END:
            self.code, self.limit = what, TimeLimit(ATEXIT_SECONDS)

    def crash(self, status: str) -> bool:
        """Record a crash of a process; True if it occurred in a measurement,
        which a new process can leave out.
        """
        self.limit = None
        if self.begun is None:
            return False
        self.crashes[self.begun] = status, self.notes.get()
        self.begun = None
        return True


def watched(work: Callable[[], Any]) -> int:
    """Run the work in a watched child process and return its exit code; if watching is impossible,
    run it here.
    """
    if not _can_watch():
        _unblock()
        work()
        return 0
    heard = _Heard()
    while True:
        ended = _attend(work, heard)
        if ended is not None:
            return ended


def _can_watch() -> bool:
    """True if this process can watch a child: it can fork, has one thread,
    and no debugger or profiler follows it.
    """
    alone = threading.current_thread() is threading.main_thread() and threading.active_count() == 1
    return hasattr(os, "fork") and alone and not followed()


def followed() -> bool:
    """True if a debugger or profiler follows this process."""
    tools = getattr(sys, "monitoring", None)
    return bool(sys.gettrace() or sys.getprofile() or (tools and any(map(tools.get_tool, range(6)))))


def _unblock() -> None:
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, END_SIGNALS)


def _attend(work: Callable[[], Any], heard: _Heard) -> int | None:
    """Run one child process to its end and return the exit code of the run;
    None if a new child must continue it.
    """
    for stream in (sys.stdout, sys.stderr):
        stream.flush()
    taken = [n for n in END_SIGNALS if signal.getsignal(n) in (signal.SIG_DFL, signal.default_int_handler)]
    heard_here, heard_there = os.pipe()
    bell_here, bell = os.pipe()
    os.set_blocking(bell, False)
    before = {n: signal.signal(n, lambda *_: None) for n in (*taken, signal.SIGCHLD)}
    ringing = signal.set_wakeup_fd(bell, warn_on_full_buffer=False)
    # A signal that arrives between the fork and the child's own handler is held back.
    signal.pthread_sigmask(signal.SIG_BLOCK, END_SIGNALS)
    parent, child = os.getpid(), os.fork()
    if not child:
        signal.set_wakeup_fd(ringing)
        for number, handler in before.items():
            signal.signal(number, handler)
        for end in (heard_here, bell_here, bell):
            os.close(end)
        journal = Journal(_speaker(heard_there), heard.notes, heard.results, heard.crashes)
        _be_watched(work, journal, parent, signal.SIGINT in taken)
    os.close(heard_there)
    _unblock()
    fork = _Fork(child, heard, heard_here, bell_here)
    try:
        return fork.attended()
    finally:
        fork.selector.close()
        for end in (heard_here, bell_here, bell):
            os.close(end)
        signal.set_wakeup_fd(ringing)
        for number, handler in before.items():
            signal.signal(number, handler)


class _Fork(Watched):
    """The fork that runs the command: signals are forwarded to it, and its end is reported."""

    def __init__(self, pid: int, heard: _Heard, ear: int, bell: int) -> None:
        super().__init__(pid, ear)
        self.heard, self.bell = heard, bell
        self.listen(bell, "forward")
        self.since: float | None = None  # the first Ctrl-C
        self.again, self.at_once = 0.0, False

    def attended(self) -> int | None:
        """Wait for the child to end and return the exit code of the run;
        None if a new child must continue the run.
        """
        while True:
            seconds = None if self.heard.limit is None else LOOK_MAX_SECONDS
            self.pump(seconds if self.since is None else LOST_CTRL_C_AGAIN / 2)
            if self.at_once:
                return self._interrupted(now=True)
            self._hear()
            ended = self.reap()
            if ended is not None:
                self._hear()
                return self._ended(ended)
            if self.heard.limit is not None and self.heard.limit.passed():
                self._kill()
                return self._ended(0, killed=True)
            if self.since is not None and not self.heard.answered:
                waited = time.monotonic() - self.since
                if waited > ANSWER_SECONDS:
                    return self._interrupted(now=True)
                if waited > self.again:
                    self.again = waited + CTRL_C_AGAIN
                    self._send(signal.SIGINT)
                elif self.heard.lost:
                    self.heard.lost, self.again = False, waited + LOST_CTRL_C_AGAIN

    def forward(self) -> None:
        """Forward the signals that this process received to the child. A second Ctrl-C ends it at
        once.
        """
        with suppress(BlockingIOError):
            for number in os.read(self.bell, 64):
                if number == signal.SIGINT:
                    self.at_once = self.since is not None
                    self.since, self.again = self.since or time.monotonic(), CTRL_C_AGAIN
                if number in END_SIGNALS and not self.at_once:
                    self._send(number)

    def _send(self, number: int) -> None:
        with suppress(ProcessLookupError):
            os.kill(self.pid, number)

    def _kill(self) -> None:
        """Kill the child and what it started, and reap it."""
        kill_tree(self.pid)
        os.waitpid(self.pid, 0)

    def _hear(self) -> None:
        """Hear all that was sent."""
        size = -1
        while size < len(self.received) and not self.gone:
            size = len(self.received)
            self._read()
        while (line := self.line()) is not None:
            if message := unpacked(line):
                self.heard.hear(*message)

    def _interrupted(self, now: bool = False) -> int:
        if now:
            self._kill()
            # The process may have hidden the cursor, and left it in the middle of a line.
            sys.stderr.write("\r\x1b[2K\x1b[?25h" if sys.stderr.isatty() else "")
        if not self.heard.answered:
            print("sepv: interrupted", file=sys.stderr, flush=True)
        return EXIT_INTERRUPTED

    def _ended(self, code: int, killed: bool = False) -> int | None:
        if self.since is not None:
            return self._interrupted()
        if self.heard.code is not None and (killed or code >= 0):
            return self.heard.code
        if killed:
            self.heard.crash(out_of_time(self.heard.seconds))
            return None
        if -code in END_SIGNALS:  # this process ends by the same signal
            signal.signal(-code, signal.SIG_DFL)
            os.kill(os.getpid(), -code)
        words = f"ended with {ended_with(code)}"
        if not self.heard.started:  # no code of a scheme has run
            print(
                f"sepv: the process {words} before the command began: no verdict\n"
                "Remedy: give it more memory, open files or processes (ulimit -a)",
                file=sys.stderr,
            )
            return EXIT_DEFECT
        if self.heard.crash(words):
            return None
        print(
            f"sepv: the process {words}: the scheme, or a library that it uses, crashed it\n"
            "Remedy: `sepv verify` names the law and the case; python -X faulthandler -m sepv … shows the line",
            file=sys.stderr,
        )
        return EXIT_CRASHED


def _speaker(pipe: int) -> Callable[[str, Any], None]:
    """Make the function send(kind, what) that sends a message to the watcher through this pipe."""

    def send(kind: str, what: Any) -> None:
        data = memoryview(packed((kind, what)))
        # A message is written whole: Ctrl-C and the signal of a time limit are held back.
        before = signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGINT, signal.SIGALRM))
        try:
            while data:
                data = data[os.write(pipe, data) :]
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)

    return send


def _be_watched(work: Callable[[], Any], journal: Journal, parent: int, heeds: bool) -> NoReturn:
    """Run the work in the child process, and then end the process:
    this function never returns to its caller.
    """
    from sepv.children import end_with_parent  # imported by the child, as all that takes time

    deaf_until, owner = 0.0, os.getpid()

    def interrupt(*_: Any) -> None:
        nonlocal deaf_until
        if time.monotonic() > deaf_until:
            deaf_until = time.monotonic() + SAME_INTERRUPT_SECONDS
            raise KeyboardInterrupt

    def unraisable(lost: Any) -> None:
        nonlocal deaf_until
        if not isinstance(lost.exc_value, KeyboardInterrupt):
            before(lost)
            return
        # A destructor or a callback of the garbage collector swallowed Ctrl-C. The watcher sends it
        # again afterwards.
        journal.send(Message.LOST, None)
        deaf_until = time.monotonic() + LOST_CTRL_C_AGAIN / 2

    before, sys.unraisablehook = sys.unraisablehook, unraisable
    if heeds:
        signal.signal(signal.SIGINT, interrupt)
    code = EXIT_CRASHED
    try:
        end_with_parent(parent)
        _unblock()
        open_journal(journal)
        code = _code_of(work)
        deaf_until = float("inf")
    except KeyboardInterrupt:
        deaf_until = float("inf")
        code = EXIT_INTERRUPTED  # the watcher prints the message
    finally:
        signal.pthread_sigmask(signal.SIG_BLOCK, END_SIGNALS)
        if (
            os.getpid() == owner
        ):  # else this is a copy that a scheme's fork made, whose command is the parent's
            code = _flushed(code)
            journal.send(Message.END, code)
            atexit._run_exitfuncs()
        os._exit(code)


def _flushed(code: int) -> int:
    """Flush the output; return `code`, or 141 if nobody reads it, or 70 if it cannot be written."""
    try:
        sys.stdout.flush()
        sys.stderr.flush()
    except BrokenPipeError:
        return 141
    except OSError as error:
        with suppress(OSError):
            os.write(2, f"{defect(error)}\n".encode(errors="replace"))
        return EXIT_DEFECT
    return code


def _code_of(work: Callable[[], Any]) -> int:
    """Run the work, and return the exit code with which Python would end,
    but 70 and one line for an exception.
    """
    try:
        work()
    except SystemExit as ended:
        if ended.code is None or isinstance(ended.code, int):
            return (ended.code or 0) & 0xFF
        print(ended.code, file=sys.stderr)
        return EXIT_DEFECT
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        print(defect(error), file=sys.stderr)
        return EXIT_DEFECT
    return 0


def defect(error: BaseException) -> str:
    """The line for an error that no command handled: no memory, no descriptor, or a defect."""
    lines = said(error).strip().splitlines() or [""]
    why, what, remedy = "a defect of sepv itself", lines[0], "--debug shows where; please report it"
    if isinstance(error, ImportError):
        why, what, remedy = "a package is missing or broken", lines[-1], "pip check, and install sepv again"
    elif isinstance(error, (OSError, MemoryError)):
        why, what = "the system refuses what it needs", lines[-1]
        remedy = "give it memory, disk, open files and processes (ulimit -a), and an output that is open"
    return f"sepv: {why}, and no verdict: {type(error).__name__}: {what:.300}. Remedy: {remedy}"
