"""Make the committed page, docs/report.html, from nothing: ``python -m benchmarks.page``.

The page has the verdicts on built-in schemes, a comparison of their costs, the committed counters,
and the reproduction of the paper. Verdicts on other libraries' solvers are only in
docs/compliance.md, so that two places cannot contradict each other. Earlier results are kept in a
folder and not measured again, so that an interrupted run can continue.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import click

from benchmarks import ROOT, over, start
from sepv.page import load, render

SITE_TITLE = "sepv: schemes, and the paper reproduced"
SITE_SCHEMES = (
    "energy-preserving", "collocation-2", "collocation-3", "both-invariants", "several-structures", "midpoint",
    "gauss-2", "discrete-gradient", "euler-heun", "milstein", "euler-maruyama", "explicit-4",
)  # fmt: skip
SITE_COMPARED = (
    "energy-preserving", "collocation-2", "midpoint", "discrete-gradient", "euler-heun", "explicit-4", "exact-flow",
)  # fmt: skip


def commands(quick: bool) -> dict[str, list[str]]:
    """Map each JSON file to the arguments of ``sepv`` that make it: verify, compare or
    reproduce.
    """
    less = ["--examples", "5", "--paths", "64"] if quick else []
    made = {f"{name}.json": ["verify", name, *less] for name in SITE_SCHEMES}
    made["compare.json"] = [
        "compare",
        *SITE_COMPARED,
        *(["--paths", "64", "--repeats", "1"] if quick else []),
    ]
    made["reproduce.json"] = ["reproduce", *(["--quick"] if quick else [])]
    return made


@click.command()
@click.option("--out", type=click.Path(dir_okay=False, path_type=Path), default=ROOT / "docs" / "report.html")
@click.option(
    "--keep", type=click.Path(file_okay=False, path_type=Path), help="Where the JSON files are kept."
)
@click.option(
    "--quick", is_flag=True, help="Little effort everywhere: to look at the page, not to commit it."
)
@click.option("--only", multiple=True, help="Only these of the parts: a scheme's name, compare, reproduce.")
def main(out: Path, keep: Path | None, quick: bool, only: tuple[str, ...]) -> None:
    """Measure what is missing, and write the page."""
    folder = keep or Path(tempfile.mkdtemp(prefix="sepv-page-"))
    folder.mkdir(parents=True, exist_ok=True)
    files = []
    for name, arguments in over(commands(quick).items(), lambda item: item[0]):
        if only and Path(name).stem not in only:
            continue
        file = folder / name
        if not file.exists():
            click.echo(f"sepv {' '.join(arguments)}", err=True)
            done = subprocess.run(
                [sys.executable, "-m", "sepv", *arguments, "-q", "--json", name],
                check=False, cwd=folder, env=os.environ | {"PYTHONPATH": str(ROOT)},
            )  # fmt: skip
            if not file.exists():
                raise SystemExit(f"no {file}: exit code {done.returncode}")
        files.append(file)
    page = render(load([*files, ROOT / "benchmarks" / "counters.json"]), title=SITE_TITLE)
    out.write_text(page, encoding="utf-8")
    click.echo(f"{out}: {len(page.encode()) / 1000:.0f} kB, from {folder}")


if __name__ == "__main__":
    start(main)
