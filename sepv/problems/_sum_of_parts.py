"""H as a sum of parts whose flows are known."""

from __future__ import annotations

from collections.abc import Sequence

from sepv.problem import Array
from sepv.problem._derived import PartFlow
from sepv.problem._problem import Flow, Function


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
