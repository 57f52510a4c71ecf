"""Problems that go by a name and parameters, and H as a sum of parts whose flows are known."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sepv.problem import Array, NamedProblem, Problem
from sepv.problem._derived import PartFlow
from sepv.problem._problem import Flow, Function


def named(name: str, noise: ArrayLike, parameters: dict[str, Sequence[float]], **parts: Any) -> Problem:
    """The problem of these parts, with its name and parameters as its data."""
    c = tuple(np.atleast_1d(np.asarray(noise, dtype=np.float64)).tolist())
    given = tuple((key, tuple(map(float, values))) for key, values in {**parameters, "noise": c}.items())
    return Problem(**parts, noise=c, name=name, data=NamedProblem(name, given), check=False)


def total(parts: Sequence[Function]) -> Function:
    """Σ H_k, from left to right."""

    def hamiltonian(y: Array) -> Array:
        value = parts[0](y)
        for part in parts[1:]:
            value = value + part(y)
        return value

    return hamiltonian


def flows(dimension: int, structure: Function, parts: Sequence[Function]) -> tuple[Flow, ...]:
    """The exact flows of the B∇H_k."""
    return tuple(PartFlow(dimension, structure, part) for part in parts)
