"""The page on the laws that other libraries' integrators of Langevin dynamics keep:
``python -m benchmarks.peers.thermostats``.

The integrators of all installed libraries whose noise can be given (`Peer.thermostats`) are tested.
The page says how it is given, and why that of OpenMM's is not.
"""

from __future__ import annotations

from pathlib import Path

import click

from benchmarks.peers.compliance_measurements import Row, release, rows
from benchmarks.peers.options import jobs_of, measuring, page_options, put
from sepv import __version__
from sepv.console import markdown
from sepv.law import Effort
from sepv.peers.peer import names
from sepv.verification import load_laws

THERMOSTATS_COMMAND = "python -m benchmarks.peers.thermostats"
THERMOSTAT_LAWS = (
    "equilibrium",
    "equilibrium:positions",
    "poisson-map:conformal",
    "deterministic-order",
    "local-mean",
    "local-mean-square",
    "local-weak",
    "mean-square-order",
)
# The laws whose defect is a power of h, which the table shows.
POWER_LAWS = ("equilibrium", "deterministic-order", *THERMOSTAT_LAWS[4:])

THERMOSTATS_INTRODUCTION = """\
Each integrator runs through its own library's code, in float64, with the normal numbers that sepv gives it. Libraries
of particles have one mass for each particle, so M is diagonal. The documentation or the method's name makes the
claims (+). Beside a verdict stands the power of h that was measured, and "–" is violated. A violated law
that is not claimed is no fault."""

NOISE = """\
## How the noise is given

- **ASE**: by the argument `rng`, "Must have a standard_normal method matching the signature of
  numpy.random.standard_normal". A step draws ξ and η. Its position moves by √h³σ(ξ/2 + η/(2√3)), so ξ = ΔW/√h and η is
  √12/√h times the space-time area: `asks="space-time"`. With `fixcm=True`, the default, ASE "does not strictly sample
  the correct NVT distributions" and deprecates it; here it is False.
- **JAX MD**: it draws by `jax_md.simulate.Normal` from a key, and has no argument for the numbers. The adapter puts
  given numbers in the place of this class while the step is compiled.
- **TorchSim**: it draws by `torch.randn_like`, and has no argument for the numbers. The adapter replaces this function
  during the step.
- **OpenMM**: LangevinMiddleIntegrator draws in compiled code. Only a seed can be set, and "no guarantees are made about
  the behavior of simulations that use the same seed" (`setRandomNumberSeed`). So no increments can be given, and it is
  not measured. Its documentation says: "closely related to the BAOAB discretization … Both methods produce identical
  trajectories, but LFMiddle returns half step (leapfrog) velocities".

ASE gets velocities as differences of positions over h, "recalc velocities after RATTLE constraints are applied". So the
roundings of q, divided by h, are in p, for which the laws about one step allow. ASE's text states no strong order: the
mean-square order 2 claimed here is that of the paper's title and of our own expansion.

We read the docstrings and the source of the three integrators, and the documentation of OpenMM's."""


@click.command()
@page_options(names())
def main(out: Path | None, keep: Path | None, libraries: tuple[str, ...], seed: int) -> None:
    """Measure what other libraries' integrators of Langevin dynamics keep, and write the page."""
    laws, effort = load_laws(THERMOSTAT_LAWS), Effort(seed=seed, shrink_checks=50)
    with measuring(keep) as line:
        found = rows(jobs_of("thermostats", libraries), laws, effort, keep, line)

    def cell(row: Row, law: str) -> str:
        mark, defect = row.marks[law], row.found[law].get("defect")
        power = f" {defect:.2f}" if law in POWER_LAWS and defect is not None else ""
        return mark.removesuffix(" +") + power + " +" * mark.endswith(" +")

    table = [(law, *(cell(row, law) for row in found)) for law in THERMOSTAT_LAWS]
    versions = ", ".join(f"{row.library} {release(row.library)}" for row in found)

    def document(arguments: str) -> str:
        parts = [
            "# Langevin dynamics of other libraries",
            f"Made by `{THERMOSTATS_COMMAND}{arguments}` with sepv {__version__} and {versions}.",
            THERMOSTATS_INTRODUCTION,
            markdown(("law", *(row.scheme.name for row in found)), table),
            "## Where the claims come from",
            "\n".join(f"- {row.scheme.source}" for row in found),
            NOISE,
        ]
        return "\n\n".join(parts) + "\n"

    put(out, document, libraries, seed)


if __name__ == "__main__":
    main()
