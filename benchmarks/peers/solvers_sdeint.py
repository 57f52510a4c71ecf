"""sdeint's integrators for general noise, with the repeated integrals that some need.
Needs the extra ``sdeint``.

The integrals are J_ij = ∫W_i ∘dW_j = ½ΔW_iΔW_j + A_ij with the step's Lévy areas A_ij, and Itô's
I_ij = J_ij − ½h δ_ij.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import sdeint

from benchmarks.peers.solver import Solver
from sepv.posing import Path, pose_fields
from sepv.problem import Array, Problem
from sepv.schemes import Step
from sepv.schemes._further_increments import as_matrix, as_rows

# The tolerance with which stratKP2iS solves its equation: its default, 1e-4, would hide an order.
_SOLVED = {"stratKP2iS": {"rtol": 1e-12}}
# The names of the argument that takes repeated integrals.
_INTEGRALS = {"itoSRI2": "I", "stratSRS2": "J", "stratKP2iS": "J"}


def _integrate(
    integrator: Callable[..., Any], ito: bool, problem: Problem, y: Array, h: float, rows: Array
) -> Array:
    """States (N + 1, d) of one path from y (d,), for rows (N, m + k) of increments and areas A_ij,
    i < j.
    """
    fields, numbers = pose_fields(problem, ito=ito)
    m = problem.noises
    dW = np.ascontiguousarray(rows[:, :m])
    more: dict[str, Any] = dict(_SOLVED.get(integrator.__name__, {}))
    name = _INTEGRALS.get(integrator.__name__)
    if name is not None:
        areas = np.stack([as_matrix(row, m) for row in rows[:, m:]])
        more[name] = 0.5 * dW[:, :, None] * dW[:, None, :] + areas - (0.5 * h * np.eye(m) if ito else 0.0)

    def drift(state: Array, _time: float) -> Array:
        return np.asarray(fields.drift(np, numbers, state))

    def noise(state: Array, _time: float) -> Array:
        return np.ascontiguousarray(fields.noise(np, numbers, state).T)

    return np.asarray(integrator(drift, noise, y, np.arange(len(dW) + 1) * h, dW=dW, **more))


def _stepper(integrator: Callable[..., Any], ito: bool) -> Step:
    def step(problem: Problem, y: Array, h: float, dW: Array, areas: Array | None = None) -> Array:
        rows = dW if areas is None else np.concatenate([dW, as_rows(areas)])
        return _integrate(integrator, ito, problem, y, h, rows[None])[-1]

    return step


def _path_by(integrator: Callable[..., Any]) -> Path:
    def path(problem: Problem, y0: Array, h: float, dW: Array) -> Array:
        """States of all paths; NaN for a path if sdeint reports a step that could not be solved."""
        found = []
        for lane in range(dW.shape[2]):
            try:
                with warnings.catch_warnings(action="ignore", category=RuntimeWarning):
                    found.append(_integrate(integrator, False, problem, y0, h, dW[:, :, lane]))
            except RuntimeError:
                found.append(np.full((len(dW) + 1, y0.size), np.nan))
        return np.stack(found, axis=2)

    return path


def _solver(name: str, strong: float | None, source: str, *, handed_on: bool = False) -> Solver:
    integrator, ito = getattr(sdeint, name), name.startswith("ito")
    step = _stepper(integrator, ito)
    path = _path_by(integrator) if handed_on else None
    return Solver(
        name=f"sdeint {name}",
        documented=dict.fromkeys(("general", "commutative", "one", "additive"), (strong, None)),
        source=source,
        step=lambda _kind: step,
        ito=ito,
        asks="areas" if name in _INTEGRALS else "",
        batched=False,
        path=None if path is None else lambda _kind: path,
    )


_README = "sdeint 0.3, README"
SOLVERS = (
    _solver("itoEuler", None, f"{_README}: no order is stated"),
    _solver("itoSRI2", 1.0, f'{_README}: "order 1.0 strong"; its docstring: for an arbitrary noise matrix'),
    _solver("stratHeun", None, f"{_README}: no order is stated"),
    _solver("stratSRS2", 1.0, f'{_README}: "order 1.0 strong"; its docstring: for an arbitrary noise matrix'),
    _solver(
        "stratKP2iS",
        1.0,
        f'{_README}: "two-step implicit order 1.0 strong"; its docstring: the noise need not commute',
        handed_on=True,
    ),
)
