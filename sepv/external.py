"""The door for other languages: a long-lived child process that speaks JSON lines (docs/protocol.md).

One thread and non-blocking pipes: nothing here waits without a deadline, for reading or for writing, so a
child that never answers, or never reads, cannot stop the suite. Whatever goes wrong in an exchange ends the
whole process group; the next call starts a fresh one, so that a case that crashes can still be shrunk.
"""

from __future__ import annotations

import json
import os
import re
import selectors
import shlex
import signal
import subprocess
import threading
import time
import weakref
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Any, NamedTuple

import numpy as np

from sepv.case import problem_to_json
from sepv.errors import SchemeFault, SepvError, Skipped, StepFailure, TargetError, UsageError
from sepv.problem import Array, NamedProblem, PolynomialSystem, Problem
from sepv.scheme import Scheme, as_lanes

PROTOCOL = 1
# A message of 1000 steps in 20 dimensions is half of it; a child that prints without end stops here.
LINE_LIMIT = 1 << 20
# What a message that a program takes may hold at most, whatever the program would take.
MOST_STEPS = 1024
# Seconds between "stop" and SIGKILL: enough to write a log, too few to be noticed.
STOP_GRACE = 2.0
_CHUNK = 1 << 16
_LOG = 2000  # bytes of stderr that an error shows
_HEX = re.compile(r"[+-]?0[xX][0-9a-fA-F]+(\.[0-9a-fA-F]*)?([pP][+-]?[0-9]{1,5})?").fullmatch
_NOT_FINITE = re.compile(r"[+-]?(nan|inf|infinity)", re.IGNORECASE).fullmatch


class ProgramError(SepvError):
    """A program that does not keep the protocol; the base of all that end in the verdict "error"."""

    def __init__(self, *, expected: str, received: str, remedy: str, log: str = "") -> None:
        self.expected, self.received, self.remedy, self.log = expected, received, remedy, log
        tail = "\nThe end of its stderr:\n" + "\n".join(f"  | {s}" for s in log.splitlines()) if log else ""
        # Not super(): StartFailure is a TargetError too, whose own constructor says the same without the log.
        SepvError.__init__(self, f"Expected {expected}.\nReceived {received}.\nRemedy: {remedy}{tail}")


class StartFailure(ProgramError, TargetError):
    """A program that cannot be started."""


class CallTimeout(ProgramError):
    """No whole answer within the time of one call."""


class RunTimeout(ProgramError):
    """The time for the whole run is used up."""


class NeverReads(ProgramError):
    """The message was not read within the time of one call."""


class ProgramExit(ProgramError):
    """The program ended, crashed, or closed its input or output, where an answer was due."""


class LineTooLong(ProgramError):
    """More bytes than a line may have."""


class NotJson(ProgramError):
    """A line that is not JSON in UTF-8."""


class WrongId(ProgramError):
    """An answer that does not carry the id of its question."""


class BadAnswer(ProgramError):
    """JSON that is not an answer: keys missing, of the wrong type, or another protocol."""


class WrongShape(SchemeFault):
    """States of the wrong number or dimension."""


class NotFinite(SchemeFault):
    """A state with NaN, an infinity, or a number beyond binary64."""


class StepRefused(StepFailure):
    """The program answered "error": it says itself that this step cannot be made."""

    def __init__(self, *, problem: str, y: Array, delta: float, reason: str) -> None:
        self.problem, self.y, self.delta, self.reason = problem, y, delta, reason
        self.residual, self.status, self.iterations = float("nan"), reason, 0
        SepvError.__init__(
            self,
            f"The program could not make the step: {reason}\n"
            f"problem {problem}, y = {[float(v) for v in y]}, Δ = {delta!r}.\n"
            "Remedy: a smaller h, or a truncation of the increments (Remark 2.1).",
        )


@dataclass(frozen=True)
class Hello:
    """What a program says of itself; the fields are those of docs/protocol.md."""

    scheme: str
    protocol: int = PROTOCOL
    source: str = ""
    claims: tuple[str, ...] = ()
    mean_square_order: float | None = None
    weak_order: float | None = None
    solver_tolerance: float = 0.0
    truncation: int | None = 2
    problems: tuple[str, ...] = ()
    polynomial: bool = False
    max_steps: int = 1


class _Child:
    """A process and its pipes. `exchange` sends one line and returns one; `end` ends the process group."""

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
            raise StartFailure(
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
        """The line that answers `message`, both within `seconds`."""
        deadline = time.monotonic() + seconds
        self.unsent = memoryview(message)
        self._write()
        if self.unsent:
            self.selector.register(self.stdin, selectors.EVENT_WRITE, "stdin")
        while True:
            end = self.received.find(b"\n")
            # What comes before the message is sent is bounded as a whole: a child may print and never read.
            if (len(self.received) - 1 if end < 0 or self.unsent else end) > self.limit:
                raise self.fault(
                    LineTooLong,
                    f"a line of at most {self.limit} bytes",
                    f"{len(self.received)} bytes and more: {_shown(bytes(self.received[:60]))}…",
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
        """How the program ended, or None where it still runs after `seconds`.

        It is not reaped: until then no other process group can get its number.
        """
        deadline = time.monotonic() + seconds
        while (ended := self._exit_code()) is None and time.monotonic() < deadline:
            time.sleep(0.002)
        if ended is None:
            return None
        return f"exit code {ended}" if ended >= 0 else f"signal {_signal_name(-ended)}"

    def _exit_code(self) -> int | None:
        """As `Popen.poll`, but without reaping where the system can (macOS: since Python 3.13)."""
        if not hasattr(os, "waitid") or self.process.returncode is not None:
            return self.process.poll()
        try:
            how = os.waitid(os.P_PID, self.process.pid, os.WEXITED | os.WNOHANG | os.WNOWAIT)
        except ChildProcessError:  # reaped by somebody else
            return self.process.poll()
        if how is None:
            return None
        return how.si_status if how.si_code == os.CLD_EXITED else -how.si_status

    def _gone(self, what: str) -> ProgramError:
        status = self.status(0.5)
        return self.fault(
            ProgramExit,
            "a program that runs until it is told to stop",
            f"the end of the program with {status}" if status else f"a running program that {what}",
            "answer every line of stdin, an unknown one with error; end at stop or at the end of stdin only",
        )

    def _late(self, seconds: float) -> ProgramError:
        status, unread = self.status(0), len(self.unsent) + _unread(self.stdin)
        if status:
            return self._gone("")
        if unread:
            return self.fault(
                NeverReads,
                f"a program that reads its stdin within {seconds:g} s",
                f"a message of which {unread} bytes were not read",
                "read stdin line by line, to the end of each line, in a loop",
            )
        part = f"{len(self.received)} bytes without a line end" if self.received else "nothing"
        return self.fault(
            CallTimeout,
            f"a line of answer within {seconds:g} s",
            f"{part}, from a program that read the whole message",
            "end the answer with a newline and flush stdout; a slow program takes fewer steps a message "
            "(max_steps) or is given more time",
        )

    def fault(self, kind: type[ProgramError], expected: str, received: str, remedy: str) -> ProgramError:
        """An error that carries the end of the program's stderr."""
        if self.stderr in self.selector.get_map():
            self._drain()
        log = "\n".join(_shown(line) for line in bytes(self.log).splitlines())
        return kind(expected=expected, received=received, remedy=remedy, log=log)

    def stop(self, message: bytes) -> str | None:
        """Ask the program to end, and end it; how it ended by itself, None where it did not."""
        with suppress(OSError):
            os.write(self.stdin, message)
        if self.process.stdin:
            self.process.stdin.close()
        try:
            return self.status(STOP_GRACE)
        finally:
            self.end()

    def end(self) -> None:
        """End the whole process group now."""
        self.finish()


def _kill(process: subprocess.Popen[bytes], selector: selectors.BaseSelector, owner: int) -> None:
    if os.getpid() != owner:
        return  # a forked copy of this process: the child is not its own
    # PermissionError is what macOS says of a group of zombies.
    with suppress(ProcessLookupError, PermissionError):
        os.killpg(process.pid, signal.SIGKILL)
    with suppress(subprocess.TimeoutExpired):
        process.wait(5.0)
    selector.close()
    for pipe in (process.stdin, process.stdout, process.stderr):
        if pipe:
            pipe.close()


class Program:
    """A command that speaks the protocol, started when it is asked and has not been, or has failed."""

    def __init__(
        self,
        command: str,
        *,
        call_timeout: float = 10.0,
        start_timeout: float = 60.0,
        run_timeout: float | None = None,
        line_limit: int = LINE_LIMIT,
    ) -> None:
        self.command, self.argv, self.line_limit = command, _split(command), line_limit
        self.call_timeout, self.start_timeout, self.run_timeout = call_timeout, start_timeout, run_timeout
        self.until = float("inf") if run_timeout is None else time.monotonic() + run_timeout
        self.child: _Child | None = None
        self.said: Hello | None = None
        self.closed = False
        self.sent = ""  # the last line, for `check_protocol`
        self.lock = threading.Lock()

    def hello(self) -> Hello:
        """What the program says of itself; starts it."""
        with self.lock:
            self._running()
            assert self.said is not None
            return self.said

    def ask(self, body: str) -> tuple[str, Any]:
        """The answer to a message with these members beside its id: ("y_next" | "skip" | "error", value)."""
        with self.lock:
            child = self._running()
            answer = self._exchange(child, body, self.call_timeout)
            given = [key for key in ("y_next", "skip", "error") if key in answer]
            if len(given) != 1 or (given[0] != "y_next" and not isinstance(answer[given[0]], str)):
                raise child.fault(
                    BadAnswer,
                    'exactly one of "y_next": [states], "skip": "reason", "error": "reason"',
                    _shown(json.dumps(answer).encode()),
                    "see docs/protocol.md",
                )
            return given[0], answer[given[0]]

    def stop(self, say: bool = True) -> str | None:
        """End the program, by word or by the end of its input; how it ended, None where it had to be killed."""
        with self.lock:
            child, self.child = self.child, None
            if child is None or child.owner != os.getpid():
                return None
            self.sent = f'{{"id":{child.count},"type":"stop"}}' if say else "(end of stdin)"
            return child.stop(self.sent.encode() + b"\n" if say else b"")

    def _running(self) -> _Child:
        if self.closed:
            raise UsageError(
                expected="a call within `with load_program(…)`",
                received="a call after it",
                remedy="move the call into the block",
            )
        # After a fork the pipes belong to the parent: this process starts a program of its own.
        if self.child is None or self.child.owner != os.getpid():
            self.child = _Child(self.argv, self.line_limit)
            answer = self._exchange(self.child, f'"type":"hello","protocol":{PROTOCOL}', self.start_timeout)
            try:
                self.said = read_hello(answer)
            except ProgramError:
                self.abandon()
                raise
        return self.child

    def _exchange(self, child: _Child, body: str, seconds: float) -> dict[str, Any]:
        number, left = child.count, self.until - time.monotonic()
        child.count += 1
        self.sent = f'{{"id":{number},{body}}}'
        try:
            if left <= 0:
                raise self._out_of_time()
            line = child.exchange(self.sent.encode() + b"\n", min(seconds, left))
            return _decode(child, line, number)
        except (CallTimeout, NeverReads):
            self.abandon()
            if left < seconds:
                raise self._out_of_time() from None
            raise
        except BaseException:  # an interrupt too leaves an answer on its way that nobody waits for
            self.abandon()
            raise

    def abandon(self) -> None:
        """End the program at once; the next call starts a fresh one."""
        if self.child is not None:
            self.child.end()
            self.child = None

    def _out_of_time(self) -> RunTimeout:
        return RunTimeout(
            expected=f"a run of at most {self.run_timeout:g} s",
            received="a call after that time",
            remedy="give the run more time, or ask for fewer laws, examples or paths",
        )

    def scheme(self) -> Scheme:
        """The program as a scheme."""
        said = self.hello()
        return Scheme(
            name=said.scheme,
            step=self.step,
            claims=said.claims,
            source=said.source or f"the program {_clean(self.command)}",
            mean_square_order=said.mean_square_order,
            weak_order=said.weak_order,
            solver_tolerance=said.solver_tolerance,
            truncation=said.truncation,
            batched=True,
        )

    def step(self, problem: Problem, y: Array, h: float, dW: Array) -> Array:
        """One step of the program, for y of shape (d,) or (d, M) and dW of shape (m,) or (m, M).

        Raises
        ------
        Skipped
            Where the program does not take the problem.
        StepRefused
            Where it says that the step cannot be made; of a batch it is not known which.
        WrongShape, NotFinite
            For states that break the contract of ``step``.
        ProgramError
            For everything that breaks the protocol.
        """
        state, noise = as_lanes(problem, y, h, dW)
        said = self.hello()
        head = f'"type":"step","problem":{_travelling(problem, said)},"steps":['
        texts = [
            f'{{"y":{_row(a)},"h":"{float(h).hex()}","dW":{_row(b)}}}'
            for a, b in zip(state.T.tolist(), noise.T.tolist(), strict=True)
        ]
        rows: list[list[float]] = []
        size = min(said.max_steps, MOST_STEPS)
        for first in range(0, len(texts), size):
            part = texts[first : first + size]
            kind, answer = self.ask(head + ",".join(part) + "]")
            if kind == "error":
                delta = float(problem.random_step(h, noise)[first])
                raise StepRefused(problem=problem.name, y=state[:, first], delta=delta, reason=_clean(answer))
            if kind == "skip":
                raise Skipped(_clean(answer))
            rows += _states(answer, len(part), problem.dimension)
        found = np.array(rows, dtype=np.float64).reshape(len(rows), problem.dimension)
        return np.ascontiguousarray(found.T).reshape(np.shape(y))


@contextmanager
def load_program(
    command: str,
    *,
    call_timeout: float = 10.0,
    start_timeout: float = 60.0,
    run_timeout: float | None = None,
    line_limit: int = LINE_LIMIT,
) -> Iterator[Scheme]:
    """The scheme that a program is, for the time of the ``with`` block; its process group ends with it.

    Parameters
    ----------
    command : str
        The program and its arguments, split as a POSIX shell does; no shell is started.
    call_timeout, start_timeout : float
        Seconds for one message and its answer; for the first, which a runtime may need to warm up.
    run_timeout : float, optional
        Seconds for all of them together.

    Raises
    ------
    UsageError
        For a command that cannot be split, or a system without POSIX processes.
    ProgramError
        For a program that cannot be started or does not answer hello as it should.
    """
    program = Program(
        command,
        call_timeout=call_timeout,
        start_timeout=start_timeout,
        run_timeout=run_timeout,
        line_limit=line_limit,
    )
    with _ended_by_signals(program):
        try:
            yield program.scheme()
        finally:
            program.closed = True
            program.stop()


@contextmanager
def _ended_by_signals(program: Program) -> Iterator[None]:
    """SIGTERM and SIGHUP end the program first, where nobody else handles them: they unwind no Python."""

    def end(number: int, _frame: object) -> None:
        program.abandon()
        signal.signal(number, signal.SIG_DFL)
        os.kill(os.getpid(), number)

    main = threading.current_thread() is threading.main_thread()
    taken = [n for n in (signal.SIGTERM, signal.SIGHUP) if main and signal.getsignal(n) is signal.SIG_DFL]
    for number in taken:
        signal.signal(number, end)
    try:
        yield
    finally:
        for number in taken:
            signal.signal(number, signal.SIG_DFL)


def _name(value: Any) -> bool:
    return isinstance(value, str) and 0 < len(value) <= 80 and value.isprintable()


def _names(value: Any) -> bool:
    return isinstance(value, list) and all(map(_name, value))


def _order(value: Any) -> bool:
    return value is None or (type(value) in (int, float) and 0 < value < 100)


def _count(value: Any) -> bool:
    return type(value) is int and value > 0


# What hello may hold. An unknown member is an error: a misspelt one would be a claim that nobody reads.
_HELLO: dict[str, tuple[Callable[[Any], bool], str]] = {
    "id": (lambda _: True, ""),
    "protocol": (lambda v: type(v) is int and v == PROTOCOL, f"the number {PROTOCOL}"),
    "scheme": (_name, "a name of 1 to 80 printable characters"),
    "source": (
        lambda v: isinstance(v, str) and len(v) <= 200 and v.isprintable(),
        "at most 200 printable characters",
    ),
    "claims": (_names, "a list of names of laws"),
    "mean_square_order": (_order, "a number > 0, or null"),
    "weak_order": (_order, "a number > 0, or null"),
    "solver_tolerance": (lambda v: type(v) in (int, float) and 0 <= v < 1, "a number from 0 to 1"),
    "truncation": (lambda v: v is None or _count(v), "an integer ≥ 1, or null"),
    "problems": (_names, "a list of names of problems"),
    "polynomial": (lambda v: type(v) is bool, "true or false"),
    "max_steps": (_count, "an integer ≥ 1"),
}


def read_hello(answer: dict[str, Any]) -> Hello:
    """The record of a hello answer.

    Raises
    ------
    BadAnswer
        For the first member that is missing, unknown, or of another type.
    """
    remedy = "see docs/protocol.md"
    for key, value in answer.items():
        test, text = _HELLO.get(key, (lambda _: False, f"one of the members {', '.join(_HELLO)}"))
        if not test(value):
            raise BadAnswer(
                expected=f"{key} in hello: {text}", received=_clean(json.dumps({key: value})), remedy=remedy
            )
    for key in ("protocol", "scheme"):
        if key not in answer:
            raise BadAnswer(expected=f"{key} in hello", received=_clean(json.dumps(answer)), remedy=remedy)
    if not answer.get("problems") and not answer.get("polynomial"):
        raise BadAnswer(
            expected="problems in hello, or polynomial, or both: what the program can be asked",
            received="neither",
            remedy='say "polynomial": true, or name some of the problems of docs/protocol.md',
        )
    known: dict[str, Any] = {
        k: tuple(v) if isinstance(v, list) else v for k, v in answer.items() if k != "id"
    }
    return Hello(**known)


def _decode(child: _Child, line: bytes, number: int) -> dict[str, Any]:
    def reject(constant: str) -> None:
        raise ValueError(f"{constant} is not JSON")

    try:
        answer = json.loads(line.decode(), parse_constant=reject)
    except (ValueError, RecursionError) as error:
        raise child.fault(
            NotJson,
            "a line of JSON in UTF-8",
            f"{_shown(line)} ({error})",
            "stdout is for answers alone, logs go to stderr; a step without result is answered with error",
        ) from None
    if not isinstance(answer, dict):
        raise child.fault(BadAnswer, "a JSON object", _shown(line), "see docs/protocol.md")
    if type(answer.get("id")) is not int or answer["id"] != number:
        raise child.fault(
            WrongId,
            f'the answer to message {number}, with "id": {number}',
            _shown(line),
            "copy the id of the message; one answer to each message, in their order",
        )
    return answer


def _states(answer: Any, count: int, d: int) -> list[list[float]]:
    """The states of an answer to `count` steps in d dimensions."""
    rows = answer if isinstance(answer, list) else []
    if len(rows) != count or any(not isinstance(row, list) or len(row) != d for row in rows):
        shape = [len(row) if isinstance(row, list) else type(row).__name__ for row in rows]
        raise WrongShape(
            expected=f"y_next: a list of {count} states of {d} numbers each",
            received=f"{len(rows)} states, of {shape!s:.80} numbers" if rows else f"{answer!r:.80}",
            remedy="answer every step of the message, in order",
        )
    return [[_double(v) for v in row] for row in rows]


def _double(text: Any) -> float:
    number = isinstance(text, str) and _HEX(text)
    if number:
        try:
            return float.fromhex(text)
        except OverflowError:
            pass
    if number or (isinstance(text, str) and _NOT_FINITE(text)):
        raise NotFinite(
            expected="finite numbers in y_next",
            received=text[:80],
            remedy='answer "error" with a reason where a step cannot be made',
        )
    raise BadAnswer(
        expected='a double as a hex float in a string, such as "0x1.8p+1" for 3',
        received=_clean(f"{text!r}"),
        remedy="print doubles as C's %a does: decimal text loses bits unless both sides take care",
    )


def _travelling(problem: Problem, said: Hello) -> str:
    """The problem as JSON, if the program takes it."""
    data = problem.data
    if data is None:
        raise Skipped(f"the problem {problem.name} is made of Python functions, which cannot travel")
    if isinstance(data, NamedProblem) and data.name not in said.problems:
        raise Skipped(f"the program does not name the problem {data.name} in hello")
    if isinstance(data, PolynomialSystem) and not said.polynomial:
        raise Skipped("the program does not take polynomial problems")
    return _problem_text(data)


@lru_cache(maxsize=64)
def _problem_text(data: PolynomialSystem | NamedProblem) -> str:
    return json.dumps(problem_to_json(data), separators=(",", ":"))


def _row(values: Iterable[float]) -> str:
    return "[" + ",".join(f'"{v.hex()}"' for v in values) + "]"


def _split(command: str) -> list[str]:
    try:
        argv = shlex.split(command)
    except ValueError as error:
        raise UsageError(
            expected="a command", received=f"{command!r}: {error}", remedy="close the quote"
        ) from None
    if not argv:
        raise UsageError(expected="a command", received=repr(command), remedy="name a program: ./program")
    if os.name != "posix":
        raise UsageError(
            expected="a POSIX system, for process groups and pipes with deadlines",
            received=os.name,
            remedy="run it there, or wrap the program as a Python function step(problem, y, h, dW)",
        )
    return argv


def _unread(fd: int) -> int:
    """Bytes in the pipe that the child has not read; 0 where the system does not say."""
    import fcntl
    import termios

    try:
        return int.from_bytes(fcntl.ioctl(fd, termios.FIONREAD, bytes(4)), "little")
    except OSError:
        return 0


def _signal_name(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:
        return str(number)


def _shown(line: bytes, most: int = 200) -> str:
    return _clean(line.decode(errors="backslashreplace"), most)


def _clean(text: str, most: int = 200) -> str:
    """A program's text for a terminal or a page: no control characters, not endless."""
    safe = "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text[:most])
    return safe + ("…" if len(text) > most else "")


class Check(NamedTuple):
    """One check of the protocol: the line sent, whether the answer is right, and what it is or lacks."""

    line: str
    ok: bool
    message: str


def check_protocol(
    command: str,
    *,
    call_timeout: float = 10.0,
    start_timeout: float = 60.0,
    laws: Iterable[str] | None = None,
) -> list[Check]:
    """Speak to a program as `load_program` does, and say of every line what is right or wrong.

    It stops after a failed start or hello, since no answer means anything then.

    Parameters
    ----------
    laws : iterable of str, optional
        The names that claims may have.
    """
    program = Program(command, call_timeout=call_timeout, start_timeout=start_timeout)
    checks: list[Check] = []

    def check(trial: Callable[[Program], str]) -> bool:
        program.sent = ""
        try:
            ok, message = True, trial(program)
        except Skipped as skipped:
            ok, message = True, str(skipped)
        except SepvError as error:
            ok, message = False, str(error)
        checks.append(Check(program.sent or f"(start of {command})", ok, message))
        return ok

    try:
        if check(lambda p: _try_hello(p, None if laws is None else set(laws))):
            for trial in (*_sample_trials(program.hello()), _try_stranger, _try_word, _try_stop, _try_end):
                check(trial)
    finally:
        program.stop()
    return checks


def describe(checks: Iterable[Check]) -> str:
    """The checks for a reader, one after the other."""
    lines = []
    for n, check in enumerate(checks, 1):
        shown = check.line if len(check.line) <= 160 else f"{check.line[:160]}… ({len(check.line)} bytes)"
        lines.append(f"{n:2} {'ok  ' if check.ok else 'FAIL'} > {shown}")
        lines += [f"          {text}" for text in check.message.splitlines()]
    return "\n".join(lines)


def _try_hello(program: Program, laws: set[str] | None) -> str:
    from sepv.problems import NAMED

    said = program.hello()
    for key, names, known in (("claims", said.claims, laws), ("problems", said.problems, set(NAMED))):
        strange = sorted(set(names) - known) if known is not None else []
        if strange:
            raise BadAnswer(
                expected=f"{key} in hello: some of {', '.join(sorted(known or ()))}",
                received=", ".join(strange),
                remedy="correct the name, or leave it out",
            )
    takes = [*said.problems, *["polynomial data"] * said.polynomial]
    return (
        f"{said.scheme} takes {', '.join(takes)}, {said.max_steps} steps a message, "
        f"and claims {', '.join(said.claims) or 'no law'}"
    )


def _sample_trials(said: Hello) -> Iterator[Callable[[Program], str]]:
    """One step, the same again, and several in one message, for problems that the program says it takes."""
    from sepv import problems
    from sepv.polynomial import polynomial

    samples = [problems.by_name(name) for name in said.problems]
    if said.polynomial:
        H = polynomial(3, [((2, 0, 0), 0.5), ((0, 2, 0), 0.5), ((1, 0, 3), 0.25)])
        B = (
            (0, 1, polynomial(3, [((0, 0, 1), -1.0)])),
            (1, 2, polynomial(3, [((0, 0, 0), 2.0), ((1, 1, 0), 1.0)])),
        )
        samples += [problems.build(PolynomialSystem(3, H, B, noise)) for noise in ((), (1.0, 0.5))]
    for problem in samples:
        start = np.array(problem.initial if problem.initial is not None else (1.0, 0.5, -0.25))
        noise = np.linspace(0.25, -0.125, problem.noises)
        yield partial(_try_step, problem, start, 0.0625, noise)
        if said.max_steps > 1:
            yield partial(_try_batch, problem, start, 0.0625, noise)


def _try_step(problem: Problem, y: Array, h: float, dW: Array, program: Program) -> str:
    first, second = program.step(problem, y, h, dW), program.step(problem, y, h, dW)
    _same(first, second, "the same bits for the same message sent again", "keep no state between messages")
    return f"{problem.name}: y_next = {first.tolist()}, and the same again"


def _try_batch(problem: Problem, y: Array, h: float, dW: Array, program: Program) -> str:
    count = min(program.hello().max_steps, MOST_STEPS)
    factors = 1 + 0.25 * np.arange(count) / count
    batch = program.step(problem, y[:, None] * factors, h, np.repeat(dW[:, None], count, axis=1))
    size = len(program.sent)
    alone = program.step(problem, y * factors[-1], h, dW)
    _same(
        batch[:, -1],
        alone,
        "the same bits for a step alone and in a message of many",
        "treat steps one by one",
    )
    return f"{problem.name}: {count} steps in a message of {size} bytes, the last as alone"


def _same(one: Array, other: Array, expected: str, remedy: str) -> None:
    if not np.array_equal(one, other):
        raise SchemeFault(expected=expected, received=f"{one.tolist()} and {other.tolist()}", remedy=remedy)


def _refused(program: Program, body: str, kind: str, why: str) -> str:
    given, answer = program.ask(body)
    if given != kind:
        raise BadAnswer(
            expected=f'"{kind}": "reason", {why}',
            received=given,
            remedy="answer what the program does not know",
        )
    return f"{kind}: {_clean(answer)}"


def _try_stranger(program: Program) -> str:
    problem, steps = '{"name":"no-such-problem","parameters":{}}', '[{"y":[],"h":"0x1p+0","dW":[]}]'
    body = f'"type":"step","problem":{problem},"steps":{steps}'
    return _refused(program, body, "skip", "for a problem that the program does not have")


def _try_word(program: Program) -> str:
    return _refused(program, '"type":"no-such-type"', "error", "for a message of an unknown type")


def _try_stop(program: Program) -> str:
    program.hello()
    return _ended(program.stop(), "stop")


def _try_end(program: Program) -> str:
    program.hello()
    return _ended(program.stop(say=False), "the end of stdin")


def _ended(status: str | None, event: str) -> str:
    if status != "exit code 0":
        raise BadAnswer(
            expected=f"exit code 0 within {STOP_GRACE:g} s of {event}",
            received=status or "a running program",
            remedy="leave the loop over lines there, and end",
        )
    return f"ended with {status}"
