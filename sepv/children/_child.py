"""A supervised child process: lines in and out with deadlines, its last note,
and an end that always comes.

The child leads a process group of its own, so that what it starts ends with it, and Ctrl-C in a
terminal reaches the parent alone. A message is one line (`packed` makes one of any object). Where
the system can (Linux), the child gets SIGKILL if its parent dies. `concurrent.futures`, loky and
pebble were tried first: they kill single processes and not groups, notice no parent's death, and
pickle functions, where here programs of other languages are asked too.
"""

from __future__ import annotations

import os
import selectors
import signal
import subprocess
import sys
import threading
import time
import warnings
import weakref
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from tempfile import TemporaryFile
from typing import Any

from sepv.children._journal import BYTES, KEY, KEY_NAME, Notes, ended_with, packed, unpacked
from sepv.children._parent import end_with_parent, told_by_signal

_CHUNK = 1 << 16
_LOG = 2000  # the last bytes of stderr, which an error shows
_DEAF = "closed its input"


class NoLine(Exception):
    """No whole line came from a child: `why` is "late", "gone" or "long"."""

    def __init__(self, why: str) -> None:
        self.why = why
        super().__init__(why)


class Child:
    """A child process and its pipes. `exchange` sends a line and returns the answer;
    `end` kills the process group.

    Parameters
    ----------
    argv : list of str
        The program and its arguments.
    limit : int, optional
        The most bytes of a line.
    log : bool
        True if the end of stderr is kept in `log`; else the child writes to this process's stderr.
    noted : bool
        True for a Python process that writes `notes`: the number of an open file becomes its last
        argument.
    options
        Arguments of `subprocess.Popen`, such as cwd. An OSError or ValueError if the program cannot
        be started.
    """

    def __init__(
        self, argv: Sequence[str], *, limit: int = sys.maxsize, log: bool = False, noted: bool = False, **options: Any
    ) -> None:  # fmt: skip
        self.limit, self.owner, self.gone = limit, os.getpid(), ""
        self.received, self.log, self.unsent = bytearray(), bytearray(), memoryview(b"")
        with TemporaryFile() as file:
            if noted:
                file.truncate(BYTES)
                self.notes = Notes(file.fileno())
                argv, options = [*argv, str(file.fileno())], options | {"pass_fds": (file.fileno(),)}
            with warnings.catch_warnings():
                # Python ≥ 3.12 warns of a fork beside threads; before exec only `end_with_parent`
                # runs, without locks.
                warnings.simplefilter("ignore", DeprecationWarning)
                self.process = subprocess.Popen(
                    argv, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE if log else None,
                    bufsize=0, start_new_session=True,
                    preexec_fn=_before_exec(),  # noqa: PLW1509  (as above)
                    **options,
                )  # fmt: skip
        self.selector = selectors.DefaultSelector()
        self.finish = weakref.finalize(self, _kill, self.process, self.selector, self.owner)
        pipes = (self.process.stdin, self.process.stdout, self.process.stderr)
        for name, pipe in zip(("stdin", "stdout", "stderr"), pipes, strict=True):
            if pipe:
                setattr(self, name, pipe.fileno())
                os.set_blocking(pipe.fileno(), False)
                if name != "stdin":
                    self.selector.register(pipe.fileno(), selectors.EVENT_READ, name)

    stdin: int
    stdout: int
    stderr: int = -1

    @classmethod
    def of_module(cls, module: str, environment: Mapping[str, str] | None = None, **options: Any) -> Child:
        """Start a module of this package, in an interpreter that finds what this one finds,
        in the same order.

        Without -P the current folder would stand first, and its ``queue.py`` or ``sepv.py`` would
        be run.
        """
        # The current folder is left out: it comes last on the path of a target, after sepv is
        # imported.
        path = os.pathsep.join(p for p in sys.path if p and p != os.getcwd())
        environment = {**os.environ, "PYTHONPATH": path, KEY_NAME: KEY.decode(), **(environment or {})}
        return cls([sys.executable, "-P", "-m", module], env=environment, **options)

    def exchange(self, message: bytes, seconds: float) -> bytes:
        """Send a line and return the line that answers it, both within `seconds`; raises NoLine."""
        deadline = time.monotonic() + seconds
        self.send(message)
        while True:
            line = None if self.gone == _DEAF else self.line()
            if line is not None:
                return line
            left = deadline - time.monotonic()
            if self.gone or left <= 0:
                raise NoLine("gone" if self.gone else "late")
            self.pump(left)

    def ask(self, message: Any, seconds: float) -> Any:
        """Send an object to a process of this package and return the one that answers it;
        raises NoLine.
        """
        deadline, line = time.monotonic() + seconds, packed(message)
        while (answer := unpacked(self.exchange(line, deadline - time.monotonic()))) is None:
            line = b""
        return answer

    def send(self, message: bytes) -> None:
        """Begin to send a message after those before; `pump` sends what the pipe does not take at
        once.
        """
        self.unsent = memoryview(bytes(self.unsent) + message)
        self._write()
        if self.unsent:
            self.selector.register(self.stdin, selectors.EVENT_WRITE, "stdin")

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

    def pump(self, seconds: float = 0.0) -> None:
        """Wait at most `seconds` until the pipes are ready,
        then read and write what they hold and take.
        """
        for key, _ in self.selector.select(seconds):
            {"stdin": self._write, "stdout": self._read, "stderr": self.drain}[key.data]()

    def _write(self) -> None:
        try:
            self.unsent = self.unsent[os.write(self.stdin, self.unsent) :]
        except BlockingIOError:
            return
        except BrokenPipeError:
            self.gone, self.unsent = _DEAF, memoryview(b"")
        if not self.unsent and self.stdin in self.selector.get_map():
            self.selector.unregister(self.stdin)

    def _read(self) -> None:
        with suppress(BlockingIOError):
            data = os.read(self.stdout, _CHUNK)
            self.received += data
            if not data:
                self.gone = self.gone or "closed its output"
                self.selector.unregister(self.stdout)

    def drain(self) -> None:
        """Keep the end of what the child wrote to stderr."""
        with suppress(BlockingIOError):
            data = os.read(self.stderr, _CHUNK)
            if not data:
                self.selector.unregister(self.stderr)
            self.log += data
            del self.log[:-_LOG]

    def status(self, seconds: float) -> str | None:
        """Describe how the child ended, or return None if it still runs after `seconds`.

        The process is not reaped (waited for) here, so that no other process group can get its
        number.
        """
        deadline = time.monotonic() + seconds
        while (ended := self._exit_code()) is None and time.monotonic() < deadline:
            time.sleep(0.002)
        return None if ended is None else ended_with(ended)

    def _exit_code(self) -> int | None:
        """Return the exit code like `Popen.poll`, without reaping the process (which frees its
        number) if possible.
        """
        if not hasattr(os, "waitid") or self.process.returncode is not None:
            return self.process.poll()
        try:
            how = os.waitid(os.P_PID, self.process.pid, os.WEXITED | os.WNOHANG | os.WNOWAIT)
        except ChildProcessError:  # other code has reaped the process
            return self.process.poll()
        if how is None:
            return None
        return how.si_status if how.si_code == os.CLD_EXITED else -how.si_status

    def stop(self, message: bytes, seconds: float) -> str | None:
        """Send a last message, close the child's input, and kill its group after `seconds`.

        Returns how the child ended by itself, or None.
        """
        with suppress(OSError):
            os.write(self.stdin, message)
        if self.process.stdin:
            self.process.stdin.close()
        try:
            return self.status(seconds)
        finally:
            self.end()

    def ask_to_end(self) -> None:
        """Send SIGTERM to the group; a stopped process takes it when it goes on, so `end`
        follows.
        """
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(self.process.pid, signal.SIGTERM)

    def end(self) -> None:
        """Kill the whole process group at once."""
        self.finish()


def pump_all(children: Iterable[Child], seconds: float) -> None:
    """Wait at most `seconds` until a pipe of one of the children is ready,
    and serve those that are.
    """
    with selectors.DefaultSelector() as ready:
        for child in children:
            ready.register(child.selector, selectors.EVENT_READ, child)
        for key, _ in ready.select(seconds):
            key.data.pump()


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


def _before_exec() -> Callable[[], None] | None:
    """The function that a new process calls first; None where no signal tells a parent's death.

    The signal comes at the end of the *thread* that started the process, so only the main thread
    asks for it.
    """
    if not told_by_signal() or threading.current_thread() is not threading.main_thread():
        return None
    parent = os.getpid()
    return lambda: end_with_parent(parent)
