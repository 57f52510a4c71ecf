"""Faulty ports: each claims to make the steps of the scheme that it imitates, its twin,
and does not everywhere.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from sepv import schemes
from sepv.problem import Array, Problem, matvec
from sepv.schemes import Scheme, StatefulStep, Step, Twin

from .record import Family

FAMILY = Family("twins")
_right = schemes.euler_heun.step
# A relative error that no sampled law sees, and that is a million roundings.
TWIN_ERROR = 1e-9


def port_of(original: Scheme, step: Step, *, bits: bool = False) -> Scheme:
    """A scheme with the claims of `original`, its twin, and with another step."""
    claims = frozenset(original.claims) | {"agreement"}
    return replace(original, step=step, solve=None, batched=False, claims=claims, twin=Twin(original, bits))


def _field(problem: Problem, y: Array) -> Array:
    return matvec(problem.structure(y), problem.gradient(y))


def euler_heun(problem: Problem, y: Array, h: float, dW: Array, half: float = 0.5) -> Array:
    """A step of Euler-Heun as a user would port it, with a coefficient that is ½ in the right
    scheme.
    """
    S, f = float(problem.c @ dW), _field(problem, y)
    return np.asarray(y + h * f + half * S * (f + _field(problem, y + h * f + S * f)))


def _for_short_steps(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    return euler_heun(problem, y, h, dW, 0.5 + TWIN_ERROR * (abs(h) > 2.0**-7))


def _from_step(first: int) -> StatefulStep:
    """Euler-Heun, whose steps have another coefficient from the step with this number on,
    counted from 1.
    """

    def step(problem: Problem, state: Any, h: float, dW: Array) -> Any:
        y, made = state
        return euler_heun(problem, y, h, dW, 0.5 + TWIN_ERROR * (made + 1 >= first)), made + 1

    return StatefulStep(lambda _, y: (y.copy(), 0), step, lambda state: state[0].copy())


def _in_place(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    S, f = float(problem.c @ dW), _field(problem, y)
    ahead = y + h * f + S * f
    y += h * f
    y += 0.5 * S * (f + _field(problem, ahead))
    return y.copy()


def _next_number(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    y1 = np.array(_right(problem, y, h, dW))
    y1[-1] = np.nextafter(y1[-1], np.inf)
    return y1


def _state_in_single_precision(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    rounded = y.astype(np.float32).astype(np.float64)
    return y + (euler_heun(problem, rounded, h, dW) - rounded)


def _two_noises(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    return euler_heun(problem, y, h, np.where(np.arange(len(dW)) < 2, dW, 0.0))


def _until_small(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    delta, z = problem.random_step(h, dW), np.zeros_like(y)
    for _ in range(200):
        z, before = delta * _field(problem, y + 0.5 * z), z
        if np.max(np.abs(z - before)) <= TWIN_ERROR * np.max(np.abs(y + z)):
            return y + z
    raise ArithmeticError("no convergence")


def _row(name: str, broken: str, step: Callable[..., Any], original: str = "euler-heun", **how: Any) -> None:
    make = partial(port_of, schemes.by_name(original), step, **how)
    FAMILY.rows((name, broken, ("agreement",), make))


_row("port-with-another-half", "a coefficient is ½ + 1e-9", partial(euler_heun, half=0.5 + TWIN_ERROR))
_row("port-for-short-steps", "a coefficient is ½ + 1e-9 if h > 1/128", _for_short_steps)
_row("port-wrong-from-step-5", "a coefficient is ½ + 1e-9 from the fifth step of a path on", _from_step(5))
_row("port-in-place", "overwrites its y", _in_place)
_row("port-off-by-an-ulp", "one component is the next binary64 number", _next_number, bits=True)
_row("port-with-a-short-state", "B and ∇H get y in single precision", _state_in_single_precision)
_row("port-of-two-noises", "forgets the third noise and all later ones", _two_noises)
_row(
    "port-that-stops-early",
    "solves its equation to a tolerance that it does not state",
    _until_small,
    "midpoint",
)
