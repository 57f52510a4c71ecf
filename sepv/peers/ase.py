"""ASE's velocity Verlet and Langevin dynamics. Needs the extra ``simulators``.

`ase.md.langevin.Langevin` takes the object that draws its normal numbers as the argument `rng`. A
step draws ξ and η for each coordinate, and √h(ξ, η/√12) are the increment and the space-time area:
its position moves by √h³ σ(ξ/2 + η/(2√3)) = σ∫W ds.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from ase import Atoms, units
from ase.calculators.calculator import Calculator, all_changes
from ase.md.langevin import Langevin
from ase.md.verlet import VelocityVerlet

from sepv.peers._integrator import REVERSIBLE, SYMPLECTIC, integrator, masses, on_axis, thermostat
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


def _atoms(system: Mechanics, q: Array, p: Array) -> Atoms:
    return Atoms(
        f"H{len(q)}",
        positions=on_axis(q),
        momenta=on_axis(p),
        masses=masses(system),
        calculator=_Forces(system),
    )


def _advance(system: Mechanics, q: Array, p: Array, h: float) -> tuple[Array, Array]:
    atoms = _atoms(system, q, p)
    VelocityVerlet(atoms, timestep=h).step()
    return atoms.positions[:, 0], atoms.get_momenta()[:, 0]


class _GivenDraws:
    """An `rng` that returns given draws."""

    def __init__(self, draws: Iterator[Array]) -> None:
        self.draws = draws

    def standard_normal(self, size: tuple[int, int]) -> Array:
        return on_axis(next(self.draws)).reshape(size)


def _langevin(
    system: Mechanics, rate: float, kT: float, q: Array, p: Array, h: float, xi: Array
) -> tuple[Array, Array]:
    atoms = _atoms(system, q, p)
    Langevin(
        atoms, timestep=h, temperature_K=kT / units.kB, friction=rate, fixcm=False, rng=_GivenDraws(iter(xi))
    ).step()
    return atoms.positions[:, 0], atoms.get_momenta()[:, 0]


velocity_verlet = integrator(
    "ase VelocityVerlet", _advance, order=2, claims=SYMPLECTIC + REVERSIBLE,
    source='ase.md.verlet.VelocityVerlet: "MD with NVE ensemble and velocity Verlet time integration."',
)  # fmt: skip

langevin = thermostat(
    "ase Langevin, fixcm=False", _langevin, asks="space-time", claims=("equilibrium",), mean_square_order=2,
    source='ase.md.langevin.Langevin: "The propagator is Equation 23 … of the above reference", E. Vanden-Eijnden and '
    "G. Ciccotti, Second-order integrators for Langevin equations with holonomic constraints (2006).",
)  # fmt: skip

PEER = Peer("ase", integrators={"velocity-verlet": velocity_verlet}, thermostats={"langevin": langevin})
