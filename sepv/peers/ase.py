"""ASE's velocity Verlet. Needs the extra ``simulators``."""

from __future__ import annotations

from typing import Any

from ase import Atoms
from ase.calculators.calculator import Calculator, all_changes
from ase.md.verlet import VelocityVerlet

from sepv.peers._integrator import REVERSIBLE, SYMPLECTIC, integrator, masses, on_axis
from sepv.peers.peer import Peer
from sepv.problem import Array, Mechanics


class _Forces(Calculator):
    implemented_properties = ("energy", "forces")

    def __init__(self, system: Mechanics) -> None:
        super().__init__()
        self.system = system

    def calculate(self, atoms: Any = None, properties: Any = (), system_changes: Any = all_changes) -> None:
        super().calculate(atoms, properties, system_changes)
        q = self.atoms.positions[:, 0].copy()
        self.results = {"energy": float(self.system.potential(q)), "forces": on_axis(self.system.force(q))}


def _advance(system: Mechanics, q: Array, p: Array, h: float) -> tuple[Array, Array]:
    atoms = Atoms(
        f"H{len(q)}",
        positions=on_axis(q),
        momenta=on_axis(p),
        masses=masses(system),
        calculator=_Forces(system),
    )
    VelocityVerlet(atoms, timestep=h).step()
    return atoms.positions[:, 0], atoms.get_momenta()[:, 0]


velocity_verlet = integrator(
    "ase VelocityVerlet", _advance, order=2, claims=SYMPLECTIC + REVERSIBLE,
    source='ase.md.verlet.VelocityVerlet: "MD with NVE ensemble and velocity Verlet time integration."',
)  # fmt: skip

PEER = Peer("ase", integrators={"velocity-verlet": velocity_verlet})
