"""``sepv hard``: run a scheme on steps that are hard for a stated reason."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import click

from sepv.commands import _shared as cli
from sepv.console import Table, columns, counted, print_table

if TYPE_CHECKING:
    from rich.text import Text

    from sepv.studies import Seen


@click.command(short_help="A scheme on hard cases: large steps, stiff, near singular.")
@click.argument("target", metavar="[TARGET]", required=False)
@cli.EXEC
@click.option(
    "--problem", "-p", "problems", multiple=True, metavar="PROBLEM",
    help="Long steps of this problem in place of the cases.",
)  # fmt: skip
@click.option("--case", "names", multiple=True, metavar="NAME", help="Only this case; may be repeated.")
@click.option("--steps", type=cli.COUNT, default=200, help="Random steps of each case.")
@click.option("--laws", type=cli.NATURAL, default=2, help="Steps on which laws are measured.")
@click.option("--seed", type=cli.NATURAL, default=0)
@click.option("--explain", is_flag=True, help="Why each case is hard, and what is expected. Runs nothing.")
@click.option("--json", "json_file", type=cli.OUT, help="Write all numbers to this file.")
@click.option("-q", "--quiet", is_flag=True, help="Only what was not expected, and the last line.")
@cli.friendly
def hard(
    target: str | None, programs: cli.Names, problems: cli.Names, names: cli.Names, steps: int, laws: int, seed: int,
    explain: bool, json_file: str | None, quiet: bool,
) -> None:  # fmt: skip
    """Take random steps of the hard cases, where schemes break: each must be solved to its bound,
    or refused.

    TARGET is a built-in scheme or module:attribute. Exit code 0 if every step of every case ends as
    the case allows, else 1.

    \b
    sepv hard                             all cases with energy-preserving
    sepv hard midpoint --case toda-steep
    sepv hard mymodule:step -p mymodule:problem
    sepv hard --steps 40000               a million steps and more
    """
    from rich.text import Text

    from sepv.console import console, print_sentence
    from sepv.hard_cases import CATALOGUE, by_name
    from sepv.schemes import load_problem
    from sepv.studies import long_steps

    cases = [by_name(name) for name in names] if names else () if problems else CATALOGUE
    cases = [*cases, *(long_steps(load_problem(name), name) for name in problems)]
    out = console()
    if explain:
        for case in cases:
            out.print(Text(case.name, style="bold"))
            out.print(f"  hard: {case.reason}\n  expected: {case.expected}")
        return
    from sepv.console import showing
    from sepv.studies import run_hard_cases as run

    targets, usual = [target] if target else [], ["energy-preserving"]
    with showing(quiet) as shown, cli.candidates(targets, programs, shown.update, usual=usual) as chosen:
        target, scheme = chosen[0]
        seen = run(scheme, cases, steps=steps, laws=laws, seed=seed, progress=shown.update)
    cases_seen = [s.to_json() for s in seen]
    cli.save_json(json_file, "hard", {"scheme": scheme.name, "seed": seed, "cases": cases_seen})
    if not quiet:
        print_table(_table(scheme.name, seen), out)
        out.print("* a step may be refused; solved otherwise. Why, says --explain.\n")
    for row in seen:
        if not row.as_expected:
            out.print(_complaint(target, row), soft_wrap=True)
    print_sentence(out, Text(_summary(seen)))
    raise SystemExit(0 if all(s.as_expected for s in seen) else 1)


def _table(name: str, seen: Sequence[Seen]) -> Table:
    """The table of cases for the scheme called `name`: how steps ended, errors of H, iterations,
    and laws held.
    """
    import numpy as np
    from rich.text import Text

    rows: list[tuple[str | Text, ...]] = []
    for s in seen:
        held = f"{sum(a for a, _ in s.laws.values())}/{sum(b for _, b in s.laws.values())}" if s.laws else ""
        turns = f"{np.median(s.iterations):.2g}, ≤ {int(max(s.iterations))}" if s.iterations.any() else ""
        style = "" if s.as_expected else "bold red"
        name_of = Text(s.case.name + ("*" if s.case.refusals else ""), style=style)
        sizes = ["", "", ""]
        if s.defects.size:
            sizes = [f"{np.median(s.defects):.2g}", f"{max(s.defects):.2g}", f"{s.ratio:.1g}"]
        rows.append((name_of, Text(_endings(s), style=style), *sizes, turns, held))
    numbers = ("median", "largest", "of bound", "Newton", "laws")
    goes = ("laws", "Newton", "median", "of bound", "largest")
    heads = (*columns(["case"]), *columns(["seen"], words=True), *columns((), numbers, goes=goes))
    return Table(heads, rows, f"{name}: defects of H in energy ulps, eps |∇H| |y|")


def _endings(seen: Seen) -> str:
    """The counts of how steps ended, in words: 190 solved, 10 refused."""
    from sepv.core.newton import Status

    short = {"CONVERGED": "solved", "REFUSED": "refused", "CRASH": "crashed"}
    short |= {s.name: s.text.split(" of ")[0].split(" or ")[0] for s in Status if s.name not in short}
    endings = [f"{count} {short[name]}" for name, count in sorted(seen.statuses.items())]
    return ", ".join(endings + [f"{count} {what}" for what, count in seen.wrong.items()])


def _complaint(target: str, seen: Seen) -> str:
    """The message on a case with unexpected results: counts, the worst step,
    and the command that replays this step.
    """
    from sepv.law.cases import case as cases

    lines = [f"{seen.case.name}: expected {seen.case.expected}; seen {_endings(seen)}"]
    lines += [
        f"  the law {law} held on {a} of {counted(b, 'step')}" for law, (a, b) in seen.laws.items() if a != b
    ]
    if seen.worst is not None:
        lines += ["  " + text for text in seen.worst.describe().splitlines()]
        lines.append(f"  sepv verify {target} --law energy --replay {cases.to_token(seen.worst)}")
    return "\n".join(lines)


def _summary(seen: Sequence[Seen]) -> str:
    """The last line of the output: the counts over all cases."""
    steps, solved = sum(s.steps for s in seen), sum(s.solved for s in seen)
    crashed = sum(s.statuses.get("CRASH", 0) for s in seen)
    wrong = sum(sum(s.wrong.values()) for s in seen)
    nan = sum(s.wrong.get("not finite", 0) for s in seen)
    return (
        f"{counted(len(seen), 'case')}, {counted(steps, 'step')}: {solved} solved, {steps - solved - crashed} refused, "
        f"{crashed} crashed; "
        f"{nan} not finite, {counted(wrong, 'wrong value')} passed for {'a solution' if wrong == 1 else 'solutions'}; "
        f"{counted(sum(s.as_expected for s in seen), 'case')} as expected."
    )
