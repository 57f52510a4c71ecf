"""``sepv growth``: the error of the energy over long times."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from sepv.commands import _shared as cli
from sepv.console import Table, columns, print_table


@click.command(short_help="The energy's error over long times, with verdicts.")
@click.argument("targets", nargs=-1, metavar="[SCHEME]...", shell_complete=cli.complete_schemes)
@cli.EXEC
@click.option(
    "--problem", "-p", default="pendulum", metavar="PROBLEM", help="By name, file.json or module:attribute."
)
@click.option("--h", type=cli.POSITIVE, default=2.0**-4, help="The step size.")
@click.option("--time", "T", type=cli.POSITIVE, default=128.0, help="T, a multiple of 16 h.")
@click.option("--paths", type=click.IntRange(min=16), default=1000, help="How many.")
@click.option("--seed", type=cli.NATURAL, default=0, help="Of the paths, the same for all schemes.")
@click.option("--no-noise", is_flag=True, help="c = (): the largest error, with h and h/2.")
@click.option("--json", "json_file", type=cli.OUT, help="Write the numbers to this file.")
@click.option("-o", "--out", type=cli.OUT, help="Picture: .svg, .png or .pdf.")
@cli.friendly
def growth(
    targets: cli.Names, programs: cli.Names, problem: str, h: float, T: float, paths: int, seed: int,
    no_noise: bool, json_file: str | None, out: str | None,
) -> None:  # fmt: skip
    """The mean E[H(y_n)] − H(y0) and the rms of H(y_n) − H(y0) against time, and how they grow.

    The rms is called at rounding, bounded, a random walk (growth like √t), linear or faster, if its
    99.9 % confidence interval decides. The mean drifts if its interval excludes 0. For symplectic
    schemes with one degree of freedom, values by theory are shown too: with random steps, the
    energy error of such a scheme walks and drifts.

    With --no-noise, or if a scheme or the problem has no noise, one path is computed with h and
    with h/2. A trend of its mean energy is judged as by the law long-time-energy.

    \b
    sepv growth                                           the paper's schemes
    sepv growth midpoint -p pendulum --h 0.125 --time 512 --paths 4000
    sepv growth leapfrog explicit-4 -p pendulum --h 0.25 --time 256 --no-noise
    sepv growth mymodule:step -p mymodule:problem -o growth.png

    Exit code 0, or 2 for wrong usage.
    """  # fmt: skip
    from rich.text import Text

    from sepv import schemes
    from sepv.console import console, print_sentence, showing
    from sepv.pictures import require_picture
    from sepv.schemes import load_problem
    from sepv.studies import energy_growth as study
    from sepv.studies import energy_without_noise as without_noise

    require_picture(out)
    system = load_problem(problem)
    rows: list[study.Growth] = []
    quiet_rows: list[without_noise.QuietGrowth] = []
    with (
        showing() as shown,
        cli.candidates(targets, programs, shown.update, usual=schemes.PAPER) as wanted,
    ):
        quiet = no_noise or not system.noises or any(scheme.deterministic for _, scheme in wanted)
        for number, (_, scheme) in enumerate(wanted):
            shown.update(scheme.name, number / len(wanted))
            if quiet:
                quiet_rows.append(without_noise.quiet_growth(scheme, system, h=h, T=T))
                continue
            rows.append(study.growth(scheme, system, h=h, T=T, paths=paths, seed=seed))
        looks = {scheme.name: scheme.look for _, scheme in wanted if scheme.look}
    cli.save_json(json_file, "growth", {"problem": system.name, "h": h, "paths": paths, "seed": seed,
                                        "rows": [row.to_json() for row in rows],
                                        "without_noise": [row.to_json() for row in quiet_rows]})  # fmt: skip
    if out is not None:
        from sepv.files import write_atomically

        suffix, title = Path(out).suffix, f"{system.name}, h = {h:g}"
        if quiet:
            picture = without_noise.draw(quiet_rows, f"{title}, c = ()", suffix, looks)
        else:
            picture = study.draw(rows, f"{title}, {paths} paths", suffix, looks)
        write_atomically(out, picture)
    screen = console()
    if rows:
        print_table(_table([row for row in rows if not row.failed]), screen)
    sentences = [(row.scheme, row.sentence()) for row in rows]
    sentences += [(row.scheme, row.sentence()) for row in quiet_rows]
    for name, words in sentences:
        print_sentence(screen, Text(f"{name}: {words}"))


def _table(rows: list[Any]) -> Table:
    """The table of mean and rms of the energy error at times T/16, T/4 and T,
    with values by theory if known.
    """
    cells, has_theory = [], any(row.derived and row.kind != "rounding" for row in rows)
    for row in rows:
        for n in (-5, -3, -1):
            t = float(row.times[n])
            derived = row.derived.at(t) if row.derived and row.kind != "rounding" else None
            theory = [f"{v:.3g}" for v in derived] if derived else ["", ""]
            cells.append((
                row.scheme if n == -5 else "", f"{t:g}", f"{row.mean[n]:.3g}", f"{row.error[n]:.2g}",
                f"{row.rms[n]:.3g}", *(theory if has_theory else []),
            ))  # fmt: skip
    numbers = ("t", "mean", "±", "rms", *(("theory:\nmean", "\nrms") if has_theory else ()))
    heads = (*columns(["scheme"], words=True), *columns((), numbers, goes=numbers[:3:-1]))
    return Table(heads, cells, "H(y_n) − H(y0); ± is one standard error of the mean")
