"""Problem descriptions as JSON with hex floats: a round trip keeps every bit.

``sepv/schemas/problem.schema.json`` says what a problem file may hold. `from_json` validates data against it;
`problem_from_json` expects valid data.
"""

from __future__ import annotations

from typing import Any

from sepv._arguments import double
from sepv.errors import ProblemError, UsageError
from sepv.files import fault, schema
from sepv.problem._problem import (
    Description,
    GivenProblem,
    NamedProblem,
    PolynomialSystem,
    Problem,
    Structure,
)
from sepv.record import poly


def to_json(problem: Problem | PolynomialSystem | NamedProblem) -> dict[str, Any]:
    """The JSON object that describes a problem, with hex floats; for a `Problem` it includes the initial state.

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
        For data that do not obey the schema of problems. The message gives the place and the reason.
    """
    if wrong := fault(data, schema("problem")):
        raise ProblemError(
            expected="a problem as its schema describes it: dimension, hamiltonian [[exponents, coefficient], …], "
            "structure [[i, j, terms], …], noise, casimirs; or name and parameters",
            received=wrong,
            remedy="write one with sepv.problems.to_json, and change that",
        )
    return problem_from_json(data)


def problem_to_json(data: Description) -> dict[str, Any]:
    """The JSON object of a description: {"name", "parameters"}, polynomial data, or {"given"} for functions.

    Floats are in hex. For a problem given by Python functions, "given" is its name on the command line, and "noise"
    lists its c_j. If the command line has no name for it, "given" is empty, and "object" is the problem's `name`.
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
        **({"damping": float(data.damping).hex()} if data.damping else {}),
    }


def _table(structure: Structure) -> list[Any]:
    return [[i, j, poly.to_json(entry)] for i, j, entry in structure]


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
        damping=double(data.get("damping", 0.0)),
    )


def _doubles(values: Any) -> tuple[float, ...]:
    return tuple(map(double, values))
