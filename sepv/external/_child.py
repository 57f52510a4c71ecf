"""A child process and its pipes: every read and write has a deadline."""

from __future__ import annotations

import os
import selectors
import shlex
import signal
import subprocess
import time
import weakref
from contextlib import suppress

from sepv.external import _errors as errors
from sepv.external._errors import shown

# The largest answer in bytes, twice that of 1000 steps in 20 dimensions. A child that prints more is ended.
LINE_LIMIT = 1 << 20
# Seconds between "stop" and SIGKILL, enough for a program to write a log.
STOP_GRACE = 2.0
_CHUNK = 1 << 16
_LOG = 2000  # the last bytes of stderr, which an error shows


class Child:
    """A child process and its pipes. `exchange` sends a line and returns the answer; `end` ends the process group."""

    def __init__(self, argv: list[str], limit: int) -> None:
        self.limit, self.count, self.owner = limit, 0, os.getpid()
        self.received, self.log, self.unsent = bytearray(), bytearray(), memoryview(b"")
        self.selector = selectors.DefaultSelector()
        try:
            self.process = subprocess.Popen(
                argv,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                bufsize=0,
                start_new_session=True,
            )
        except (OSError, ValueError) as error:
            raise errors.StartFailure(
                expected=f"a program that can be started: {shlex.join(argv)}",
                received=f"{type(error).__name__}: {error}",
                remedy="give its path (./program), make it executable, and start it once by hand",
            ) from error
        self.finish = weakref.finalize(self, _kill, self.process, self.selector, self.owner)
        self.stdin, self.stdout, self.stderr = (
            pipe.fileno() for pipe in (self.process.stdin, self.process.stdout, self.process.stderr) if pipe
        )
        for fd in (self.stdin, self.stdout, self.stderr):
            os.set_blocking(fd, False)
        self.selector.register(self.stdout, selectors.EVENT_READ, "stdout")
        self.selector.register(self.stderr, selectors.EVENT_READ, "stderr")

    def exchange(self, message: bytes, seconds: float) -> bytes:
        """Send `message` and return the line that answers it, both within `seconds`."""
        deadline = time.monotonic() + seconds
        self.unsent = memoryview(message)
        self._write()
        if self.unsent:
            self.selector.register(self.stdin, selectors.EVENT_WRITE, "stdin")
        while True:
            end = self.received.find(b"\n")
            # Before the whole message is sent, all output is limited, because a child may print and never read.
            if (len(self.received) - 1 if end < 0 or self.unsent else end) > self.limit:
                raise self.fault(
                    errors.LineTooLong,
                    f"a line of at most {self.limit} bytes",
                    f"{len(self.received)} bytes and more: {shown(bytes(self.received[:60]))}…",
                    "one answer a line, nothing else on stdout; give hello a smaller max_steps",
                )
            if end >= 0 and not self.unsent:
                line = bytes(self.received[:end])
                del self.received[: end + 1]
                return line
            left = deadline - time.monotonic()
            if left <= 0:
                raise self._late(seconds)
            for key, _ in self.selector.select(left):
                {"stdin": self._write, "stdout": self._read, "stderr": self._drain}[key.data]()

    def _write(self) -> None:
        try:
            self.unsent = self.unsent[os.write(self.stdin, self.unsent) :]
        except BlockingIOError:
            return
        except BrokenPipeError:
            raise self._gone("closed its input") from None
        if not self.unsent and self.stdin in self.selector.get_map():
            self.selector.unregister(self.stdin)

    def _read(self) -> None:
        with suppress(BlockingIOError):
            data = os.read(self.stdout, _CHUNK)
            if not data:
                raise self._gone("closed its output")
            self.received += data

    def _drain(self) -> None:
        with suppress(BlockingIOError):
            data = os.read(self.stderr, _CHUNK)
            if not data:
                self.selector.unregister(self.stderr)
            self.log += data
            del self.log[:-_LOG]

    def status(self, seconds: float) -> str | None:
        """Describe how the program ended, or return None if it still runs after `seconds`.

        The process is not reaped (waited for) here, so that no other process group can get its number.
        """
        deadline = time.monotonic() + seconds
        while (ended := self._exit_code()) is None and time.monotonic() < deadline:
            time.sleep(0.002)
        if ended is None:
            return None
        if ended >= 0:
            return f"exit code {ended}"
        return f"signal {next((s.name for s in signal.Signals if s == -ended), -ended)}"

    def _exit_code(self) -> int | None:
        """Return the exit code like `Popen.poll`, without reaping the process (which frees its number) if possible."""
        if not hasattr(os, "waitid") or self.process.returncode is not None:
            return self.process.poll()
        try:
            how = os.waitid(os.P_PID, self.process.pid, os.WEXITED | os.WNOHANG | os.WNOWAIT)
        except ChildProcessError:  # other code has reaped the process
            return self.process.poll()
        if how is None:
            return None
        return how.si_status if how.si_code == os.CLD_EXITED else -how.si_status

    def _gone(self, what: str) -> errors.ProgramError:
        status = self.status(0.5)
        return self.fault(
            errors.ProgramExit,
            "a program that runs until it is told to stop",
            f"the end of the program with {status}" if status else f"a running program that {what}",
            "answer every line of stdin, an unknown one with error; end at stop or at the end of stdin only",
        )

    def _late(self, seconds: float) -> errors.ProgramError:
        status, unread = self.status(0), len(self.unsent) + _unread(self.stdin)
        if status:
            return self._gone("")
        if unread:
            return self.fault(
                errors.NeverReads,
                f"a program that reads its stdin within {seconds:g} s",
                f"a message of which {unread} bytes were not read",
                "read stdin line by line, to the end of each line, in a loop",
            )
        part = f"{len(self.received)} bytes without a line end" if self.received else "nothing"
        return self.fault(
            errors.CallTimeout,
            f"a line of answer within {seconds:g} s",
            f"{part}, from a program that read the whole message",
            "end the answer with a newline and flush stdout; a slow program takes fewer steps a message "
            "(max_steps) or is given more time",
        )

    def fault(
        self, kind: type[errors.ProgramError], expected: str, received: str, remedy: str
    ) -> errors.ProgramError:
        """Return an error of class `kind` with these words and the end of the program's stderr."""
        if self.stderr in self.selector.get_map():
            self._drain()
        log = "\n".join(shown(line) for line in bytes(self.log).splitlines())
        return kind(expected=expected, received=received, remedy=remedy, log=log)

    def stop(self, message: bytes) -> str | None:
        """Ask the program to end, then kill its process group; describe how it ended by itself, or return None."""
        with suppress(OSError):
            os.write(self.stdin, message)
        if self.process.stdin:
            self.process.stdin.close()
        try:
            return self.status(STOP_GRACE)
        finally:
            self.end()

    def end(self) -> None:
        """Kill the whole process group at once."""
        self.finish()


def _kill(process: subprocess.Popen[bytes], selector: selectors.BaseSelector, owner: int) -> None:
    if os.getpid() != owner:
        return  # this process is a fork: the child belongs to the parent
    # macOS raises PermissionError for a group of zombies.
    with suppress(ProcessLookupError, PermissionError):
        os.killpg(process.pid, signal.SIGKILL)
    with suppress(subprocess.TimeoutExpired):
        process.wait(5.0)
    selector.close()
    for pipe in (process.stdin, process.stdout, process.stderr):
        if pipe:
            pipe.close()


def _unread(fd: int) -> int:
    """Return the number of bytes in a pipe that the child has not read, or 0 if the system does not tell."""
    import fcntl
    import termios

    try:
        return int.from_bytes(fcntl.ioctl(fd, termios.FIONREAD, bytes(4)), "little")
    except OSError:
        return 0
