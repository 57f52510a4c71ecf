"""Problem descriptions as JSON with hex floats: a round trip keeps every bit."""

from __future__ import annotations

from typing import Any

from sepv.errors import ProblemError
from sepv.problem._problem import Description, GivenProblem, NamedProblem, PolynomialSystem, Structure
from sepv.record import _polynomial as poly


def problem_to_json(data: Description) -> dict[str, Any]:
    """{"name", "parameters"} or polynomial data, floats in hex; {"given"} for functions, with the noise they have.

    "given" is the words that name the problem. It is empty where there are none; then "object" is its own name.
    """
    if isinstance(data, GivenProblem):
        noise = [float(c).hex() for c in data.problem.c]
        return {"given": data.target, "noise": noise} | ({} if data.target else {"object": data.problem.name})
    if isinstance(data, PolynomialSystem):
        return to_json(data)
    return {"name": data.name, "parameters": {k: [v.hex() for v in values] for k, values in data.parameters}}


def problem_from_json(data: Any) -> PolynomialSystem | NamedProblem:
    """The inverse of `problem_to_json`."""
    if "name" not in data:
        return from_json(data)
    parameters = {
        k: tuple(poly.parse_float(v) for v in values) for k, values in data.get("parameters", {}).items()
    }
    return NamedProblem(data["name"], tuple(parameters.items()))


def to_json(data: PolynomialSystem) -> dict[str, Any]:
    """A JSON object with hex floats; `from_json` gives back an equal record."""
    more = {
        "nambu": [poly.to_json(p) for p in data.nambu or ()],
        "noise_structures": [_table(G) for G in data.noise_structures],
        "noise_hamiltonians": [poly.to_json(p) for p in data.noise_hamiltonians],
    }
    return {
        "dimension": data.dimension,
        "hamiltonian": poly.to_json(data.hamiltonian),
        "structure": _table(data.structure),
        "noise": [c.hex() for c in data.noise],
        "casimirs": [[[a.hex() for a in row] for row in A] for A in data.casimirs],
        "linear_casimirs": [[b.hex() for b in vector] for vector in data.linear_casimirs],
        **{key: values for key, values in more.items() if values},
    }


def _table(structure: Structure) -> list[Any]:
    return [[i, j, poly.to_json(entry)] for i, j, entry in structure]


def from_json(data: Any) -> PolynomialSystem:
    """The inverse of `to_json`; plain numbers are taken as well as hex floats.

    Raises
    ------
    ProblemError
        For anything that does not describe a problem, with what was expected.
    """

    def structure(table: Any) -> Structure:
        return tuple((int(i), int(j), poly.from_json(d, entry)) for i, j, entry in table)

    try:
        d = int(data["dimension"])
        nambu = None
        if data.get("nambu"):
            factor, casimir = (poly.from_json(d, p) for p in data["nambu"])
            nambu = factor, casimir
        return PolynomialSystem(
            dimension=d,
            hamiltonian=poly.from_json(d, data["hamiltonian"]),
            structure=structure(data["structure"]),
            noise=tuple(poly.parse_float(c) for c in data.get("noise", [1.0])),
            casimirs=tuple(
                tuple(tuple(poly.parse_float(a) for a in row) for row in A) for A in data.get("casimirs", [])
            ),
            linear_casimirs=tuple(
                tuple(poly.parse_float(b) for b in v) for v in data.get("linear_casimirs", [])
            ),
            nambu=nambu,
            noise_structures=tuple(structure(G) for G in data.get("noise_structures", [])),
            noise_hamiltonians=tuple(poly.from_json(d, p) for p in data.get("noise_hamiltonians", [])),
        )
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        if isinstance(error, ProblemError):
            raise
        raise ProblemError(
            expected="a problem: dimension, hamiltonian, structure [[i, j, terms], …], noise, casimirs",
            received=f"{type(error).__name__}: {error}",
            remedy="write one with sepv.problems.to_json and change that",
        ) from error
