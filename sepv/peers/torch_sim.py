"""TorchSim's integration at constant energy, in float64. Needs the extra ``simulators``."""

from __future__ import annotations

from typing import Any

import torch
from torch_sim.integrators.nve import nve as make
from torch_sim.state import SimState

from sepv.peers._integrator import REVERSIBLE, SYMPLECTIC, integrator, masses, on_axis
from sepv.peers.peer import Peer
from sepv.problem import Array, Mechanics


class _Model(torch.nn.Module):
    def __init__(self, system: Mechanics) -> None:
        super().__init__()
        self.system = system

    def forward(self, state: Any) -> dict[str, Any]:
        q = state.positions[:, 0].numpy()
        energy = torch.tensor([float(self.system.potential(q))])
        return {"energy": energy, "forces": torch.as_tensor(on_axis(self.system.force(q)))}


def _advance(system: Mechanics, q: Array, p: Array, h: float) -> tuple[Array, Array]:
    start = SimState(
        positions=torch.as_tensor(on_axis(q)), masses=torch.as_tensor(masses(system).copy()), pbc=False,
        cell=torch.eye(3, dtype=torch.float64)[None], atomic_numbers=torch.ones(len(q), dtype=torch.int),
    )  # fmt: skip
    init, update = make(_Model(system), dt=torch.tensor(h, dtype=torch.float64), kT=torch.tensor(0.0))
    state = init(start)
    state.momenta = torch.as_tensor(on_axis(p))
    state = update(state)
    return state.positions[:, 0].numpy(), state.momenta[:, 0].numpy()


nve = integrator(
    "torch_sim nve", _advance, order=2, claims=SYMPLECTIC + REVERSIBLE,
    source='torch_sim.integrators.nve: "velocity Verlet algorithm for time reversible integration", "Symplectic '
    'integrator preserving phase space volume", "Time integration error scales as O(dt²)".',
)  # fmt: skip

PEER = Peer("torch_sim", integrators={"nve": nve})
