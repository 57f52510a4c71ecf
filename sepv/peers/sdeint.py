"""sdeint's integrators, one step at a time and over whole paths through its own code.
Needs the extra ``sdeint``.

sdeint solves one path at a time. In a comparison it gets the one process Σ c_j W_j, whose field
is f.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import sdeint

from sepv.errors import StepFailure
from sepv.peers.peer import Peer
from sepv.problem import Array, Problem, vector_field
from sepv.schemes import PathSolver, Scheme, Step
from sepv.studies import from_states


def _integrate(
    integrator: Callable[..., Any], problem: Problem, y: Array, h: float, dW: Array, **more: Any
) -> Array:
    """Return states (N + 1, d) by an integrator of sdeint from y (d,), with increments dW (N, m)
    and fields c_j f.
    """

    def drift(state: Array, _time: float) -> Array:
        return vector_field(problem, state)

    def noise(state: Array, _time: float) -> Array:
        return np.outer(vector_field(problem, state), problem.c)

    times = np.arange(len(dW) + 1) * h
    return np.asarray(integrator(drift, noise, y, times, dW=dW, **more))


def _step_by(integrator: Callable[..., Any], integrals: bool) -> Step:
    """Make a step of sdeint's integrator over (0, h); with `integrals`,
    the integrator gets J_ij = ∫∫∘dW_i∘dW_j.
    """

    def step(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        row = dW.reshape(1, -1)
        more = {"J": _repeated_integrals(row)} if integrals else {}
        return np.asarray(_integrate(integrator, problem, y, h, row, **more)[-1])

    return step


def _repeated_integrals(dW: Array) -> Array:
    """The integrals J_ij = ½ΔW_iΔW_j, (N, m, m), without Lévy areas,
    which drop out for one common field f.
    """
    return 0.5 * dW[:, :, None] * dW[:, None, :]


def _kp2is_path(problem: Problem, y0: Array, h: float, dW: Array) -> Array:
    """The states (N + 1, d, 1) of one path by sdeint's KP2iS.
    Raises StepFailure if sdeint reports an unsolved step.
    """
    increments = dW[:, :, 0]
    try:
        # scipy warns before sdeint raises.
        with warnings.catch_warnings(action="ignore", category=RuntimeWarning):
            more = {"J": _repeated_integrals(increments)}
            return _integrate(sdeint.stratKP2iS, problem, y0, h, increments, **more)[:, :, None]
    except RuntimeError as error:
        raise StepFailure(f"sdeint: {error}".partition(" with args")[0]) from error


def _scheme(integrator: Callable[..., Any], source: str, integrals: bool = False) -> Scheme:
    name, step = f"sdeint {integrator.__name__}", _step_by(integrator, integrals)
    return Scheme(name=name, step=step, mean_square_order=1.0, source=source, truncation=None)


strat_heun = _scheme(sdeint.stratHeun, "sdeint.stratHeun; order 1 because all noises drive one field")
strat_srs2 = _scheme(sdeint.stratSRS2, "sdeint.stratSRS2: order 1.0 strong convergence", integrals=True)
# A two-step method starts with another, explicit step. So its paths are computed from their start.
strat_kp2is = Scheme(
    name="sdeint stratKP2iS", step=PathSolver(_kp2is_path), mean_square_order=1.0, truncation=None,
    source="sdeint.stratKP2iS: two-step implicit order 1.0 strong algorithm",
)  # fmt: skip


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


_DRIVEN = f"sdeint {sdeint.__version__} stratHeun, path by path"

PEER = Peer(
    library="sdeint",
    schemes={"strat-heun": strat_heun, "strat-srs2": strat_srs2, "strat-kp2is": strat_kp2is},
    methods={
        "heun": from_states("sdeint-heun", _run, _DRIVEN, batched=False, evaluations=4, called_each_step=True)
    },
)
