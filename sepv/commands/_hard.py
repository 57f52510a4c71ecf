"""``sepv hard``: a scheme where schemes break."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import click

from sepv._terminal import counted, print_table
from sepv.commands._shared import EXEC, FILE, candidates, friendly, save_json

if TYPE_CHECKING:
    from rich.text import Text

    from sepv._terminal import Table
    from sepv.studies._hard_cases import Seen


@click.command(short_help="A scheme on hard cases: large steps, stiff, near singular.")
@click.argument("target", metavar="[TARGET]", required=False)
@EXEC
@click.option(
    "--problem", "-p", "own", multiple=True, metavar="PROBLEM",
    help="Long steps of this problem in place of the cases.",
)  # fmt: skip
@click.option("--case", "names", multiple=True, metavar="NAME", help="Only this case; may be repeated.")
@click.option(
    "--steps", type=click.IntRange(min=1), default=200, show_default=True, help="Random steps of each case."
)
@click.option(
    "--laws",
    type=click.IntRange(min=0),
    default=2,
    show_default=True,
    help="Steps on which laws are measured.",
)
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True)
@click.option("--explain", is_flag=True, help="Why each case is hard, and what is expected. Runs nothing.")
@click.option("--json", "json_file", type=FILE, help="Write all numbers to this file.")
@click.option("-q", "--quiet", is_flag=True, help="Only what was not expected, and the last line.")
@friendly
def hard(
    target: str | None,
    programs: tuple[str, ...],
    own: tuple[str, ...],
    names: tuple[str, ...],
    steps: int,
    laws: int,
    seed: int,
    explain: bool,
    json_file: str | None,
    quiet: bool,
    debug: bool,  # noqa: ARG001  (every command takes it)
) -> None:
    """Where schemes break: random steps of the hard cases, each solved to its bound or refused by name.

    TARGET is a built-in scheme or module:attribute. Exit code 0 if every step of every case ends as the
    case allows, else 1.

    \b
    sepv hard                             all of it with energy-preserving
    sepv hard midpoint --case toda-steep
    sepv hard mymodule:step -p mymodule:problem
    sepv hard --steps 40000               a million steps and more
    """
    from rich.text import Text

    from sepv.problems.hard import CATALOGUE, by_name
    from sepv.schemes import load_problem
    from sepv.studies._hard_cases import long_steps
    from sepv.verification._report import console, line

    cases = [by_name(name) for name in names] if names else () if own else CATALOGUE
    cases = [*cases, *(long_steps(load_problem(name), name) for name in own)]
    out = console()
    if explain:
        for case in cases:
            out.print(f"[bold]{case.name}[/bold]\n  hard: {case.reason}\n  expected: {case.expected}")
        return
    from sepv.files import require_folder
    from sepv.studies._hard_cases import run
    from sepv.verification._progress import showing

    require_folder(json_file)
    asked = [target] if target else [] if programs else ["energy-preserving"]
    with candidates(asked, programs) as found, showing(quiet) as shown:
        target, scheme = found[0]
        places = {case.name: n / len(cases) for n, case in enumerate(cases)}
        seen = run(
            scheme, cases, steps=steps, laws=laws, seed=seed,
            progress=lambda case: shown.update(case.name, places[case.name]),
        )  # fmt: skip
    report = {"scheme": scheme.name, "seed": seed, "cases": [s.to_json() for s in seen]}
    save_json(json_file, "hard", report)
    if not quiet:
        print_table(_table(scheme.name, seen), out)
        out.print("* a step may be refused; solved otherwise. Why, says --explain.\n")
    for row in seen:
        if not row.as_expected:
            out.print(_complaint(target, row), soft_wrap=True)
    line(out, Text(_summary(seen)))
    raise SystemExit(0 if all(s.as_expected for s in seen) else 1)


def _table(name: str, seen: Sequence[Seen]) -> Table:
    from rich.text import Text

    from sepv._terminal import Table, columns

    rows: list[tuple[str | Text, ...]] = []
    for s in seen:
        held = f"{sum(a for a, _ in s.laws.values())}/{sum(b for _, b in s.laws.values())}" if s.laws else ""
        turns = f"{_number(s.iterations, _middle)}, ≤ {int(max(s.iterations))}" if s.iterations.any() else ""
        style = "" if s.as_expected else "bold red"
        rows.append(
            (
                Text(s.case.name + ("*" if s.case.refusals else ""), style=style),
                Text(_endings(s), style=style),
                _number(s.defects, _middle),
                _number(s.defects, max),
                f"{s.ratio:.1g}" if s.defects.size else "",
                turns,
                held,
            )
        )
    numbers = ("median", "largest", "of bound", "Newton", "laws")
    goes = ("laws", "Newton", "median", "of bound", "largest")
    heads = (*columns(["case"]), *columns(["seen"], words=True), *columns((), numbers, goes=goes))
    return Table(heads, rows, f"{name}: defects of H in energy ulps, eps |∇H| |y|")


def _endings(seen: Seen) -> str:
    from sepv.solve import Status

    short = {"CONVERGED": "solved", "REFUSED": "refused", "CRASH": "crashed"}
    short |= {s.name: s.text.split(" of ")[0].split(" or ")[0] for s in Status if s.name not in short}
    endings = [f"{count} {short[name]}" for name, count in sorted(seen.statuses.items())]
    return ", ".join(endings + [f"{count} {what}" for what, count in seen.wrong.items()])


def _complaint(target: str, seen: Seen) -> str:
    """What was not expected, with a step that shows it."""
    from sepv.verification._cases import case as cases

    lines = [f"{seen.case.name}: expected {seen.case.expected}; seen {_endings(seen)}"]
    lines += [
        f"  the law {law} held on {a} of {counted(b, 'step')}" for law, (a, b) in seen.laws.items() if a != b
    ]
    if seen.worst is not None:
        lines += ["  " + text for text in seen.worst.describe().splitlines()]
        lines.append(f"  sepv verify {target} --law energy --replay {cases.to_token(seen.worst)}")
    return "\n".join(lines)


def _summary(seen: Sequence[Seen]) -> str:
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


def _middle(values: Any) -> float:
    import numpy as np

    return float(np.median(values))


def _number(values: Any, of: Any) -> str:
    return f"{of(values):.2g}" if values.size else ""
