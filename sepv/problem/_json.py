"""Problem descriptions as JSON with hex floats: a round trip keeps every bit.

``sepv/schemas/problem.schema.json`` says what a problem file may hold. `from_json` validates data
against it; `problem_from_json` expects valid data.
"""

from __future__ import annotations

from typing import Any

from sepv._arguments import double
from sepv.errors import ProblemError, UsageError
from sepv.files import fault, schema
from sepv.problem._data import Matrix, NamedProblem, PolynomialSystem, Structure
from sepv.problem._problem import Description, GivenProblem, Problem
from sepv.record import poly


def to_json(problem: Problem | PolynomialSystem | NamedProblem) -> dict[str, Any]:
    """The JSON object that describes a problem, with hex floats;
    for a `Problem` it includes the initial state.

    Raises
    ------
    ProblemError
        For a `Problem` given by Python functions only, which cannot be written.
    """
    if isinstance(problem, (PolynomialSystem, NamedProblem)):
        return problem_to_json(problem)
    data = getattr(problem, "data", None)
    if data is None:
        raise ProblemError(
            expected="a problem with data: one of sepv.problems, or polynomials in a PolynomialSystem",
            received=f"{problem.name}, which is made of Python functions"
            if isinstance(problem, Problem)
            else f"{type(problem).__name__}: {problem!r:.80}",
            remedy="write H and B as polynomials, or name the problem as module:attribute where a file is asked for",
        )
    initial = {} if problem.initial is None else {"initial": _row(problem.initial)}
    return problem_to_json(data) | initial


def from_json(data: Any) -> PolynomialSystem | NamedProblem:
    """The problem description in a JSON object, whose numbers may be plain or hex floats.

    Raises
    ------
    ProblemError
        For data that do not obey the schema of problems. The message gives the place and the
        reason.
    """
    if wrong := _too_large(data) or fault(_without_terms(data), schema("problem")):
        raise _ill_formed(wrong)
    return problem_from_json(data)


# The most terms of all polynomials together, and the most exponents in them: H″ has d² polynomials
# of such terms.
MOST_TERMS, MOST_EXPONENTS = 100_000, 10**6
# The most further numbers, texts and lists. A validator of schemas needs a tenth of a millisecond
# for each.
MOST_OTHER = 2**17
# The kinds of lists under the keys of a polynomial system: terms, a list of terms, entries [i, j,
# terms] of a structure, a list of structures, terms under names.
_KIND_OF_LIST = {
    "hamiltonian": "terms", "polynomial_casimirs": "list", "nambu": "list", "noise_hamiltonians": "list",
    "structure": "entries", "noise_structures": "list of entries", "invariants": "names",
}  # fmt: skip


def _ill_formed(wrong: str) -> ProblemError:
    return ProblemError(
        expected="a problem as its schema describes it: dimension, hamiltonian [[exponents, coefficient], …], "
        "structure [[i, j, terms], …], noise, casimirs; or name and parameters",
        received=wrong,
        remedy="write one with sepv.problems.to_json, and change that",
    )


def _too_large(data: Any) -> str:
    """Describe how a description is too large; an empty text if all bounds hold."""
    terms = exponents = other = 0
    waiting = [data]
    while waiting:
        value = waiting.pop()
        if isinstance(value, list) and value and all(map(_like_a_term, value)):
            terms += len(value)
            exponents += sum(len(term[0]) for term in value)
        elif isinstance(value, (list, dict)):
            other += len(value)
            waiting += value.values() if isinstance(value, dict) else value
        if terms > MOST_TERMS:
            return f"more than {MOST_TERMS} terms"
        if exponents > MOST_EXPONENTS:
            return f"terms with more than {MOST_EXPONENTS} exponents together"
        if other > MOST_OTHER:
            return f"more than {MOST_OTHER} numbers, texts and lists beside the terms"
    return ""


def _like_a_term(value: Any) -> bool:
    return isinstance(value, list) and len(value) == 2 and isinstance(value[0], list)


def _without_terms(data: Any) -> Any:
    """Replace each list of terms by [] and validate it here,
    because a validator of schemas is slow.

    Raises a ProblemError for the first term that does not obey the schema.
    """
    if not isinstance(data, dict) or "name" in data:
        return data
    return {key: _emptied(value, _KIND_OF_LIST.get(key, ""), f"$.{key}") for key, value in data.items()}


def _emptied(value: Any, kind: str, place: str) -> Any:
    if kind == "names" and isinstance(value, dict):
        return {name: _emptied(terms, "terms", f"{place}.{name}") for name, terms in value.items()}
    if not kind or not isinstance(value, list):
        return value
    if kind == "terms":
        for n, term in enumerate(value):
            if not _is_term(term) and (wrong := fault([term], schema("problem") | {"$ref": "#/$defs/terms"})):
                raise _ill_formed(f"{place}[{n}]{wrong.removeprefix('$[0]')}")
        return []
    if kind == "entries":
        return [
            [*entry[:2], _emptied(entry[2], "terms", f"{place}[{n}][2]")]
            if isinstance(entry, list) and len(entry) == 3
            else entry
            for n, entry in enumerate(value)
        ]
    inner = "entries" if kind == "list of entries" else "terms"
    return [_emptied(part, inner, f"{place}[{n}]") for n, part in enumerate(value)]


def _is_term(term: Any) -> bool:
    """True for a term [exponents, coefficient] that obeys the schema;
    False if a validator must decide.
    """
    if not _like_a_term(term) or not all(type(e) is int and 0 <= e <= poly.MAX_DEGREE for e in term[0]):
        return False
    try:
        double(term[1])
    except ValueError:
        return False
    return True


def problem_to_json(data: Description) -> dict[str, Any]:
    """The JSON object of a description: {"name", "parameters"}, polynomial data,
    or {"given"} for functions.

    Floats are in hex. For a problem given by Python functions, "given" is its name on the command
    line, and "noise" lists its c_j. If the command line has no name for it, "given" is empty, and
    "object" is the problem's `name`.
    """
    if isinstance(data, GivenProblem):
        record = {"given": data.target, "noise": _row(data.problem.c)}
        return record | ({} if data.target else {"object": data.problem.name})
    if isinstance(data, PolynomialSystem):
        return _polynomial_json(data)
    return {"name": data.name, "parameters": {k: _row(values) for k, values in data.parameters}}


def problem_from_json(data: Any) -> PolynomialSystem | NamedProblem:
    """The inverse of `problem_to_json`, for data that obey the schema."""
    if "name" not in data:
        return _polynomial_system(data)
    parameters = data.get("parameters", {})
    return NamedProblem(data["name"], tuple((k, _doubles(values)) for k, values in parameters.items()))


def _polynomial_json(data: PolynomialSystem) -> dict[str, Any]:
    more = {
        "polynomial_casimirs": [poly.to_json(C) for C in data.polynomial_casimirs],
        "nambu": [poly.to_json(p) for p in data.nambu or ()],
        "noise_structures": [_table(G) for G in data.noise_structures],
        "noise_hamiltonians": [poly.to_json(p) for p in data.noise_hamiltonians],
        "noise_vectors": [_row(g) for g in data.noise_vectors],
    }
    return {
        "dimension": data.dimension,
        "hamiltonian": poly.to_json(data.hamiltonian),
        "structure": _table(data.structure),
        "noise": _row(data.noise),
        "casimirs": [[_row(row) for row in A] for A in data.casimirs],
        "linear_casimirs": [_row(vector) for vector in data.linear_casimirs],
        **{key: values for key, values in more.items() if values},
        **({"damping": _damping(data.damping)} if data.damping else {}),
        **({"invariants": {name: poly.to_json(I) for name, I in data.invariants}} if data.invariants else {}),
    }


def _table(structure: Structure) -> list[Any]:
    return [[i, j, poly.to_json(entry)] for i, j, entry in structure]


def _damping(damping: float | Matrix) -> Any:
    """The rate γ, or the rows of the matrix Γ."""
    return list(map(_row, damping)) if isinstance(damping, tuple) else float(damping).hex()


def _row(values: Any) -> list[str]:
    return [float(v).hex() for v in values]


def _polynomial_system(data: dict[str, Any]) -> PolynomialSystem:
    d = int(data["dimension"])

    def polynomial(place: str, terms: Any) -> poly.Polynomial:
        try:
            return poly.from_json(d, terms)
        except UsageError as error:
            raise ProblemError(
                expected=error.expected, received=f"$.{place}: {error.received}", remedy=error.remedy
            ) from error

    def structure(table: Any, place: str = "structure") -> Structure:
        rows = enumerate(table)
        return tuple((int(i), int(j), polynomial(f"{place}[{n}][2]", entry)) for n, (i, j, entry) in rows)

    damping = data.get("damping", 0.0)
    nambu = None
    if data.get("nambu"):
        factor, casimir = (polynomial(f"nambu[{n}]", p) for n, p in enumerate(data["nambu"]))
        nambu = factor, casimir
    return PolynomialSystem(
        dimension=d,
        hamiltonian=polynomial("hamiltonian", data["hamiltonian"]),
        structure=structure(data["structure"]),
        noise=_doubles(data.get("noise", [1.0])),
        casimirs=tuple(tuple(map(_doubles, A)) for A in data.get("casimirs", [])),
        linear_casimirs=tuple(map(_doubles, data.get("linear_casimirs", []))),
        polynomial_casimirs=tuple(
            polynomial(f"polynomial_casimirs[{n}]", C)
            for n, C in enumerate(data.get("polynomial_casimirs", []))
        ),
        nambu=nambu,
        noise_structures=tuple(
            structure(G, f"noise_structures[{n}]") for n, G in enumerate(data.get("noise_structures", []))
        ),
        noise_hamiltonians=tuple(
            polynomial(f"noise_hamiltonians[{n}]", p)
            for n, p in enumerate(data.get("noise_hamiltonians", []))
        ),
        noise_vectors=tuple(map(_doubles, data.get("noise_vectors", []))),
        damping=tuple(map(_doubles, damping)) if isinstance(damping, list) else double(damping),
        invariants=tuple(
            (name, polynomial(f"invariants.{name}", I)) for name, I in data.get("invariants", {}).items()
        ),
    )


def _doubles(values: Any) -> tuple[float, ...]:
    return tuple(map(double, values))
