"""torchsde's solvers for general noise, with the areas that some need. Needs the extra ``peers``.

The kinds of noise correspond to torchsde's noise types: "one" to scalar, "additive" to additive,
all others to general, also noises that commute. No problem has the diagonal type, because a
Hamiltonian field B∇H_j moves several components.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
import torchsde

from benchmarks.peers.solver import Solver
from sepv.errors import Skipped
from sepv.peers.torchsde import Given
from sepv.posing import LANES, Path, in_blocks, pose_fields
from sepv.problem import Array, Problem
from sepv.schemes import Step
from sepv.schemes._further_increments import as_matrix, as_rows

NOISE_TYPES = {"general": "general", "commutative": "general", "one": "scalar", "additive": "additive"}
SOURCE = "each solver's strong_order and weak_order for the noise type, in torchsde's _core/methods"


class _System(torch.nn.Module):
    """Drift (L, d) and noise (L, d, m) of states (L, d)."""

    def __init__(self, problem: Problem, ito: bool, noise_type: str) -> None:
        super().__init__()
        self.sde_type, self.noise_type = "ito" if ito else "stratonovich", noise_type
        self.fields, numbers = pose_fields(problem, ito=ito)
        self.numbers = tuple(torch.as_tensor(a) for a in numbers)

    def f(self, _t: Any, y: Any) -> Any:
        return self.fields.drift(torch, self.numbers, y.T).T

    def g(self, _t: Any, y: Any) -> Any:
        return self.fields.noise(torch, self.numbers, y.T).permute(2, 1, 0)


class _WithAreas(Given):
    """Given increments (N, L, m) over N steps of length h, with space-time areas (N, L, m)
    or areas (N, L, m, m).
    """

    def __init__(self, increments: Any, h: float, spacetime: Any, areas: Any) -> None:
        super().__init__(increments, h)
        self.spacetime, self.areas = spacetime, areas

    def __call__(self, ta: Any, tb: Any = None, return_U: bool = False, return_A: bool = False) -> Any:
        del tb
        n = round(float(ta) / self.h)
        found = [self.increments[n]]
        if return_U:  # ∫(W(s) − W(t_n)) ds = h(½ΔW + H)
            found.append(self.h * (0.5 * self.increments[n] + self.spacetime[n]))
        if return_A:
            found.append(self.areas[n])
        return tuple(found) if len(found) > 1 else found[0]


def _integrate(
    method: str,
    options: dict[str, Any],
    asks: str,
    ito: bool,
    kind: str,
    problem: Problem,
    y: Array,
    h: float,
    rows: Array,
) -> Array:
    """States (N + 1, d, L) by torchsde.sdeint from y (d, L), with the rows (N, m + k, L)
    of increments and areas.
    """
    m = problem.noises
    dW, further = rows[:, :m], rows[:, m:]

    def tensor(values: Array) -> Any:
        return torch.as_tensor(np.ascontiguousarray(values))

    spacetime = tensor(further.transpose(0, 2, 1)) if asks == "space-time" else None
    areas = None
    if asks == "areas":
        areas = tensor(np.stack([as_matrix(one, m) for one in further]).transpose(0, 3, 1, 2))
    noise = _WithAreas(tensor(dW.transpose(0, 2, 1)), h, spacetime, areas)
    with torch.no_grad():
        states = torchsde.sdeint(
            _System(problem, ito, NOISE_TYPES[kind]),
            tensor(y.T),
            torch.arange(len(rows) + 1, dtype=torch.float64) * h,
            bm=noise,
            method=method,
            dt=h,
            options=dict(options),
        )
    return states.detach().numpy().transpose(0, 2, 1).copy()


def _stepper(method: str, options: dict[str, Any], asks: str, ito: bool, kind: str) -> Step:
    def step(problem: Problem, y: Array, h: float, dW: Array, further: Array | None = None) -> Array:
        if not h > 0:
            raise Skipped("torchsde wants times that increase: h > 0")
        if further is not None:
            dW = np.concatenate([dW, as_rows(further) if asks == "areas" else further])

        def block(y: Array, rows: Array) -> Array:
            return _integrate(method, options, asks, ito, kind, problem, y, h, rows[None])[-1]

        return in_blocks(block, y, dW, LANES)

    return step


def _path_by(method: str, kind: str) -> Path:
    def path(problem: Problem, y0: Array, h: float, dW: Array) -> Array:
        start = np.repeat(y0[:, None], dW.shape[2], axis=1)
        return _integrate(method, {}, "", False, kind, problem, start, h, dW)

    return path


def _orders(strong: tuple[float | None, float, float], weak: float) -> dict[str, tuple[float | None, float]]:
    """Orders by kind of noise, from strong orders for general, scalar and additive noise;
    None if a type is refused.
    """
    general, scalar, additive = strong
    by_kind = {"general": general, "commutative": general, "one": scalar, "additive": additive}
    return {kind: (p, weak) for kind, p in by_kind.items() if p is not None}


def _solver(
    method: str, strong: tuple[float | None, float, float], weak: float = 1.0, *, ito: bool = False, asks: str = "",
    name: str = "", **options: Any,
) -> Solver:  # fmt: skip
    return Solver(
        name=f"torchsde {name or method}",
        documented=_orders(strong, weak),
        source=SOURCE,
        step=lambda kind: _stepper(method, options, asks, ito, kind),
        ito=ito,
        asks=asks,
        path=(lambda kind: _path_by(method, kind)) if method == "reversible_heun" else None,
    )


SOLVERS = (
    _solver("euler", (0.5, 0.5, 1.0), ito=True),
    _solver("milstein", (None, 1.0, 1.0), ito=True, name="milstein, Itô"),
    _solver("milstein", (None, 1.0, 1.0), ito=True, name="milstein, Itô, grad_free", grad_free=True),
    _solver("srk", (None, 1.5, 1.5), 1.5, ito=True, asks="space-time"),
    _solver("euler_heun", (0.5, 1.0, 1.0)),
    _solver("heun", (0.5, 1.0, 1.0)),
    _solver("midpoint", (0.5, 1.0, 1.0)),
    _solver("log_ode", (0.5, 1.0, 1.0), asks="areas"),
    _solver("milstein", (None, 1.0, 1.0), name="milstein, Stratonovich"),
    _solver("milstein", (None, 1.0, 1.0), name="milstein, Stratonovich, grad_free", grad_free=True),
    _solver("reversible_heun", (0.5, 0.5, 1.0)),
)
