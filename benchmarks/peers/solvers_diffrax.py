"""diffrax's solvers for general noise, with the space-time Lévy areas that some need.
Needs the extra ``peers``.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import diffrax
import jax
import jax.numpy as jnp
import numpy as np

from benchmarks.peers.solver import Solver
from sepv.peers.diffrax import _Given, enable_x64
from sepv.posing import LANES, Path, PosedFields, in_blocks, pose_fields
from sepv.problem import Array, Problem
from sepv.schemes import Step

SOURCE = 'diffrax, "SDE solver table" (docs.kidger.site/diffrax/devdocs/SDE_solver_table)'


def _terms(fields: PosedFields, constant: bool, numbers: Any, dW: Any, H: Any) -> Any:
    """Drift and noise fields (d, m). If `constant`, the noise fields do not use y,
    so that JAX finds them constant.
    """

    def drift(_t: Any, y: Any, _args: Any) -> Any:
        return fields.drift(jnp, numbers, y)

    def noise(_t: Any, y: Any, _args: Any) -> Any:
        return fields.noise(jnp, numbers, jnp.zeros(y.shape, y.dtype) if constant else y).T

    return diffrax.MultiTerm(diffrax.ODETerm(drift), diffrax.ControlTerm(noise, _Given(dW, H)))


def _advance(
    solver: Any, fields: PosedFields, constant: bool, numbers: Any, h: Any, y: Any, rows: Any, state: Any
) -> Any:
    """The next y and the solver's state, from rows of ΔW and H. If `state` is None,
    the solver starts.
    """
    dW, H = rows[: fields.noises], rows[fields.noises :]
    terms, t0 = _terms(fields, constant, numbers, dW, H), jnp.zeros_like(h)
    if state is None:
        state = solver.init(terms, t0, h, y, None)
    y_next, _error, _dense, state, _result = solver.step(terms, t0, h, y, None, state, made_jump=False)
    return y_next, state


@partial(jax.jit, static_argnames=("solver", "fields", "constant"))
def _steps(solver: Any, fields: PosedFields, constant: bool, numbers: Any, h: Any, y: Any, rows: Any) -> Any:
    """One step of each of L states: y (d, L), rows (m or 2m, L)."""

    def lane(y: Any, rows: Any) -> Any:
        return _advance(solver, fields, constant, numbers, h, y, rows, None)[0]

    return jax.vmap(lane, in_axes=1, out_axes=1)(y, rows)


@partial(jax.jit, static_argnames=("solver", "fields"))
def _paths(solver: Any, fields: PosedFields, numbers: Any, h: Any, y: Any, rows: Any) -> Any:
    """L whole paths, in which the solver keeps its state: rows (N, m, L) -> (N + 1, d, L)."""

    def lane(y: Any, rows: Any) -> Any:
        def advance(carry: Any, rows: Any) -> Any:
            carry = _advance(solver, fields, False, numbers, h, carry[0], rows, carry[1])
            return carry, carry[0]

        first = _advance(solver, fields, False, numbers, h, y, rows[0], None)
        _, rest = jax.lax.scan(advance, first, rows[1:])
        return jnp.concatenate([y[None], first[0][None], rest])

    return jax.vmap(lane, in_axes=(1, 2), out_axes=2)(y, rows)


def _stepper(solver: Any, ito: bool, additive_only: bool) -> Step:
    def step(problem: Problem, y: Array, h: float, dW: Array, H: Array | None = None) -> Array:
        fields, numbers = pose_fields(problem, ito=ito)
        rows = dW if H is None else np.concatenate([dW, H])

        def block(y: Array, rows: Array) -> Array:
            with enable_x64(True):
                return np.asarray(_steps(solver, fields, additive_only, numbers, np.float64(h), y, rows))

        return in_blocks(block, y, rows, LANES)

    return step


def _path_by(solver: Any) -> Path:
    def path(problem: Problem, y0: Array, h: float, dW: Array) -> Array:
        fields, numbers = pose_fields(problem)
        start = np.repeat(y0[:, None], dW.shape[2], axis=1)
        with enable_x64(True):
            return np.asarray(_paths(solver, fields, numbers, np.float64(h), start, dW))

    return path


def _orders(general: float, commutative: float, additive: float, weak: Mapping[str, float]) -> Any:
    """Strong and weak orders by kind of noise; one noise counts as commutative."""
    strong = {"general": general, "commutative": commutative, "one": commutative, "additive": additive}
    return {kind: (p, weak.get(kind, 1.0)) for kind, p in strong.items()}


_HIGH = {"additive": 2.0}
_HIGHER = {"commutative": 2.0, "one": 2.0, "additive": 2.0}
# Strong and weak orders as the table of diffrax's documentation states them.
DOCUMENTED: dict[str, Any] = {
    "Euler": _orders(0.5, 0.5, 1.0, {}),
    "EulerHeun": _orders(0.5, 0.5, 1.0, {}),
    "Heun": _orders(0.5, 1.0, 1.0, {}),
    "Midpoint": _orders(0.5, 1.0, 1.0, {}),
    "Ralston": _orders(0.5, 1.0, 1.0, {}),
    "ItoMilstein": _orders(0.5, 1.0, 1.0, {}),
    "StratonovichMilstein": _orders(0.5, 1.0, 1.0, {}),
    "ReversibleHeun": _orders(0.5, 1.0, 1.0, {}),
    "SPaRK": _orders(0.5, 1.0, 1.5, _HIGH),
    "GeneralShARK": _orders(0.5, 1.0, 1.5, _HIGH),
    "SlowRK": _orders(0.5, 1.5, 1.5, _HIGHER),
    "ShARK": {"additive": (1.5, 2.0)},
    "SRA1": {"additive": (1.5, 2.0)},
    "SEA": {"additive": (1.0, 1.0)},
}
ITO = ("Euler", "ItoMilstein")


def _solver(name: str) -> Solver:
    made, documented = getattr(diffrax, name)(), DOCUMENTED[name]
    step = _stepper(made, name in ITO, set(documented) == {"additive"})
    path = _path_by(made) if name == "ReversibleHeun" else None
    return Solver(
        name=f"diffrax {name}",
        documented=documented,
        source=SOURCE,
        step=lambda _kind: step,
        ito=name in ITO,
        asks="space-time" if isinstance(made, getattr(diffrax, "AbstractSRK", ())) else "",
        path=None if path is None else lambda _kind: path,
    )


# Solvers that an older release lacks are left out.
SOLVERS = tuple(_solver(name) for name in DOCUMENTED if hasattr(diffrax, name))
