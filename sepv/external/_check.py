"""Line-by-line check that a program keeps the protocol (docs/protocol.md),
for those who write such a program.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from functools import partial
from typing import NamedTuple

import numpy as np

from sepv._arguments import did_you_mean
from sepv.errors import SchemeFault, SepvError, Skipped, unknown_name
from sepv.external._child import STOP_GRACE
from sepv.external._errors import BadAnswer, StepRefused, clean
from sepv.external._messages import MESSAGE_MAX_STEPS, Hello
from sepv.external._program import GOOD_END, Program
from sepv.problem import Array, PolynomialSystem, Problem

_AS_READ = (
    "print y, h and dW as the program read them: they are strings with hex floats (docs/protocol.md, Numbers)"
)


class Check(NamedTuple):
    """One check of the protocol: the line sent, True if the answer is right,
    and the answer or its defect.
    """

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
    """Send messages to a program, which is started as by `load_program`,
    and report each answer as right or wrong.

    The check stops after a failed start or a wrong answer to "hello", because no later answer means
    anything.

    Parameters
    ----------
    laws : iterable of str, optional
        The names of laws that the program may claim.
    """
    program = Program(command, call_timeout=call_timeout, start_timeout=start_timeout)
    checks: list[Check] = []

    def check(trial: Callable[[Program], str]) -> bool:
        program.sent = ""
        try:
            ok, message = True, trial(program)
        except Skipped as skipped:
            ok, message = True, str(skipped)
        except StepRefused as refused:
            ok, message = False, _of_refused(refused)
        except SepvError as error:
            ok, message = False, str(error)
        checks.append(Check(program.sent or f"(start of {command})", ok, message))
        return ok

    try:
        if check(lambda p: _try_hello(p, None if laws is None else set(laws))):
            for trial in (*_sample_trials(program.hello()), *_LAST_TRIALS):
                check(trial)
    finally:
        program.stop()
    return checks


def _of_refused(refused: StepRefused) -> str:
    """The message for a sample step that the program refused. Every scheme can make it,
    so that h is not to blame.
    """
    y = np.asarray(refused.y).tolist()
    return (
        f"{refused.status}\n"
        f'This is the "error" of the program for a step of {refused.problem} from y = {y} with Δ = '
        f"{refused.delta!r}, which a scheme can make.\n"
        f"Remedy: {_AS_READ}."
    )


def describe(checks: Iterable[Check]) -> str:
    """Format the checks as text, in order: each has "ok" or "FAIL", the line sent,
    and the answer or its defect.
    """
    lines = []
    for n, check in enumerate(checks, 1):
        shown = check.line if len(check.line) <= 160 else f"{check.line[:160]}… ({len(check.line)} bytes)"
        lines.append(f"{n:2} {'ok  ' if check.ok else 'FAIL'} > {shown}")
        lines += [f"          {text}" for text in check.message.splitlines()]
    return "\n".join(lines)


def _try_hello(program: Program, laws: set[str] | None) -> str:
    from sepv.problems import PAPER

    greeting = program.hello()
    for key, names, known in (("claims", greeting.claims, laws), ("problems", greeting.problems, set(PAPER))):
        for strange in sorted(set(names) - known) if known is not None else ():
            said = did_you_mean(strange, known or ())
            error = unknown_name(
                f"{key} in hello", said, sorted(known or ()), "correct the name, or leave it out"
            )
            raise BadAnswer(expected=error.expected, received=error.received, remedy=error.remedy)
    takes = [*greeting.problems, *["polynomial data"] * greeting.polynomial]
    return (
        f"{greeting.scheme} takes {', '.join(takes)}, {greeting.max_steps} steps a message, "
        f"and claims {', '.join(greeting.claims) or 'no law'}"
    )


def _sample_trials(greeting: Hello) -> Iterator[Callable[[Program], str]]:
    """Yield tests for each problem of the program: a step sent twice,
    and several steps in one message.
    """
    from sepv import problems
    from sepv.record import polynomial

    samples = [problems.by_name(name) for name in greeting.problems]
    if greeting.polynomial:
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
        if greeting.max_steps > 1:
            yield partial(_try_batch, problem, start, 0.0625, noise)


def _try_step(problem: Problem, y: Array, h: float, dW: Array, program: Program) -> str:
    first, second = program.step(problem, y, h, dW), program.step(problem, y, h, dW)
    _same(first, second, "the same bits for the same message sent again", "keep no state between messages")
    if not first.any():
        raise SchemeFault(
            expected=f"a state near y = {y.tolist()} after a step of h = {h:g}",
            received="y_next = 0 in each component",
            remedy=_AS_READ,
        )
    return f"{problem.name}: y_next = {first.tolist()}, and the same again"


def _try_batch(problem: Problem, y: Array, h: float, dW: Array, program: Program) -> str:
    count = min(program.hello().max_steps, MESSAGE_MAX_STEPS)
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


def _try_refused(body: str, kind: str, why: str, program: Program) -> str:
    given, answer = program.ask(body)
    if given != kind:
        raise BadAnswer(
            expected=f'"{kind}": "reason", {why}',
            received=given,
            remedy="answer what the program does not know",
        )
    return f"{kind}: {clean(answer)}"


def _try_end(say: bool, event: str, program: Program) -> str:
    program.hello()
    status = program.stop(say)
    if status != GOOD_END:
        raise BadAnswer(
            expected=f"{GOOD_END} within {STOP_GRACE:g} s of {event}",
            received=status,
            remedy="leave the loop over lines there, and end",
        )
    return f"ended with {status}"


_LAST_TRIALS: tuple[Callable[[Program], str], ...] = (
    partial(
        _try_refused,
        '"type":"step","problem":{"name":"no-such-problem","parameters":{}},"steps":[{"y":[],"h":"0x1p+0","dW":[]}]',
        "skip",
        "for a problem that the program does not have",
    ),
    partial(_try_refused, '"type":"no-such-type"', "error", "for a message of an unknown type"),
    partial(_try_end, True, "stop"),
    partial(_try_end, False, "the end of stdin"),
)
