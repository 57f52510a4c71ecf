"""The page on the laws that integrators of samplers and simulators keep:
``python -m benchmarks.peers.integrators``.

The integrators of all installed libraries (`Peer.integrators`) are tested on random mechanical
systems. If a claim does not hold, a script shows the reason without sepv. If the library's
documentation says otherwise, the script is in the folder ``peers`` beside the page
(`benchmarks.peers.deviations`). If the reason is rounding, the script is in the folder
``integrators``, and the page integrator-rounding.md quotes it.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence
from pathlib import Path

import click

from benchmarks.peers.compliance import KEPT_COLUMNS, UNNAMED_LAWS, _listed, kept
from benchmarks.peers.compliance_measurements import Row, release, rows
from benchmarks.peers.deviations import Deviation, deviations_shown_by
from benchmarks.peers.options import jobs_of, measuring, page_options, put
from sepv import __version__
from sepv.console import markdown
from sepv.files import write_atomically
from sepv.law import Effort, Verdict
from sepv.peers.peer import names
from sepv.verification import load_laws

INTEGRATORS_COMMAND = "python -m benchmarks.peers.integrators"
ROUNDING_PAGE = "integrator-rounding.md"
JUDGED_LAWS = (
    "contract",
    "poisson-map:constant",
    "volume",
    "symmetry",
    "reversibility",
    "deterministic-order",
    "energy",
)


def document(
    found: Sequence[Row], differing: Sequence[Deviation], rounded: Sequence[Deviation], command: str
) -> str:
    """The page, in Markdown."""
    marked = {d.solver for d in (*differing, *rounded)}
    groups: dict[tuple[str, str], list[Row]] = {}
    for row in found:
        groups.setdefault(kept(row.marks), []).append(row)
    lines = [(_listed([_name(row, marked) for row in group]), *texts) for texts, group in groups.items()]
    versions = dict.fromkeys(f"{row.library} {release(row.library)}" for row in found)
    parts = [
        "# Laws that integrators of samplers and simulators obey",
        f"Made by `{command}` with sepv {__version__} and {', '.join(versions)}.",
        INTEGRATORS_INTRODUCTION,
        markdown(("integrators (claimed order)", *KEPT_COLUMNS), lines),
        f"Measured: {', '.join(JUDGED_LAWS)}. {UNNAMED_LAWS}",
        "\n".join(_marks(differing, rounded)),
        "\n".join(_reasons(found, marked)),
        "## Where the claims come from",
        "\n".join(dict.fromkeys(f"- {row.scheme.source}" for row in found if ":" in row.scheme.source)),
        "## What was read",
        SOURCES_READ,
    ]
    return "\n\n".join(part for part in parts if part) + "\n"


def rounding(rounded: Sequence[Deviation], command: str) -> str:
    """The page of integrators that keep an invariant to a tolerance or to larger roundings,
    in Markdown.
    """
    head = (
        "# Integrators that keep invariants, but not to rounding\n\n"
        "These integrators agree with their documentation. Each section quotes the library, and shows the output of "
        f"a script without sepv. Made by `{command}`."
    )
    return "\n\n".join([head, *(d.text.removeprefix("#") for d in rounded)]) + "\n"


def _name(row: Row, marked: Collection[str]) -> str:
    order = "" if row.scheme.order is None else f" ({row.scheme.order:g})"
    return row.scheme.name + order + (" †" if row.scheme.name in marked else "")


def _marks(differing: Iterable[Deviation], rounded: Iterable[Deviation]) -> Iterator[str]:
    """The integrators that are marked, and the pages that show the reason."""
    pages: dict[str, list[str]] = {}
    for d in differing:
        pages.setdefault(f"[The documentation differs]({d.page})", []).append(d.solver)
    for d in rounded:
        pages.setdefault(f"[Invariants are kept, but not to rounding]({ROUNDING_PAGE})", []).append(d.solver)
    for text, solvers in pages.items():
        yield f"- † {text}: {_listed(solvers)}"


def _reasons(found: Sequence[Row], marked: Collection[str]) -> Iterator[str]:
    """The defects of claimed laws that do not hold, if no script shows them,
    and the reasons of errors.
    """
    for row in found:
        violated = []
        for law, f in row.found.items():
            verdict = Verdict(f["verdict"])
            if f["claimed"] and verdict is Verdict.VIOLATED and f["defect"] is not None:
                violated.append(f"{law} {f['defect']:.2g} against {f['bound']:.2g}")
            elif f["claimed"] and verdict is not Verdict.HOLDS and f["message"]:
                yield f"- {row.scheme.name}, {law}: {f['message'].splitlines()[0]:.160}"
        if violated and row.scheme.name not in marked:
            yield f"- {row.scheme.name}, defects against bounds: {', '.join(violated)}"


INTEGRATORS_INTRODUCTION = """\
Each integrator runs through its own library's code, in float64. Only the options in its name are set. The systems
are random, H = ½pᵀM⁻¹p + V(q), with up to three degrees of freedom. For libraries with one mass for each particle M is
diagonal. All integrators claim the law *contract*. Their documentation, or the method's name, makes the other claims:
*poisson-map:constant* (symplecticity) and *volume*, *symmetry* and *reversibility*, *deterministic-order*. A violated
law that is not claimed is no fault.

Steps are so short that an implicit step provably has one solution. In such steps an explicit method of order 8 has
only rounding errors, so it obeys laws that it violates in longer steps. REBOUND's integrators of planetary systems
(whfast, saba, mercurius, trace, eos) run on the problem `planets`."""


# Libraries' notes were read as far as a search of public threads finds them.
SOURCES_READ = """\
We read docstrings and source of each integrator, REBOUND's documentation and changelog, the history of JAX MD's and
mici's integrators, and 16 issues and pull requests."""


@click.command()
@page_options(names())
def main(out: Path | None, keep: Path | None, libraries: tuple[str, ...], seed: int) -> None:
    """Measure what the integrators of installed libraries keep, and write the page as Markdown."""
    # Counterexamples are not shown here, so that little is spent on simplifying them.
    effort = Effort(seed=seed, shrink_checks=50)
    docs = out.parent if out else Path("docs")
    with measuring(keep) as line:
        found = rows(jobs_of("integrators", libraries), load_laws(JUDGED_LAWS), effort, keep, line)
        line.update("the scripts that show deviations", 1.0)
        own = {row.library for row in found}
        differing, rounded = (deviations_shown_by(docs / name, own) for name in ("peers", "integrators"))
    put(
        out,
        lambda arguments: document(found, differing, rounded, f"{INTEGRATORS_COMMAND}{arguments}"),
        libraries,
        seed,
    )
    if out and not libraries:
        write_atomically(str(docs / ROUNDING_PAGE), rounding(rounded, f"{INTEGRATORS_COMMAND} --out {out}"))


if __name__ == "__main__":
    main()
