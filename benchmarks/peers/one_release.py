"""Measure the installed version of one library, and record it:
``python -m benchmarks.peers.one_release``.

`benchmarks.peers.releases` runs this program in the environment of each version. It runs only the
laws about what a general library claims of a solver: its orders and its limit. The compliance table
has all laws.
"""

from __future__ import annotations

import platform
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from importlib.metadata import distributions
from pathlib import Path
from typing import Any

import click

from benchmarks.peers.compliance_measurements import LIBRARIES, Row, release, rows
from benchmarks.peers.deviations import shown_by
from sepv import __version__
from sepv.console import showing
from sepv.errors import SepvError
from sepv.files import finite, json_text, write_atomically
from sepv.law import Effort, Law
from sepv.peers.peer import load
from sepv.verification import SUITE, load_laws

RELEASE_FORMAT = 1
# The laws that are quick enough for many versions. Local laws, by quadrature over several noises,
# find most faults of a formula. Laws that search are slow, because they need a new compilation for
# systems of each size.
QUICK_LAWS = ("local-mean", "local-mean-square", "local-weak", "mean-square-order", "right-limit")
# The most characters of a law's message; `sepv verify` prints the whole message.
RECORDED_MAX_CHARACTERS = 600


def record(
    library: str, effort: Effort, keep: Path | None, scripts: Path | None, shown: Any
) -> dict[str, Any]:
    """The record of the installed library: the measured behaviour of its solvers,
    as in record.schema.json.
    """
    adapter, asked = load(library), load_laws(QUICK_LAWS)
    found = rows([(library, s) for s in adapter.schemes.values()], asked, effort, keep, shown)
    shown.update("the scripts that show deviations", 1.0)
    # The other installed packages, without installers: one of them may be the reason of a change.
    beside = {d.metadata["Name"].lower(): d.version for d in distributions() if d.metadata["Name"]}
    packages = {n: beside[n] for n in sorted(beside) if n not in ("pip", "setuptools", "wheel", "sepv")}
    return {
        "format": RELEASE_FORMAT,
        "library": library,
        "version": release(library),
        "date": f"{datetime.now(UTC):%Y-%m-%d}",
        "suite": {
            "version": __version__, "laws_version": SUITE, "laws": [law.name for law in asked],
            "seed": effort.seed, "examples": effort.examples, "paths": effort.paths,
        },
        "environment": {
            "python": platform.python_version(), "machine": platform.machine(), "packages": packages
        },
        "absent": list(adapter.absent),
        "solvers": [_entry(row, asked) for row in found],
        "scripts": [] if scripts is None else list(_scripts(library, scripts)),
    }  # fmt: skip


def _entry(row: Row, asked: Sequence[Law]) -> dict[str, Any]:
    scheme = row.scheme
    return {
        "name": scheme.name.removeprefix(f"{row.library} "), "source": scheme.source,
        "mean_square_order": scheme.mean_square_order, "weak_order": scheme.weak_order,
        "laws": {law.name: _said(law.unit, row.found[law.name]) for law in asked},
    }  # fmt: skip


def _said(unit: str, cell: dict[str, Any]) -> dict[str, Any]:
    said = {key: finite(cell.get(key)) for key in ("verdict", "claimed", "defect", "bound")}
    return said | {"unit": unit, "message": cell["message"][:RECORDED_MAX_CHARACTERS]}


def _scripts(library: str, folder: Path) -> Iterator[dict[str, Any]]:
    for script in shown_by(folder, [library]):
        failed = script.errors.strip().splitlines()[-1:] if script.deviates is None else []
        output = "\n".join([script.output, *failed]).strip()
        yield {"name": script.name, "title": script.title, "deviates": script.deviates, "output": output}


_FOLDER = click.Path(file_okay=False, path_type=Path)


@click.command()
@click.argument("library", type=click.Choice(LIBRARIES))
@click.option("--out", type=click.Path(dir_okay=False), required=True, help="The record, as JSON.")
@click.option("--keep", type=_FOLDER, help="A folder for what is measured.")
@click.option("--scripts", type=_FOLDER, help="The folder of deviations.")
@click.option(
    "--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Of examples and paths."
)
def main(library: str, out: str, keep: Path | None, scripts: Path | None, seed: int) -> None:
    """Measure the solvers of the installed version of LIBRARY, and write the record."""
    # Counterexamples are not shown here, so that nothing is spent on simplifying them.
    effort = Effort(seed=seed, shrink_checks=0)
    if keep is not None:
        keep.mkdir(parents=True, exist_ok=True)
    try:
        with showing() as line:
            found = record(library, effort, keep, scripts, line)
    except SepvError as error:
        raise click.ClickException(str(error)) from None
    write_atomically(out, json_text(found))


if __name__ == "__main__":
    main()
