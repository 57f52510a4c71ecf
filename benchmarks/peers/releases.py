"""Released versions of other libraries, measured and recorded:
``python -m benchmarks.peers.releases``.
"""

from __future__ import annotations

import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import click

from benchmarks.peers.compliance_measurements import LIBRARIES
from benchmarks.peers.environments import VERSIONS, measure
from benchmarks.peers.records import add, load, recorded
from sepv.commands import shared as cli
from sepv.errors import SepvError, require_one_of
from sepv.files import read_json


@click.command(short_help="What released versions of other libraries do.")
@click.argument("library", required=False, metavar="[LIBRARY]")
@click.argument("releases", nargs=-1, metavar="[VERSION]...")
@click.option(
    "--versions", is_flag=True, help="Every version that was tried (benchmarks.peers.environments)."
)
@click.option("--results", type=cli.FOLDER, default="results", help="The records' folder.")
@click.option(
    "--with", "companions", multiple=True, metavar="REQUIREMENT", help="Installed beside it, by uv."
)
@click.option(
    "--python", default=sys.executable, show_default=False, metavar="EXECUTABLE",
    help="The Python of the environments.",
)  # fmt: skip
@click.option("--keep", type=cli.FOLDER, help="What is measured stays there, and the next run goes on.")
@click.option("--scripts", type=cli.FOLDER, default="docs/peers", help="Scripts of deviations.")
@click.option("--again", is_flag=True, help="Versions that have a record, too; the new one stands beside it.")
@click.option("--seed", type=cli.NATURAL, default=0, help="Of examples and paths.")
@click.option("-j", "--jobs", type=cli.COUNT, default=1, help="Side by side.")
@cli.friendly
def main(library: str | None, releases: cli.Names, versions: bool, results: str, **options: Any) -> None:
    """Measure VERSIONs of LIBRARY, each in an environment of its own,
    and record the behaviour of its solvers.

    uv installs each version, from its usual source. A record is RESULTS/LIBRARY/VERSION.json and is
    never overwritten: with --again, a further record has its date in its name. Without a version,
    existing records are listed.

    \b
    python -m benchmarks.peers.releases                              list the records
    python -m benchmarks.peers.releases sdeint 0.2.4 0.3.0           two versions
    python -m benchmarks.peers.releases --versions -j 2              all versions measured before
    python -m benchmarks.peers.releases diffrax 0.5.1 --with "jax<0.5" --keep peers
    python -m benchmarks.peers.trend                                 which verdict changed, and when

    Exit codes: 0 every version is recorded; 2 wrong usage; 3 a version could not be installed or
    measured.
    """
    folder = Path(results)
    asked = _asked(library, releases, versions)
    if not asked:
        for name, records in load(folder).items():
            if library in (None, name):
                click.echo(f"{name}: {', '.join(dict.fromkeys(r.version for r in records))}")
        return
    wanted = []
    for name, version in asked:
        there = recorded(folder, name, version)
        if there and not options["again"]:
            click.echo(
                f"{name} {version} is recorded in {there[-1]}; --again measures it once more", err=True
            )
        else:
            wanted.append((name, version))

    def one(job: tuple[str, str]) -> tuple[bool, str]:
        try:
            return True, _recorded(*job, folder, options)
        except SepvError as error:
            return False, f"sepv: {' '.join(job)}: {error}"

    with ThreadPoolExecutor(options["jobs"]) as pool:
        said = list(pool.map(one, wanted))
    for right, text in said:
        click.echo(text, err=not right)
    raise SystemExit(0 if all(right for right, _ in said) else 3)


def _asked(library: str | None, releases: cli.Names, versions: bool) -> list[tuple[str, str]]:
    """The pairs (library, version) to be measured."""
    if library is not None:
        require_one_of(
            "a library that has an adapter",
            library,
            LIBRARIES,
            "python -m benchmarks.peers.releases sdeint 0.3.0",
        )
    if versions:
        tried = {name: tuple(found) for name, found in VERSIONS.items() if library in (None, name)}
        return [(name, version) for name, found in tried.items() for version in found]
    return [(str(library), version) for version in dict.fromkeys(releases)]


def _recorded(library: str, version: str, folder: Path, options: dict[str, Any]) -> str:
    """Measure one version and add its record."""
    companions = options["companions"] or VERSIONS.get(library, {}).get(version, ())
    requirements = [f"{library}=={version}", *companions]
    with tempfile.TemporaryDirectory(prefix="sepv-peers-") as temporary:
        home = Path(options["keep"] or temporary).resolve() / f"{library}-{version}"
        home.mkdir(parents=True, exist_ok=True)
        click.echo(f"{library} {version}: an environment with {', '.join(requirements)}", err=True)
        out, scripts = Path(temporary) / "record.json", Path(options["scripts"])
        files = ["--out", str(out), "--keep", str(home / "cells")]
        arguments = [library, *files, "--seed", str(options["seed"])]
        if scripts.is_dir():
            arguments += ["--scripts", str(scripts.resolve())]
        measure(requirements, arguments, options["python"])
        path = add(folder, read_json(out, expected="the record just made", remedy="measure it again"))
    return f"{library} {version} is recorded in {path}"


if __name__ == "__main__":
    main()
