"""``sepv ulps``: what one step does to the invariants, in units of rounding."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import click

from sepv.commands._shared import EXEC, FILE, Renamed, candidates, friendly, save_json


@click.command(short_help="One-step defects of the invariants, in ulps.")
@click.argument("targets", nargs=-1, metavar="[SCHEME]...")
@EXEC
@click.option(
    "--problem",
    "-p",
    "names",
    multiple=True,
    metavar="PROBLEM",
    help="By name or as for compare. [default: the paper's]",
)
@click.option(
    "--h",
    "--step",
    "h",
    cls=Renamed,
    type=click.FloatRange(min=0, min_open=True),
    help="h. [default: 2^-5, Lotka-Volterra 2^-7]",
)
@click.option("--steps", type=click.IntRange(min=1), default=400, show_default=True, help="How many.")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True)
@click.option("--peers", is_flag=True, help="And solvers of every peer that is installed.")
@click.option("--json", "json_file", type=FILE, help="Write the numbers to this file.")
@friendly
def ulps(
    targets: tuple[str, ...],
    programs: tuple[str, ...],
    names: tuple[str, ...],
    h: float | None,
    steps: int,
    seed: int,
    peers: bool,
    json_file: str | None,
    debug: bool,  # noqa: ARG001  (every command takes it)
) -> None:
    """One-step defects of energy and Casimirs in ulps: median and largest over independent steps.

    The unit is what one rounding of y does, eps |∇H| |y|; invariants are evaluated in extended precision.

    \b
    sepv ulps                             all schemes on the paper's problems
    sepv ulps mymodule:step -p pendulum --peers
    """

    from sepv import problems, schemes
    from sepv._terminal import Table, columns, print_table
    from sepv.files import require_folder
    from sepv.schemes import load_problem
    from sepv.studies import _ulps as unit
    from sepv.verification._progress import showing
    from sepv.verification._report import console

    require_folder(json_file)
    asked = [*(targets or (() if programs else tuple(schemes.PAPER))), *(unit.peers() if peers else ())]
    chosen = [load_problem(name) for name in (names or tuple(problems.PAPER))]
    rows: list[Any] = []
    with candidates(asked, programs) as wanted, showing() as line:
        for _, scheme in wanted:
            for problem in chosen:
                line.update(f"{scheme.name}, {problem.name}", len(rows) / (len(wanted) * len(chosen)))
                rows.append(unit.one_step(scheme, problem, h=h, steps=steps, seed=seed))
    save_json(json_file, "ulps", {"rows": [asdict(r) for r in rows]})
    failures = any(r.failed for r in rows)  # a column of its own only where there are any: 80 columns are few
    sizes = ("energy:\nmedian", "\nlargest", "casimir:\nmedian", "\nlargest ")
    shown = [
        (
            r.scheme,
            r.problem,
            f"{r.h:.3g}",
            *([str(r.failed or "")] if failures else []),
            *(
                "" if v is None else f"{v:.2g}"
                for v in (r.energy_median, r.energy_largest, r.casimir_median, r.casimir_largest)
            ),
        )
        for r in rows
    ]
    numbers = ["h", *(["failed"] if failures else []), *sizes]
    heads = columns(["scheme", "problem"], words=True) + columns((), numbers, goes=sizes[:0:-1])
    out = console()
    print_table(Table(heads, shown), out)
