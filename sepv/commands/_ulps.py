"""``sepv ulps``: the effect of one step on the invariants, in units of rounding."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import click

from sepv.commands import _shared as cli
from sepv.console import Table, columns, print_table


@click.command(short_help="One-step defects of the invariants, in ulps.")
@click.argument("targets", nargs=-1, metavar="[SCHEME]...")
@cli.EXEC
@click.option(
    "--problem", "-p", "names", multiple=True, metavar="PROBLEM",
    help="By name or as for compare. [default: the paper's]",
)  # fmt: skip
@click.option("--h", type=cli.POSITIVE, help="h. [default: 2^-5, Lotka-Volterra 2^-7]")
@click.option("--steps", type=cli.COUNT, default=400, help="How many.")
@click.option("--seed", type=cli.NATURAL, default=0)
@click.option("--peers", is_flag=True, help="And solvers of every peer that is installed.")
@click.option("--json", "json_file", type=cli.OUT, help="Write the numbers to this file.")
@cli.friendly
def ulps(
    targets: cli.Names, programs: cli.Names, names: cli.Names, h: float | None, steps: int, seed: int, peers: bool,
    json_file: str | None,
) -> None:  # fmt: skip
    """One-step defects of energy and Casimirs in ulps: median and largest over independent steps.

    The unit is eps |∇H| |y|, the effect of one rounding of y on H. Invariants are evaluated in extended precision.

    \b
    sepv ulps                             all schemes on the paper's problems
    sepv ulps mymodule:step -p pendulum --peers
    """
    from sepv import problems, schemes
    from sepv.console import console, showing
    from sepv.reference.peers.peer import installed
    from sepv.schemes import load_problem
    from sepv.studies import ulps as unit

    others = [f"{peer.library}-{name}" for peer in installed() for name in peer.schemes] if peers else []
    names_of_schemes = [*(targets or (() if programs else tuple(schemes.PAPER))), *others]
    chosen = [load_problem(name) for name in (names or tuple(problems.PAPER))]
    rows: list[Any] = []
    with showing() as line, cli.candidates(names_of_schemes, programs, line.update) as wanted:
        for _, scheme in wanted:
            for problem in chosen:
                line.update(f"{scheme.name}, {problem.name}", len(rows) / (len(wanted) * len(chosen)))
                rows.append(unit.one_step(scheme, problem, h=h, steps=steps, seed=seed))
    cli.save_json(json_file, "ulps", {"rows": [asdict(r) for r in rows]})
    failures = any(r.failed for r in rows)  # a column of failures only if there are any, to save width
    sizes = ("energy:\nmedian", "\nlargest", "casimir:\nmedian", "\nlargest ")
    shown = [
        (
            r.scheme, r.problem, f"{r.h:.3g}", *([str(r.failed or "")] if failures else []),
            *(
                "" if v is None else f"{v:.2g}"
                for v in (r.energy_median, r.energy_largest, r.casimir_median, r.casimir_largest)
            ),
        )
        for r in rows
    ]  # fmt: skip
    numbers = ["h", *(["failed"] if failures else []), *sizes]
    heads = columns(["scheme", "problem"], words=True) + columns((), numbers, goes=sizes[:0:-1])
    print_table(Table(heads, shown), console())
