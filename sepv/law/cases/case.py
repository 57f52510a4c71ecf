"""A case (a problem, a state and a step: the input of a law about single steps),
and its forms as JSON and token.
"""

from __future__ import annotations

import base64
import json
import zlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from typing import Any

import numpy as np

from sepv import problems
from sepv._arguments import double, parse_json
from sepv.errors import UsageError, require_one_of
from sepv.files import fault, schema
from sepv.problem import (
    Array,
    Description,
    GivenProblem,
    NamedProblem,
    PolynomialSystem,
    Problem,
    one_field,
    problem_from_json,
    problem_to_json,
)
from sepv.problems.shown_to_schemes import WORDS_OF_VIEWS, as_given
from sepv.schemes import Scheme, load_problem, require_trusted

# The largest unpacked token in bytes, ten times a witness of sixty-four dimensions.
MOST_BYTES = 2**24


# The reason why a law about noise does not apply.
NO_NOISE = "the scheme is for systems without noise, c = ()"


@dataclass(frozen=True, repr=False)
class Case:
    """A problem, a state y (d,), a step h and the Wiener increments dW (m,).

    Attributes
    ----------
    given : str
        How the scheme gets the problem, as data or as functions: one of
        `sepv.problems.shown_to_schemes.WORDS_OF_VIEWS`.
    batch : int
        For laws about batches, the number of states stepped together; if 0, the law chooses it.
    times : int
        For the law "contract", the number of times that the step is repeated; if 0, the law chooses
        it.
    after : int
        The step is divided into `after` + 1 equal steps of a path, of which the law measures those
        in the middle too.
    """

    problem: Description
    y: tuple[float, ...]
    h: float = 0.0
    dW: tuple[float, ...] = ()
    given: str = "data"
    batch: int = 0
    times: int = 0
    after: int = 0

    def build(self) -> tuple[Problem, Array, float, Array]:
        """The arguments (problem, y, h, dW) of ``step``;
        a scheme gets this problem in the form that `given` names.
        """
        problem = as_given(self.problem, self.given)
        return problem, np.array(self.y), self.h, np.array(self.dW, dtype=np.float64)

    def __repr__(self) -> str:
        """H, B, y, h and dW, as in the report of a counterexample."""
        return f"Case({'; '.join(self.describe().splitlines())})"

    def _repr_pretty_(self, printer: Any, _cycle: bool) -> None:
        """Print H, B, y, h and dW in Hypothesis and IPython too,
        which would print each field of a data class.
        """
        printer.text(repr(self))

    def describe(self) -> str:
        """Describe the case in words; `to_json` gives every bit of its numbers."""
        problem = problems.build(self.problem)
        several = not one_field(problem)
        step = 0.0 if several else float(problem.random_step(self.h, np.array(self.dW, dtype=np.float64)))
        return "\n".join(
            [
                *_describe_problem(self.problem),
                *([] if self.given == "data" else [f"given as {self.given}: {WORDS_OF_VIEWS[self.given]}"]),
                f"y = {_row(self.y)}",
                f"h = {self.h!r}, c = {_row(problem.c)}, dW = {_row(self.dW)}"
                + ("" if several else f", so Δ = {step!r}"),
                *([f"in a batch of {self.batch}"] if self.batch else []),
                *([f"asked {self.times} times in a row"] if self.times else []),
                *([f"as {self.after + 1} steps of a path, each a share of h and dW"] if self.after else []),
            ]
        )


def with_noise(case: Case, c: tuple[float, ...], dW: tuple[float, ...]) -> Case:
    """A copy of the case with other noise coefficients c and increments dW."""
    return replace(case, problem=_with_coefficients(case.problem, c), dW=dW)


def with_order(case: Case, order: Sequence[int]) -> Case:
    """The case of a problem given as data or as functions, with the noises of these numbers,
    each with its field and its increment.
    """
    c = problems.build(case.problem).c
    changes: dict[str, Any] = {"noise": tuple(float(c[j]) for j in order)}
    record: Any = case.problem.problem if isinstance(case.problem, GivenProblem) else case.problem
    for key in (f.name for f in fields(record) if f.name.startswith("noise_")):
        if parts := getattr(record, key):
            changes[key] = tuple(parts[j] for j in order)
    other = replace(record, **changes, **({"check": False} if isinstance(record, Problem) else {}))
    problem = GivenProblem(other, case.problem.target) if isinstance(case.problem, GivenProblem) else other
    return replace(case, problem=problem, dW=tuple(case.dW[j] for j in order))


def _with_coefficients(data: Description, c: tuple[float, ...]) -> Description:
    if isinstance(data, PolynomialSystem):
        return replace(data, noise=c)
    if isinstance(data, NamedProblem):
        return NamedProblem(data.name, tuple((k, c if k == "noise" else v) for k, v in data.parameters))
    return _other_noise(data, c)


def quiet(case: Case) -> Case | None:
    """The case without noise, c = (), whose h is the Δ of `case`;
    None if a noise has another field than B∇H.
    """
    if not case.dW:
        return case
    problem, _, h, dW = case.build()
    if not one_field(problem):
        return None
    return replace(with_noise(case, (), ()), h=float(problem.random_step(h, dW)))


@lru_cache(maxsize=256)
def quiet_problem(problem: Problem) -> Problem:
    """The problem without noise, c = (); the same problem always gives the same object."""
    data = None if problem.data is None else _with_coefficients(problem.data, ())
    assert not isinstance(data, GivenProblem)
    own: dict[str, Any] = {key: () for key in _OF_NOISES if len(getattr(problem, key, ()))}
    if own and isinstance(data, PolynomialSystem):
        data = replace(data, noise_vectors=(), noise_hamiltonians=())
    return replace(problem, noise=(), data=data, check=False, **own) if problem.noises else problem


# Parts of a problem with one entry for each noise. Without noise they are empty.
_OF_NOISES = ("noise_vectors", "noise_hamiltonians", "noise_gradients", "noise_hessians", "noise_flows")


@lru_cache(maxsize=256)
def _other_noise(given: GivenProblem, c: tuple[float, ...]) -> GivenProblem:
    return GivenProblem(replace(given.problem, noise=c, check=False), given.target)


def to_json(case: Case) -> dict[str, Any]:
    """Convert a case to a JSON object, with floats in hex."""
    return {
        "problem": problem_to_json(case.problem),
        "y": [v.hex() for v in case.y],
        "h": case.h.hex(),
        "dW": [v.hex() for v in case.dW],
        **({} if case.given == "data" else {"given": case.given}),
        **({"batch": case.batch} if case.batch else {}),
        **({"times": case.times} if case.times else {}),
        **({"after": case.after} if case.after else {}),
    }


def from_json(data: Any, objects: Iterable[Problem] = ()) -> Case:
    """Convert a JSON object of `to_json` to a case; a UsageError for anything else.

    If the problem was given as a Python object, it is found by its name among `objects`.
    """
    require_witness(data)
    case = of_valid(data, objects)
    problem = problems.build(case.problem)
    if (len(case.y), len(case.dW)) != (problem.dimension, problem.noises):
        raise UsageError(
            expected=f"a witness with {problem.dimension} numbers in y and {problem.noises} in dW, as its problem has",
            received=f"{len(case.y)} in y and {len(case.dW)} in dW",
            remedy="copy it whole from a report",
        )
    return case


def require_witness(data: Any) -> None:
    """Raise a UsageError for data that do not obey the schema of witnesses."""
    if wrong := fault(data, schema("witness")):
        raise UsageError(
            expected="a witness: problem, y, h, dW", received=wrong, remedy="copy it whole from a report"
        )


def of_valid(data: dict[str, Any], objects: Iterable[Problem] = ()) -> Case:
    """Convert JSON that obeys the schema of witnesses to a case."""
    given = data.get("given", "data")
    require_one_of("a way to show the problem", given, WORDS_OF_VIEWS, "copy the witness whole from a report")
    problem = data["problem"]
    return Case(
        problem=_given_problem(problem, objects) if "given" in problem else problem_from_json(problem),
        y=tuple(map(double, data["y"])),
        h=double(data["h"]),
        dW=tuple(map(double, data["dW"])),
        given=given,
        batch=int(data.get("batch", 0)),
        times=int(data.get("times", 0)),
        after=int(data.get("after", 0)),
    )


def has_words(witness: Any) -> bool:
    """True if a command can name the problem of a witness;
    False if the problem was given as a Python object.
    """
    problem = witness.get("problem") if isinstance(witness, dict) else None
    return not (isinstance(problem, dict) and problem.get("given") == "")


def require_named(witness: dict[str, Any], scheme: Scheme) -> None:
    """Raise an error if a witness's problem loads code that the user did not name:
    anybody can write a witness.
    """
    problem = witness.get("problem")
    target = problem.get("given") if isinstance(problem, dict) else None
    named = [p if isinstance(p, str) else getattr(p, "text", "") for p in scheme.problems]
    require_trusted([target], named, scheme)


def _given_problem(data: dict[str, Any], objects: Iterable[Problem]) -> GivenProblem:
    """The problem that a stored case names: the one of this name in `objects` if there is one,
    else a loaded one.
    """
    target = data["given"]
    own = [problem for problem in objects if not target and problem.name == data.get("object")]
    if ":" not in target and target not in problems.EXTENSIONS | problems.HAMILTONIANS and len(own) != 1:
        raise UsageError(
            expected="a witness whose problem can be loaded: a name, data, or module:attribute",
            received=f"the problem {target or data.get('object')!r}, which was handed over as an object",
            remedy="in the Python process that has the report: report.replay(LAW); elsewhere measure again with a "
            "problem that has a name: -p module:attribute",
        )
    noise = tuple(map(double, data["noise"]))
    return GivenProblem(replace(own[0] if own else load_problem(target), noise=noise, check=False), target)


def to_token(case: Case) -> str:
    """Encode the case as a short text for a command line; `from_token` restores it to the bit."""
    packed = zlib.compress(json.dumps(to_json(case), separators=(",", ":")).encode(), 9)
    return base64.urlsafe_b64encode(packed).decode().rstrip("=")


def from_token(token: str) -> Case:
    """Decode a token; a UsageError for a text that is not a whole token."""
    return from_json(witness_of(token))


def witness_of(token: str) -> dict[str, Any]:
    """Decode a token to JSON and validate it as a witness; unlike `from_json` it imports
    nothing.
    """
    try:
        packed = base64.urlsafe_b64decode(token + "=" * (-len(token) % 4))
        data = parse_json(_unpacked(packed))
    except (ValueError, zlib.error) as error:
        raise UsageError(
            expected="a token that a report printed after --replay",
            received=f"{token[:40]!r}… ({len(token)} characters)",
            remedy="copy the whole command from the report",
        ) from error
    require_witness(data)
    return dict(data)


def _unpacked(packed: bytes) -> bytes:
    """Unpack the text of a token; ValueError beyond MOST_BYTES,
    because a few bytes can unpack to gigabytes.
    """
    unpacker = zlib.decompressobj()
    text = unpacker.decompress(packed, MOST_BYTES)
    if not unpacker.eof:
        raise ValueError("cut short, or longer than any witness")
    return text


def _row(values: Any) -> str:
    return "(" + ", ".join(repr(float(v)) for v in values) + ")"


def _describe_problem(data: Description) -> list[str]:
    if isinstance(data, GivenProblem):
        return [f"problem {data.target or data.problem.name}"]
    if isinstance(data, NamedProblem):
        given = ", ".join(f"{k} = {repr(v[0]) if len(v) == 1 else _row(v)}" for k, v in data.parameters)
        return [f"problem {data.name}: {given}"]
    lines = [f"H(y) = {data.hamiltonian}"]
    lines += [f"B{i + 1}{j + 1}(y) = {entry}" for i, j, entry in data.structure if entry.terms]
    for n, G in enumerate(data.noise_structures, 1):
        lines += [f"G{n}_{i + 1}{j + 1}(y) = {entry}" for i, j, entry in G if entry.terms]
    lines += [f"H{n}(y) = {H}" for n, H in enumerate(data.noise_hamiltonians, 1)]
    lines += [f"g{n} = {list(g)}" for n, g in enumerate(data.noise_vectors, 1)]
    if data.nambu is not None:
        lines += [f"g(y) = {data.nambu[0]}", f"C(y) = {data.nambu[1]}"]
    term = ("−Γy dt with Γ = {}" if isinstance(data.damping, tuple) else "−γy dt with γ = {!r}").format(
        data.damping
    )
    lines += [f"damping {term}"] if data.damping else []
    lines += [f"invariant {name} = {I}" for name, I in data.invariants]
    lines += [f"Casimir {C}" for C in data.polynomial_casimirs]
    lines += [f"Casimir yᵀAy with A = {[list(row) for row in A]}" for A in data.casimirs]
    lines += [f"Casimir bᵀy with b = {list(b)}" for b in data.linear_casimirs]
    return lines
