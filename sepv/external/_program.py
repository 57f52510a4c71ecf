"""Run a program in any language as a scheme: start it at the first call, restart it after a fault,
always end it.
"""

from __future__ import annotations

import json
import os
import shlex
import signal
import threading
import time
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

import numpy as np

from sepv.errors import ProtocolWarning, Skipped, UsageError
from sepv.external import _errors as errors
from sepv.external._child import LINE_LIMIT, STOP_GRACE, ProgramChild
from sepv.external._errors import StepRefused, clean, shown
from sepv.external._messages import (
    MESSAGE_MAX_STEPS,
    PROTOCOL,
    Hello,
    decode,
    read_hello,
    row,
    states,
    travelling,
)
from sepv.problem import Array, Problem
from sepv.problems import PAPER
from sepv.schemes import Scheme, as_lanes

# The exit status of a program that keeps rule 7.
GOOD_END = "exit code 0"


class Program:
    """A program that keeps the protocol of docs/protocol.md. It is started at the first call,
    and after a failure.
    """

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
        self.child: ProgramChild | None = None
        self.said: Hello | None = None
        self.closed = False
        self.sent = ""  # the last line sent, for `check_protocol`
        self.lock = threading.Lock()

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle only the command and the limits, so that another process starts its own program at
        its first call.
        """
        left = None if self.run_timeout is None else max(0.0, self.until - time.monotonic())
        timed = partial(Program, call_timeout=self.call_timeout, start_timeout=self.start_timeout)
        return partial(timed, run_timeout=left, line_limit=self.line_limit), (self.command,)

    def hello(self) -> Hello:
        """Return the program's description of itself. If the program does not run, start it."""
        with self.lock:
            self._running()
            assert self.said is not None
            return self.said

    def ask(self, body: str) -> tuple[str, Any]:
        """Send a message with a new id and the JSON text `body`;
        return the answer's kind ("y_next", …) and value.
        """
        with self.lock:
            child = self._running()
            answer = self._exchange(child, body, self.call_timeout)
            given = [key for key in ("y_next", "skip", "error") if key in answer]
            if len(given) != 1 or (given[0] != "y_next" and not isinstance(answer[given[0]], str)):
                raise child.fault(
                    errors.BadAnswer,
                    'exactly one of "y_next": [states], "skip": "reason", "error": "reason"',
                    shown(json.dumps(answer).encode()),
                    "see docs/protocol.md",
                )
            return given[0], answer[given[0]]

    def stop(self, say: bool = True) -> str:
        """End the program by a message or by closing its input; return how it ended,
        or "" if none was running.
        """
        with self.lock:
            child, self.child = self.child, None
            if child is None or child.owner != os.getpid():
                return ""
            self.sent = f'{{"id":{child.count},"type":"stop"}}' if say else "(end of stdin)"
            ended = child.stop(self.sent.encode() + b"\n" if say else b"", STOP_GRACE)
            return ended or f"no end within {STOP_GRACE:g} s"

    def _running(self) -> ProgramChild:
        if self.closed:
            raise UsageError(
                expected="a call within `with load_program(…)`",
                received="a call after it",
                remedy="move the call into the block",
            )
        # After a fork the pipes belong to the parent, so this process starts another program.
        if self.child is None or self.child.owner != os.getpid():
            self.child = ProgramChild(self.argv, self.line_limit)
            answer = self._exchange(self.child, f'"type":"hello","protocol":{PROTOCOL}', self.start_timeout)
            try:
                self.said = read_hello(answer)
            except errors.ProgramError:
                self.abandon()
                raise
        return self.child

    def _exchange(self, child: ProgramChild, body: str, seconds: float) -> dict[str, Any]:
        number, left = child.count, self.until - time.monotonic()
        child.count += 1
        self.sent = f'{{"id":{number},{body}}}'
        try:
            if left <= 0:
                raise self._out_of_time()
            line = child.exchange(self.sent.encode() + b"\n", min(seconds, left))
            return decode(child, line, number)
        except (errors.CallTimeout, errors.NeverReads):
            self.abandon()
            if left < seconds:
                raise self._out_of_time() from None
            raise
        except BaseException:  # an interrupt also leaves an answer in the pipe
            self.abandon()
            raise

    def abandon(self) -> None:
        """Kill the program at once. The next call starts a new one."""
        if self.child is not None:
            self.child.end()
            self.child = None

    def _out_of_time(self) -> errors.RunTimeout:
        return errors.RunTimeout(
            expected=f"a run of at most {self.run_timeout:g} s",
            received="a call after that time",
            remedy="give the run more time, or ask for fewer laws, examples or paths",
        )

    def scheme(self) -> Scheme:
        """Return the program as a scheme."""
        greeting = self.hello()
        return Scheme(
            name=greeting.scheme,
            step=self.step,
            claims=greeting.claims,
            source=greeting.source or f"the program {clean(self.command)}",
            mean_square_order=greeting.mean_square_order,
            weak_order=greeting.weak_order,
            order=greeting.order,
            solver_tolerance=greeting.solver_tolerance,
            truncation=greeting.truncation,
            increments=greeting.increments,
            batched=True,
            # A program without polynomial problems is restricted to its named ones, or a search
            # would waste cases.
            problems=()
            if greeting.polynomial
            else tuple(name for name in greeting.problems if name in PAPER),
        )

    def step(self, problem: Problem, y: Array, h: float, dW: Array) -> Array:
        """Make one step with the program, for y of shape (d,) or (d, M) and dW of shape (m,)
        or (m, M).

        Raises
        ------
        Skipped
            If the program refuses the problem.
        StepRefused
            If the program reports that the step cannot be made. In a batch the failing state is not
            known.
        WrongShape, NotFinite
            If states break the contract of ``step``.
        ProgramError
            If the program breaks the protocol.
        """
        state, noise = as_lanes(problem, y, h, dW)
        greeting = self.hello()
        head = f'"type":"step","problem":{travelling(problem, greeting)},"steps":['
        texts = [
            f'{{"y":{row(a)},"h":"{float(h).hex()}","dW":{row(b)}}}'
            for a, b in zip(state.T.tolist(), noise.T.tolist(), strict=True)
        ]
        rows: list[list[float]] = []
        size = min(greeting.max_steps, MESSAGE_MAX_STEPS)
        for first in range(0, len(texts), size):
            part = texts[first : first + size]
            kind, answer = self.ask(head + ",".join(part) + "]")
            if kind == "error":
                delta = float(problem.random_step(h, noise)[first])
                raise StepRefused(problem=problem.name, y=state[:, first], delta=delta, reason=clean(answer))
            if kind == "skip":
                raise Skipped(clean(answer))
            rows += states(answer, len(part), problem.dimension)
        y1 = np.array(rows, dtype=np.float64).reshape(len(rows), problem.dimension)
        return np.ascontiguousarray(y1.T).reshape(np.shape(y))


@contextmanager
def load_program(
    command: str,
    *,
    call_timeout: float = 10.0,
    start_timeout: float = 60.0,
    run_timeout: float | None = None,
    line_limit: int = LINE_LIMIT,
) -> Iterator[Scheme]:
    """Run a program as a scheme during a ``with`` block.
    The end of the block ends its process group.

    Parameters
    ----------
    command : str
        The program and its arguments, split as by a POSIX shell, but no shell is started.
    call_timeout, start_timeout : float
        Seconds for one message and its answer, and for the first message, which has its own limit
        for slow starts.
    run_timeout : float, optional
        Seconds for all messages together.

    Raises
    ------
    UsageError
        If the command cannot be split, or the system has no POSIX processes.
    ProgramError
        If the program cannot be started or does not answer hello as the protocol demands.

    Warns
    -----
    ProtocolWarning
        If the program does not end with exit code 0 after the last call, though no call failed.
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
        except BaseException:
            program.closed = True
            program.stop()
            raise
        program.closed = True
        if (how := program.stop()) not in ("", GOOD_END):
            warnings.warn(
                f"the program {clean(command)} broke rule 7 of docs/protocol.md: {how} after stop, and not {GOOD_END}",
                ProtocolWarning,
                stacklevel=3,
            )


@contextmanager
def _ended_by_signals(program: Program) -> Iterator[None]:
    """End the program at SIGTERM and SIGHUP, which unwind no Python code,
    unless they have another handler.

    The handlers of several programs follow each other: each ends its own program, and sends the
    signal again.
    """

    def end(number: int, _frame: object) -> None:
        program.abandon()
        signal.signal(number, before[number])
        os.kill(os.getpid(), number)

    main = threading.current_thread() is threading.main_thread()
    before: dict[int, Any] = {
        n: h for n in (signal.SIGTERM, signal.SIGHUP) if main and _ends(h := signal.getsignal(n))
    }
    for number in before:
        signal.signal(number, end)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _ends(handler: Any) -> bool:
    """True for a signal's handler that ends this process: the system's,
    or one of `_ended_by_signals`.
    """
    return handler is signal.SIG_DFL or getattr(handler, "__module__", "") == __name__


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
