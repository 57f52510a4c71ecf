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

from sepv.children._journal import KEY, KEY_NAME, MEMORY_BYTES, Notes, packed, unpacked
from sepv.children._parent import end_with_parent, told_by_signal
from sepv.children._watched import NoLine, Watched

_LOG_BYTES = 2000  # the last bytes of stderr, which an error shows
_CLOSED_INPUT = "closed its input"


class Child(Watched):
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
        self.limit, self.owner, self.log = limit, os.getpid(), bytearray()
        with TemporaryFile() as file:
            if noted:
                file.truncate(MEMORY_BYTES)
                self.notes = Notes(file.fileno())
                argv, options = [*argv, str(file.fileno())], options | {"pass_fds": (file.fileno(),)}
            options.setdefault("preexec_fn", _before_exec())
            with warnings.catch_warnings():
                # Python ≥ 3.12 warns of a fork beside threads; before exec only `end_with_parent`
                # runs, without locks.
                warnings.simplefilter("ignore", DeprecationWarning)
                self.process = subprocess.Popen(
                    argv, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE if log else None,
                    bufsize=0, start_new_session=True, **options,
                )  # fmt: skip
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        super().__init__(self.process.pid, self.process.stdout.fileno())
        self.finish = weakref.finalize(self, _kill, self.process, self.selector, self.owner)
        self.stdin, self.stderr = self.process.stdin.fileno(), -1
        os.set_blocking(self.stdin, False)
        if self.process.stderr:
            self.stderr = self.process.stderr.fileno()
            self.listen(self.stderr, "drain")

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
            line = None if self.gone == _CLOSED_INPUT else self.line()
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
            self.selector.register(self.stdin, selectors.EVENT_WRITE, "_write")

    def _write(self) -> None:
        try:
            self.unsent = self.unsent[os.write(self.stdin, self.unsent) :]
        except BlockingIOError:
            return
        except BrokenPipeError:
            self.gone, self.unsent = _CLOSED_INPUT, memoryview(b"")
        if not self.unsent and self.stdin in self.selector.get_map():
            self.selector.unregister(self.stdin)

    def drain(self) -> None:
        """Keep the end of what the child wrote to stderr."""
        with suppress(BlockingIOError):
            self.log += self.take(self.stderr)
            del self.log[:-_LOG_BYTES]

    def reap(self) -> int | None:
        """Return the exit code as `Watched.reap` does; `process` remembers it."""
        self.returncode = self.process.poll()
        return self.returncode

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
        self.reap()


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


def _before_exec() -> Callable[[], None] | None:
    """The function that a new process calls first; None where no signal tells a parent's death.

    The signal comes at the end of the *thread* that started the process, so only the main thread
    asks for it.
    """
    if not told_by_signal() or threading.current_thread() is not threading.main_thread():
        return None
    parent = os.getpid()
    return lambda: end_with_parent(parent)
