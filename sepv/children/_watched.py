"""A watched child process: lines from it, how it ended, and an end by force."""

from __future__ import annotations

import os
import selectors
import signal
import sys
import time
from collections.abc import Iterable
from contextlib import suppress

from sepv.children._journal import ended_with

_READ_BYTES = 1 << 16


class NoLine(Exception):
    """No whole line came from a child: `why` is "late", "gone" or "long"."""

    def __init__(self, why: str) -> None:
        self.why = why
        super().__init__(why)


class Watched:
    """A child process of this one, by its number, and the pipe from which its lines come.

    `Child` starts a program. The watcher of a command (`sepv.commands._watch`) makes a fork.

    Attributes
    ----------
    gone : str
        How the pipe ended, in words; empty while it is open.
    received : bytearray
        What was received and is no whole line yet, or was not taken by `line`.
    """

    limit = sys.maxsize
    unsent = memoryview(b"")
    returncode: int | None = None

    def __init__(self, pid: int, stdout: int) -> None:
        self.pid, self.stdout, self.gone = pid, stdout, ""
        self.received = bytearray()
        self.selector = selectors.DefaultSelector()
        self.listen(stdout, "_read")

    def listen(self, pipe: int, method: str) -> None:
        """Let `pump` call the method of this name whenever the pipe has something to read."""
        os.set_blocking(pipe, False)
        self.selector.register(pipe, selectors.EVENT_READ, method)

    def line(self) -> bytes | None:
        """The next received line, without its end; None if none is complete.
        Raises NoLine for a line too long.
        """
        end = self.received.find(b"\n")
        # Before the whole message is sent, all output is limited, because a child may print and
        # never read.
        if (len(self.received) - 1 if end < 0 or self.unsent else end) > self.limit:
            raise NoLine("long")
        if end < 0 or self.unsent:
            return None
        line = bytes(self.received[:end])
        del self.received[: end + 1]
        return line

    def pump(self, seconds: float | None = 0.0) -> None:
        """Wait at most `seconds` (None: for ever) until the pipes are ready,
        then read and write what they hold and take.
        """
        for key, _ in self.selector.select(seconds):
            getattr(self, key.data)()

    def _read(self) -> None:
        with suppress(BlockingIOError):
            data = self.take(self.stdout)
            self.received += data
            if not data:
                self.gone = self.gone or "closed its output"

    def take(self, pipe: int) -> bytes:
        """Read what a pipe holds, at most _READ_BYTES bytes; at its end `pump` stops listening to
        it.
        """
        data = os.read(pipe, _READ_BYTES)
        if not data:
            self.selector.unregister(pipe)
        return data

    def status(self, seconds: float) -> str | None:
        """Describe how the child ended, or return None if it still runs after `seconds`.

        The process is not reaped (waited for) here, so that no other process group can get its
        number.
        """
        deadline = time.monotonic() + seconds
        while (ended := self.exit_code()) is None and time.monotonic() < deadline:
            time.sleep(0.002)
        return None if ended is None else ended_with(ended)

    def exit_code(self) -> int | None:
        """Return the exit code like `Popen.poll`, without reaping the process (which frees its
        number) if possible.
        """
        if not hasattr(os, "waitid") or self.returncode is not None:
            return self.reap()
        try:
            how = os.waitid(os.P_PID, self.pid, os.WEXITED | os.WNOHANG | os.WNOWAIT)
        except ChildProcessError:  # other code has reaped the process
            return self.reap()
        if how is None:
            return None
        return how.si_status if how.si_code == os.CLD_EXITED else -how.si_status

    def reap(self) -> int | None:
        """Return the exit code, and free the number of a process that has ended; None if it
        runs.
        """
        if self.returncode is None:
            pid, status = os.waitpid(self.pid, os.WNOHANG)
            self.returncode = os.waitstatus_to_exitcode(status) if pid else None
        return self.returncode


def kill_tree(pid: int) -> None:
    """Kill a process and, on Linux, all its descendants, which may have left its group;
    nothing is reaped.
    """
    for number in (signal.SIGSTOP, signal.SIGKILL):  # what is stopped starts no further process meanwhile
        for found in _tree(pid) if number == signal.SIGSTOP else [*_tree(pid)][::-1]:
            with suppress(ProcessLookupError, PermissionError):
                os.kill(found, number)


def _tree(pid: int) -> Iterable[int]:
    yield pid
    with suppress(OSError):
        for thread in os.listdir(f"/proc/{pid}/task"):
            with open(f"/proc/{pid}/task/{thread}/children", encoding="ascii") as file:
                children = file.read().split()
            for child in map(int, children):
                yield from _tree(child)
