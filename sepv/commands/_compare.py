"""``sepv compare``: the accuracy of schemes, and the time and work that it costs."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from sepv.commands import _shared as cli
from sepv.console import print_table
from sepv.errors import SepvError, UnknownTarget, UsageError
from sepv.files import write_atomically

if TYPE_CHECKING:
    from sepv.studies import Comparison

# The largest default number of steps. There are at most five, each twice the one before. The
# smallest makes the step to T = 1 a quarter of the longest step that the problem states, or 1/8 if
# it states none.
DEFAULT_MAX_STEPS = 1024


@click.command(short_help="Error, defects, time and work of schemes, side by side.")
@click.argument("targets", nargs=-1, metavar="SCHEME...")
@cli.PROBLEM_OPTION
@cli.EXEC
@cli.INITIAL
@click.option("--time", "T", type=cli.POSITIVE, help="T. [default: 1]")
@click.option("--steps", type=cli.NumberList(int), help="Numbers of steps, such as 8,16,32.")
@click.option("--paths", type=click.IntRange(min=1), help="How many paths. [default: 1000, without noise 1]")
@click.option(
    "--no-noise", is_flag=True, help="The problem with c = (): a trajectory, its error at T and its |ΔH|."
)
@click.option("--repeats", type=cli.COUNT, default=5, help="Timed rounds.")
@click.option("--seed", type=cli.NATURAL, default=0, help="Of the paths.")
@click.option(
    "--error", "errors", type=cli.NumberList(float), default="1e-2,1e-4,1e-6",
    help="Strong errors for which the time is shown.",
)  # fmt: skip
@click.option("--peers", is_flag=True, help="And every peer whose library is installed.")
@click.option(
    "--workers", type=cli.Workers(), default=1,
    help="For errors and defects: threads, or a Dask scheduler's address. Times are taken here.",
)  # fmt: skip
@click.option("--json", "json_file", type=cli.OUT, help="Write the comparison to this file.")
@click.option("--csv", "csv_file", type=cli.OUT, help="Write one line for each point to this file.")
@click.option("--picture", type=cli.OUT, help="Draw it: .svg, .png or .pdf (extra plots).")
@click.option("-q", "--quiet", is_flag=True, help="No progress, and only the second table.")
@cli.friendly
def compare(
    targets: cli.Names, programs: cli.Names, problem: str, picture: str | None, **options: Any
) -> None:
    """Error, invariant defects, time and work of SCHEMEs, on the same paths.

    A SCHEME is a built-in name, module:attribute, exact-flow (the exact solution at θ), or a peer,
    a solver of another library, such as diffrax-heun. The compiled engine (extra fast) runs the
    schemes that it supports; numpy/SCHEME is the NumPy batch of a scheme. Errors are against the
    exact solution, at the random time θ = t + Σ c_j W_j. For timing, methods take turns on one core
    and get the same increments; compilation is shown apart.

    With --no-noise, or if a scheme is only for systems without noise, one path is computed without
    noise, and the table has the time to an error at T and to an energy error.

    \b
    sepv compare energy-preserving midpoint euler-heun exact-flow
    sepv compare leapfrog yoshida-4 -p henon-heiles --no-noise --time 100
    sepv compare mymodule:step --problem pendulum --picture cost.svg

    A scheme that does not exist ends the command before anything is timed. One that fails is left
    out and named at the end. The exit code is 3 in both cases.
    """
    from sepv.console import showing
    from sepv.law import quiet_problem
    from sepv.pictures import content, require_picture
    from sepv.schemes import load_problem
    from sepv.studies import compare as run
    from sepv.studies import comparison_table as table
    from sepv.studies import from_scheme, one_core

    require_picture(picture)
    with one_core() as alone, showing(options["quiet"]) as line:
        system = load_problem(problem)
        if options["initial"] is not None:
            system = replace(system, initial=options["initial"], check=False)
        system = quiet_problem(system) if options["no_noise"] else system
        coarsest = math.ceil(4 / (system.longest_step or 0.5))
        usual = tuple(n for n in (coarsest * 2**k for k in range(5)) if n <= max(coarsest, DEFAULT_MAX_STEPS))
        T, steps = options["T"] or 1.0, options["steps"] or usual
        names = list(dict.fromkeys((*targets, *(_peers() if options["peers"] else ()))))
        if not names and not programs:
            raise UsageError(
                expected="a SCHEME, --exec or --peers",
                received="none",
                remedy="a built-in, module:attribute, exact-flow, or a solver of another library (`sepv peers`)",
            )
        methods, failed = _methods(names, system, line.update)
        if unknown := [error for error in failed.values() if isinstance(error, UnknownTarget)]:
            raise unknown[0]
        block: Any = cli.candidates((), programs, line.update) if programs else nullcontext([])
        with block as others:
            methods += [replace(from_scheme(program, system), name=name) for name, program in others]
            if not methods:
                raise failed[names[0]]
            given = {key: options[key] for key in ("paths", "repeats", "seed", "workers")}
            comparison = run(
                methods, system, steps=steps, T=T, targets=options["errors"], progress=line.update, **given
            )
    comparison = replace(comparison, failed={name: str(e) for name, e in failed.items()} | comparison.failed)
    cli.save_json(options["json_file"], "comparison", comparison.to_json())
    if options["csv_file"]:
        write_atomically(options["csv_file"], table.to_csv(comparison))
    if picture:
        write_atomically(picture, content(comparison.plot(), Path(picture).suffix))
    _show(comparison, alone=alone, quiet=options["quiet"])
    for name, text in comparison.failed.items():
        cli.say(f"sepv: {name} failed and is left out: {text}")
    if comparison.failed:
        raise SystemExit(3)


def _show(comparison: Comparison, *, alone: bool, quiet: bool) -> None:
    """Print a comparison: a table of all points, a table of the times to given errors, and
    notes.
    """
    from sepv.console import console
    from sepv.studies import comparison_table as table

    out = console()
    if not quiet:
        out.print(table.heading(comparison), style="bold")
        for part in table.point_tables(comparison):
            print_table(part, out)
        out.print()
    for part in table.target_tables(comparison):
        print_table(part, out)
    for note in table.notes(comparison):
        out.print(note, style="dim", soft_wrap=True)
    if not alone:
        out.print("This system cannot keep a process on one core: libraries may have used more.", style="dim")


def _peers() -> list[str]:
    """The names of whole-path solvers in the other libraries that are installed,
    such as diffrax-heun.
    """
    from sepv.peers.peer import installed

    return [f"{peer.library}-{name}" for peer in installed() for name in peer.drivers()]


def _methods(
    names: list[str], problem: Any, progress: Callable[[str], None]
) -> tuple[list[Any], dict[str, SepvError]]:
    """Load methods by name; return those that can be run, and the errors of the others by name."""
    from sepv.studies import load_method

    methods, failed = [], {}
    for name in names:
        progress(f"loading {name}, compiled where it is new")
        try:
            methods.append(load_method(name, problem))
        except SepvError as error:
            failed[name] = error
    return methods, failed
