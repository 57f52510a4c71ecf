"""TorchSim's integrations at constant energy and of Langevin dynamics, in float64.
Needs the extra ``simulators``.

`torch_sim.integrators.nvt.nvt_langevin` draws its noise by `torch.randn_like`. Here this function
returns given noise during a step. All other code is the library's.
"""

from __future__ import annotations

from typing import Any
from unittest.mock import patch

import torch
from torch_sim.integrators.nve import nve as make
from torch_sim.integrators.nvt import nvt_langevin
from torch_sim.state import SimState

from sepv.peers._integrator import (
    BAOAB_CLAIMS,
    REVERSIBLE,
    SYMPLECTIC,
    integrator,
    masses,
    on_axis,
    thermostat,
)
from sepv.peers.peer import Peer
from sepv.problem import Array, Mechanics


class _Model(torch.nn.Module):
    device, dtype = torch.device("cpu"), torch.float64

    def __init__(self, system: Mechanics) -> None:
        super().__init__()
        self.system = system

    def forward(self, state: Any) -> dict[str, Any]:
        q = state.positions[:, 0].numpy()
        energy = torch.tensor([float(self.system.potential(q))])
        return {"energy": energy, "forces": torch.as_tensor(on_axis(self.system.force(q)))}


def _number(value: float) -> torch.Tensor:
    return torch.tensor(value, dtype=torch.float64)


def _start(system: Mechanics, q: Array) -> SimState:
    return SimState(
        positions=torch.as_tensor(on_axis(q)), masses=torch.as_tensor(masses(system).copy()), pbc=False,
        cell=torch.eye(3, dtype=torch.float64)[None], atomic_numbers=torch.ones(len(q), dtype=torch.int),
    )  # fmt: skip


def _advance(system: Mechanics, q: Array, p: Array, h: float) -> tuple[Array, Array]:
    init, update = make(_Model(system), dt=_number(h), kT=torch.tensor(0.0))
    state = init(_start(system, q))
    state.momenta = torch.as_tensor(on_axis(p))
    state = update(state)
    return state.positions[:, 0].numpy(), state.momenta[:, 0].numpy()


def _langevin(
    system: Mechanics, rate: float, kT: float, q: Array, p: Array, h: float, xi: Array
) -> tuple[Array, Array]:
    init, update = nvt_langevin(_Model(system), dt=_number(h), kT=_number(kT), gamma=_number(rate))
    state = init(_start(system, q))
    state.momenta = torch.as_tensor(on_axis(p))
    with patch.object(torch, "randn_like", lambda *_, **__: torch.as_tensor(on_axis(xi))):
        state = update(state)
    return state.positions[:, 0].numpy(), state.momenta[:, 0].numpy()


nve = integrator(
    "torch_sim nve", _advance, order=2, claims=SYMPLECTIC + REVERSIBLE,
    source='torch_sim.integrators.nve: "velocity Verlet algorithm for time reversible integration", "Symplectic '
    'integrator preserving phase space volume", "Time integration error scales as O(dt²)".',
)  # fmt: skip

langevin = thermostat(
    "torch_sim nvt_langevin", _langevin, claims=BAOAB_CLAIMS,
    source='torch_sim.integrators.nvt.nvt_langevin: "following the BAOAB splitting scheme".',
)  # fmt: skip

PEER = Peer("torch_sim", integrators={"nve": nve}, thermostats={"langevin": langevin})
