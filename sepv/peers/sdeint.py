"""sdeint's integrators, one step at a time and over whole paths through its own code.
Needs the extra ``sdeint``.

sdeint solves one path at a time. In a comparison it gets the one process Σ c_j W_j, whose field
is f.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import numpy as np
import sdeint

from sepv.errors import StepFailure
from sepv.peers.peer import Peer, Solver
from sepv.problem import Array, Problem, ito_drift, noise_field, one_field, vector_field
from sepv.schemes import PathSolver, Scheme, Step, as_matrix, as_rows
from sepv.studies import from_states

# The names of the arguments that take repeated integrals.
_INTEGRALS = {"itoSRI2": "I", "stratSRS2": "J", "stratKP2iS": "J"}
# Options of single steps and of paths of several Hamiltonians. stratKP2iS solves its equation to
# 1e-4 by default, which would hide an order.
_SOLVER_OPTIONS = {"stratKP2iS": {"rtol": 1e-12}}


def _integrate(
    integrator: Callable[..., Any], ito: bool, problem: Problem, y: Array, h: float, rows: Array, **more: Any
) -> Array:
    """States (N + 1, d) of one path by an integrator of sdeint from y (d,), with rows (N, m + k) of
    increments and Lévy areas A_ij, i < j. Areas that are left out are zero; for one common field f
    they drop out.

    The repeated integrals are J_ij = ∫W_i ∘dW_j = ½ΔW_iΔW_j + A_ij, and Itô's are
    I_ij = J_ij − ½h δ_ij.
    """
    m = problem.noises
    dW = np.ascontiguousarray(rows[:, :m])
    if name := _INTEGRALS.get(integrator.__name__):
        more[name] = 0.5 * dW[:, :, None] * dW[:, None, :] - 0.5 * h * ito * np.eye(m)
        if rows.shape[1] > m:
            more[name] += np.stack([as_matrix(row, m) for row in rows[:, m:]])

    def drift(state: Array, _time: float) -> Array:
        return np.asarray((ito_drift if ito else vector_field)(problem, state))

    def noise(state: Array, _time: float) -> Array:
        if one_field(problem):
            return np.outer(vector_field(problem, state), problem.c)
        return np.stack([c * noise_field(problem, j, state) for j, c in enumerate(problem.c)], axis=1)

    return np.asarray(integrator(drift, noise, y, np.arange(len(dW) + 1) * h, dW=dW, **more))


def _step_by(integrator: Callable[..., Any], ito: bool) -> Step:
    """Make a step of sdeint's integrator over (0, h), which may be given Lévy areas."""
    more = _SOLVER_OPTIONS.get(integrator.__name__, {})

    def step(problem: Problem, y: Array, h: float, dW: Array, areas: Array | None = None) -> Array:
        rows = dW if areas is None else np.concatenate([dW, as_rows(areas)])
        return np.asarray(_integrate(integrator, ito, problem, y, h, rows[None], **more)[-1])

    return step


def _kp2is_path(problem: Problem, y0: Array, h: float, dW: Array, **more: Any) -> Array:
    """The states (N + 1, d, 1) of one path by sdeint's KP2iS.
    Raises StepFailure if sdeint reports an unsolved step.
    """
    try:
        # scipy warns before sdeint raises.
        with warnings.catch_warnings(action="ignore", category=RuntimeWarning):
            return _integrate(sdeint.stratKP2iS, False, problem, y0, h, dW[:, :, 0], **more)[:, :, None]
    except RuntimeError as error:
        raise StepFailure(f"sdeint: {error}".partition(" with args")[0]) from error


def _kp2is_paths(problem: Problem, y0: Array, h: float, dW: Array) -> Array:
    """States (N + 1, d, M) of paths of several Hamiltonians; NaN where a step is unsolved."""
    found = np.full((len(dW) + 1, y0.size, dW.shape[2]), np.nan)
    for lane in range(dW.shape[2]):
        with suppress(StepFailure):
            found[:, :, [lane]] = _kp2is_path(
                problem, y0, h, dW[:, :, [lane]], **_SOLVER_OPTIONS["stratKP2iS"]
            )
    return found


def _solver(name: str, strong: float | None, source: str) -> Solver:
    ito = name.startswith("ito")
    step = _step_by(getattr(sdeint, name), ito)
    return Solver(
        name=f"sdeint {name}",
        documented=dict.fromkeys(("general", "commutative", "one", "additive"), (strong, None)),
        source=f"sdeint 0.3, README: {source}",
        step=lambda _kind: step,
        ito=ito,
        asks="areas" if name in _INTEGRALS else "",
        batched=False,
        # A two-step method starts with another, explicit step. So its paths are computed from their
        # start.
        path=(lambda _kind: _kp2is_paths) if name == "stratKP2iS" else None,
    )


_TWO_STEPS = "two-step implicit order 1.0 strong"
SDEINT_SOLVERS = (
    _solver("itoEuler", None, "no order is stated"),
    _solver("itoSRI2", 1.0, '"order 1.0 strong"; its docstring: for an arbitrary noise matrix'),
    _solver("stratHeun", None, "no order is stated"),
    _solver("stratSRS2", 1.0, '"order 1.0 strong"; its docstring: for an arbitrary noise matrix'),
    _solver("stratKP2iS", 1.0, f'"{_TWO_STEPS}"; its docstring: the noise need not commute'),
)


def _scheme(name: str, source: str) -> Scheme:
    (solver,) = (each for each in SDEINT_SOLVERS if each.name == f"sdeint {name}")
    step = PathSolver(_kp2is_path) if solver.path else solver.step("one")
    source = f"sdeint.{name}{source}"
    return Scheme(name=solver.name, step=step, mean_square_order=1.0, source=source, truncation=None)


_SDEINT_SCHEMES = {
    "strat-heun": _scheme("stratHeun", "; order 1 because all noises drive one field"),
    "strat-srs2": _scheme("stratSRS2", ": order 1.0 strong convergence"),
    "strat-kp2is": _scheme("stratKP2iS", f": {_TWO_STEPS} algorithm"),
}


def _run(problem: Problem, y0: Array, h: float, dW: Array, _keep: bool) -> Callable[[], Array]:
    times = np.arange(len(dW) + 1) * h
    sums = np.einsum("j,njl->nl", problem.c, dW)

    def drift(y: Array, _time: float) -> Array:
        return np.asarray(problem.structure(y) @ problem.gradient(y))

    def noise(y: Array, time: float) -> Array:
        return drift(y, time)[:, None]

    lanes = range(dW.shape[2])
    return lambda: np.stack(
        [sdeint.stratHeun(drift, noise, y0, times, dW=sums[:, lane, None]) for lane in lanes], axis=2
    )


_HEUN_BY_PATHS = f"sdeint {sdeint.__version__} stratHeun, path by path"

PEER = Peer(
    library="sdeint",
    schemes=_SDEINT_SCHEMES,
    methods={
        "heun": from_states(
            "sdeint-heun", _run, _HEUN_BY_PATHS, batched=False, evaluations=4, called_each_step=True
        )
    },
    solvers=SDEINT_SOLVERS,
)
