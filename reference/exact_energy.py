"""The Hamiltonian H in extended precision for every problem description,
also for those of the hard cases.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any

from sepv.reference.arithmetic import context
from sepv.reference.problem import exact_problem

from sepv.problem import Description as AnyDescription
from sepv.problem import NamedProblem


@lru_cache(maxsize=64)
def exact_energy(data: AnyDescription, digits: int = 40) -> Callable[[Sequence[float]], Any]:
    """A function that maps a binary64 state to its Hamiltonian H,
    as an mpmath number of this many digits.

    Raises
    ------
    UsageError
        If the references do not know the problem's name.
    """
    ctx = context(digits)
    if isinstance(data, NamedProblem) and data.name == "kepler":
        return lambda y: _kepler(ctx, [ctx.mpf(float(v)) for v in y])
    if isinstance(data, NamedProblem) and data.name == "toda":
        return lambda y: _toda(ctx, [ctx.mpf(float(v)) for v in y])
    exact = exact_problem(data, digits)
    return lambda y: exact.hamiltonian(exact.state(y))


def _kepler(ctx: Any, y: list[Any]) -> Any:
    return (y[0] ** 2 + y[1] ** 2) / 2 - 1 / ctx.sqrt(y[2] ** 2 + y[3] ** 2)


def _toda(ctx: Any, y: list[Any]) -> Any:
    n = len(y) // 2
    links = [ctx.exp(a - b) for a, b in zip(y[n:], y[n + 1 :], strict=False)]
    return ctx.fsum(p * p for p in y[:n]) / 2 + ctx.fsum(links)
