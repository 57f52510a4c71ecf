"""torchsde's Stratonovich solvers, one step at a time and in batches of whole paths.
Needs the extra ``peers``.

torchsde has no public step. A step here is `torchsde.sdeint` over (0, h) with dt = h and a Brownian
motion that returns the given increment.

torchsde's noise type is "scalar" for one noise and "general" for several. Milstein does not support
the general type. It gets the one Wiener process c·W/|c|, which drives the same equation. Lévy areas
are zero here: all noises drive one field, so the commutators that areas multiply vanish. In a
comparison all paths are one batch of `torchsde.sdeint` over the whole interval.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from operator import itemgetter
from typing import Any

import numpy as np
import torch
import torchsde

from sepv.errors import Skipped
from sepv.peers.peer import Peer, Solver
from sepv.posing import POSED_LANES, Path, in_blocks, pose_fields, pose_one_field
from sepv.problem import Array, Problem
from sepv.schemes import Scheme, StatefulStep, Step, as_matrix, as_rows
from sepv.studies import Method, from_states

# torchsde's noise types by kind of noise. No problem has the diagonal type, because a Hamiltonian
# field B∇H_j moves several components.
_NOISE_TYPES = {"general": "general", "commutative": "general", "one": "scalar", "additive": "additive"}


class _System(torch.nn.Module):
    """Drift (L, d) and noise (L, d, m) of L states y (L, d), in torchsde's interface."""

    def __init__(self, fields: Any, numbers: Any, noise_type: str, ito: bool = False) -> None:
        super().__init__()
        self.sde_type, self.noise_type = "ito" if ito else "stratonovich", noise_type
        self.fields, self.numbers = fields, tuple(torch.as_tensor(a) for a in numbers)

    def f(self, _t: Any, y: Any) -> Any:
        return self.fields.drift(torch, self.numbers, y.T).T

    def g(self, _t: Any, y: Any) -> Any:
        return self.fields.noise(torch, self.numbers, y.T).permute(2, 1, 0)


class GivenMotion(torchsde.BaseBrownian):
    """A Brownian motion with given increments (N, L, m) over N equal steps of length h,
    space-time areas (N, L, m) and Lévy areas (N, L, m, m). Areas that are not given are zero.
    """

    levy_area_approximation = "foster"
    dtype, device = torch.float64, torch.device("cpu")

    def __init__(self, increments: Any, h: float, spacetime: Any = None, areas: Any = None) -> None:
        self.increments, self.h, self.spacetime, self.areas = increments, h, spacetime, areas

    @property
    def shape(self) -> Any:
        """The shape of one increment, which torchsde asks for."""
        return self.increments.shape[1:]

    def __repr__(self) -> str:
        return f"given increments of shape {tuple(self.increments.shape)}"

    def __call__(self, ta: Any, tb: Any = None, return_U: bool = False, return_A: bool = False) -> Any:
        """The increment of the step that starts at time ta; if `return_U`, also the integral of W
        over it, and if `return_A`, also its Lévy areas.
        """
        del tb
        n = round(float(ta) / self.h)
        dW = self.increments[n]
        found = [dW]
        if return_U:  # ∫(W(s) − W(t_n)) ds = h(½ΔW + H)
            found.append(self.h * (0.5 * dW + (0.0 if self.spacetime is None else self.spacetime[n])))
        if return_A:
            found.append(dW.new_zeros((*dW.shape, dW.shape[-1])) if self.areas is None else self.areas[n])
        return tuple(found) if len(found) > 1 else dW


@dataclass(frozen=True)
class _Run:
    """A solver of torchsde: its method, options, and areas, and whether it is for Itô's form."""

    method: str
    options: dict[str, Any]
    asks: str = ""
    ito: bool = False

    def __call__(self, kind: str, problem: Problem, y: Array, h: float, rows: Array, **more: Any) -> Any:
        """Call torchsde.sdeint from y (d, L) with rows (N, m + k, L) of increments and areas;
        the result is a tensor (N + 1, L, d). Without a `kind` of noise the problem is (1.1).
        """
        m = problem.noises
        dW, further = rows[:, :m], rows[:, m:]
        fields: Any = None
        if kind:
            noise_type, (fields, numbers) = _NOISE_TYPES[kind], pose_fields(problem, ito=self.ito)
        else:
            noise_type, (fields, numbers) = "scalar" if m == 1 else "general", pose_one_field(problem)
            if m != 1 and self.method == "milstein":
                weights = problem.c
                size = float(np.linalg.norm(weights))
                dW = np.einsum("j,njl->nl", weights / size if size else weights, dW)[:, None]
                noise_type, numbers = "scalar", (np.array([size]), *numbers[1:])
        spacetime = _tensor(further.transpose(0, 2, 1)) if self.asks == "space-time" else None
        areas = None
        if self.asks == "areas" and len(rows[0]) > m:
            areas = _tensor(np.stack([as_matrix(one, m) for one in further]).transpose(0, 3, 1, 2))
        noise = GivenMotion(_tensor(dW.transpose(0, 2, 1)), h, spacetime, areas)
        times = torch.arange(len(dW) + 1, dtype=torch.float64) * h
        with torch.no_grad():
            return torchsde.sdeint(
                _System(fields, numbers, noise_type, self.ito), _tensor(y.T), times, bm=noise, method=self.method,
                dt=h, options=dict(self.options), **more,
            )  # fmt: skip

    def step(self, kind: str = "") -> Step:
        """The step for problems with this kind of noise, or for (1.1)."""

        def step(problem: Problem, y: Array, h: float, dW: Array, further: Array | None = None) -> Array:
            _positive(h)
            if further is not None:
                dW = np.concatenate([dW, as_rows(further) if self.asks == "areas" else further])

            def block(y: Array, rows: Array) -> Any:
                return self(kind, problem, y, h, rows[None])[-1].numpy().T.copy()

            return in_blocks(block, y, dW, POSED_LANES)

        return step

    def path(self, kind: str) -> Path:
        """Whole paths of problems with this kind of noise."""

        def path(problem: Problem, y0: Array, h: float, dW: Array) -> Array:
            start = np.repeat(y0[:, None], dW.shape[2], axis=1)
            return np.asarray(self(kind, problem, start, h, dW).numpy().transpose(0, 2, 1).copy())

        return path


def _tensor(values: Array) -> Any:
    return torch.as_tensor(np.ascontiguousarray(values))


def _positive(h: float) -> None:
    if not h > 0:
        raise Skipped("torchsde wants times that increase: h > 0")


def _handed_on(problem: Problem, state: tuple[Array, Any], h: float, dW: Array) -> tuple[Array, Any]:
    """One step of reversible Heun on one path, from `state`: y (d,),
    and the solver's state as torchsde returns it.
    """
    _positive(h)
    more = {"extra": True, "extra_solver_state": state[1]}
    states, own = _Run("reversible_heun", {})("", problem, state[0][:, None], h, dW[None, :, None], **more)
    return states[-1, 0].numpy().copy(), own


def _solver(
    method: str, strong: tuple[float | None, float, float], weak: float = 1.0, *, ito: bool = False, asks: str = "",
    name: str = "", **options: Any,
) -> Solver:  # fmt: skip
    """A solver with its strong orders for general, scalar and additive noise;
    None if a type is refused.
    """
    general, scalar, additive = strong
    by_kind = {"general": general, "commutative": general, "one": scalar, "additive": additive}
    run = _Run(method, options, asks, ito)
    return Solver(
        name=f"torchsde {name or method}",
        documented={kind: (p, weak) for kind, p in by_kind.items() if p is not None},
        source="each solver's strong_order and weak_order for the noise type, in torchsde's _core/methods",
        step=run.step,
        ito=ito,
        asks=asks,
        # The solver's state holds a second solution beside y.
        path=run.path if method == "reversible_heun" else None,
    )


TORCHSDE_SOLVERS = (
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


def _scheme(solver: Solver) -> Scheme:
    """A Stratonovich solver as a scheme for the laws, of the order documented for one noise."""
    order, general = solver.documented["one"][0], solver.documented.get("general", (None,))[0]
    note = f"; strong_order {general} for general noise, and 1 if the noise commutes"
    stateful = StatefulStep(lambda _, y: (y, None), _handed_on, itemgetter(0))
    return Scheme(
        name=solver.name.replace(", Stratonovich", "").replace(",", ""),
        step=stateful if solver.path else solver.step(""),
        mean_square_order=order,
        weak_order=1.0,
        source=f"torchsde, the solver's strong_order {order:g} for scalar noise and weak_order 1"
        + note * (general not in (None, order)),
        truncation=None,
        batched=not solver.path,
    )


_TORCHSDE_SCHEMES = [_scheme(solver) for solver in TORCHSDE_SOLVERS if not solver.ito]


def _method(method: str) -> Method:
    def run(problem: Problem, y0: Array, h: float, dW: Array, keep: bool) -> Callable[[], Array]:
        # Several noises of one field act as the one process Σ c_j W_j.
        fields, (_, *numbers) = pose_one_field(problem)
        system = _System(fields, (np.ones(1), *numbers), "scalar")
        sums = np.einsum("j,njl->nl", problem.c, dW)[:, :, None]
        noise = GivenMotion(torch.as_tensor(sums), h)
        y = torch.as_tensor(np.repeat(y0[None], dW.shape[2], axis=0))
        grid = torch.arange(len(dW) + 1, dtype=torch.float64) * h
        times = grid if keep else grid[[0, -1]]

        def call() -> Array:
            with torch.no_grad():
                states: Any = torchsde.sdeint(system, y, times, bm=noise, method=method, dt=h)
            return np.asarray(states.numpy().transpose(0, 2, 1))

        return call

    source = f"torchsde {torchsde.__version__} {method}, all paths in one batch"
    return from_states(f"torchsde-{method.replace('_', '-')}", run, source, called_each_step=True)


PEER = Peer(
    library="torchsde",
    schemes={re.sub("[ _]", "-", s.name.partition(" ")[2]): s for s in _TORCHSDE_SCHEMES},
    methods={name.replace("_", "-"): _method(name) for name in ("heun", "midpoint", "reversible_heun")},
    solvers=TORCHSDE_SOLVERS,
)
