"""The JSON lines of the protocol (docs/protocol.md), read strictly and written without loss of
bits.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from sepv._arguments import hex_float, parse_json
from sepv.errors import Skipped
from sepv.external._child import ProgramChild
from sepv.external._errors import BadAnswer, NotFiniteAnswer, NotJson, WrongId, WrongShape, clean, shown
from sepv.problem import NamedProblem, PolynomialSystem, Problem, problem_to_json
from sepv.schemes import NORMAL, POINT_LAWS

PROTOCOL = 1
# The largest number of steps in a message, also if a program accepts more.
MESSAGE_MAX_STEPS = 1024


@dataclass(frozen=True)
class Hello:
    """A program's description of itself; the fields are those of docs/protocol.md."""

    scheme: str
    protocol: int = PROTOCOL
    source: str = ""
    claims: tuple[str, ...] = ()
    mean_square_order: float | None = None
    weak_order: float | None = None
    order: float | None = None
    solver_tolerance: float = 0.0
    truncation: int | None = 2
    increments: str = NORMAL
    problems: tuple[str, ...] = ()
    polynomial: bool = False
    max_steps: int = 1


def _name(value: Any) -> bool:
    return isinstance(value, str) and 0 < len(value) <= 80 and value.isprintable()


def _names(value: Any) -> bool:
    return isinstance(value, list) and all(map(_name, value))


def _order(value: Any) -> bool:
    return value is None or (type(value) in (int, float) and 0 < value < 100)


def _count(value: Any) -> bool:
    return type(value) is int and value > 0


# Allowed members of hello. An unknown member is an error, because a misspelt one would be a lost
# claim.
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
    "order": (_order, "a number > 0, or null"),
    "solver_tolerance": (lambda v: type(v) in (int, float) and 0 <= v < 1, "a number from 0 to 1"),
    "truncation": (lambda v: v is None or _count(v), "an integer ≥ 1, or null"),
    "increments": (lambda v: v in POINT_LAWS, f"one of {', '.join(POINT_LAWS)}"),
    "problems": (_names, "a list of names of problems"),
    "polynomial": (lambda v: type(v) is bool, "true or false"),
    "max_steps": (_count, "an integer ≥ 1"),
}


def read_hello(answer: dict[str, Any]) -> Hello:
    """Read the answer to hello. Raise BadAnswer for the first member that is missing,
    unknown or of another type.
    """
    remedy = "see docs/protocol.md"
    for key, value in answer.items():
        test, text = _HELLO.get(key, (lambda _: False, f"one of the members {', '.join(_HELLO)}"))
        if not test(value):
            raise BadAnswer(
                expected=f"{key} in hello: {text}", received=clean(json.dumps({key: value})), remedy=remedy
            )
    for key in ("protocol", "scheme"):
        if key not in answer:
            raise BadAnswer(expected=f"{key} in hello", received=clean(json.dumps(answer)), remedy=remedy)
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


def decode(child: ProgramChild, line: bytes, number: int) -> dict[str, Any]:
    """Read the JSON object with which a program answers message `number`. Raise NotJson,
    BadAnswer or WrongId.
    """
    try:
        answer = parse_json(line)
    except ValueError as error:
        raise child.fault(
            NotJson,
            "a line of JSON in UTF-8",
            f"{shown(line)} ({error})",
            "stdout is for answers alone, logs go to stderr; a step without result is answered with error",
        ) from None
    if not isinstance(answer, dict):
        raise child.fault(BadAnswer, "a JSON object", shown(line), "see docs/protocol.md")
    if type(answer.get("id")) is not int or answer["id"] != number:
        raise child.fault(
            WrongId,
            f'the answer to message {number}, with "id": {number}',
            shown(line),
            "copy the id of the message; one answer to each message, in their order",
        )
    return answer


def states(answer: Any, count: int, d: int) -> list[list[float]]:
    """Read y_next, the states after `count` steps in d dimensions. Raise WrongShape,
    BadAnswer or NotFinite.
    """
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
    try:
        number = hex_float(text)
    except ValueError:
        raise BadAnswer(
            expected='a double as a hex float in a string, such as "0x1.8p+1" for 3',
            received=clean(f"{text!r}"),
            remedy="print doubles as C's %a does: decimal text loses bits unless both sides take care",
        ) from None
    if not math.isfinite(number):
        raise NotFiniteAnswer(
            expected="finite numbers in y_next",
            received=text[:80],
            remedy='answer "error" with a reason where a step cannot be made',
        )
    return number


def travelling(problem: Problem, greeting: Hello) -> str:
    """Write a problem as JSON text. Raise Skipped if it is not given as data or the program does
    not support it.
    """
    data = problem.data
    if data is None:
        raise Skipped(f"the problem {problem.name} is made of Python functions, which cannot travel")
    if isinstance(data, NamedProblem) and data.name not in greeting.problems:
        raise Skipped(f"the program does not name the problem {data.name} in hello")
    if isinstance(data, PolynomialSystem) and not greeting.polynomial:
        raise Skipped("the program does not take polynomial problems")
    return _problem_text(data)


@lru_cache(maxsize=64)
def _problem_text(data: PolynomialSystem | NamedProblem) -> str:
    return json.dumps(problem_to_json(data), separators=(",", ":"))


def row(values: Iterable[float]) -> str:
    """Write numbers as a JSON list of hex floats."""
    return "[" + ",".join(f'"{v.hex()}"' for v in values) + "]"
