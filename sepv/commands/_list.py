"""``sepv list``: schemes, problems, laws."""

from __future__ import annotations

import sys
from typing import Any

import click

from sepv._arguments import did_you_mean
from sepv.commands._shared import friendly
from sepv.console import Table, columns, print_table
from sepv.errors import UsageError


@click.command("list", short_help="Schemes, problems and laws.")
@click.argument("words", nargs=-1, metavar="[NAME]...")
@friendly
def list_(words: tuple[str, ...]) -> None:
    """Schemes, problems and laws: the names that the other commands take; with NAMEs,
    the rows that contain them all.

    \b
    sepv list
    sepv list energy

    sepv hard --explain lists the hard cases with their reasons; docs/teeth.md lists the saboteurs,
    schemes with faults.
    """
    from sepv import problems, schemes
    from sepv.console import console
    from sepv.schemes import MAX_STAGES
    from sepv.verification import ALL_LAWS, load_laws

    out = console()
    by_name = schemes.PAPER | schemes.EXTENSIONS | schemes.HAMILTONIANS | schemes.DAMPED
    named = [(s.name, f"{s.mean_square_order:g}", s.source) for s in by_name.values()]
    # One row for each family: its members are NAME-1 … NAME-6.
    named += [(f"{n}-s, s = 1 … {MAX_STAGES}", "s", make(1).source) for n, make in schemes.FAMILIES.items()]
    one, more = problems.PAPER | problems.EXTENSIONS, problems.SEVERAL | problems.HAMILTONIANS
    modules = [factory.__module__ for factory in (one | more).values()]
    alone, several = _problem_rows(one, modules), _problem_rows(more, modules)
    laws = [(law.name, law.source, law.statement) for law in load_laws(ALL_LAWS)]
    found = False
    for title, heading, rows in (
        ("Schemes", ("scheme", "order", "source"), named),
        ("Problems", ("problem", "d, m", "what"), alone),
        ("Problems with several structures or Hamiltonians", ("problem", "d, m", "what"), several),
        ("Laws", ("law", "source", "statement"), laws),
    ):
        shown = [row for row in rows if all(word.lower() in " ".join(row).lower() for word in words)]
        if not shown:
            continue
        found = True
        # On a narrow terminal the statement of a law is shown, and the description of a scheme or
        # problem.
        goes = ["order", "d, m", "source"] if title == "Laws" else []
        heads = columns(heading[:1]) + columns(heading[1:], words=True, goes=goes)
        print_table(Table(heads, shown, title), out)
        out.print()
    if not found:
        everything = [row[0] for rows in (named, alone, several, laws) for row in rows]
        raise UsageError(
            expected="words of a scheme, problem or law",
            received=did_you_mean(" ".join(words), everything),
            remedy="sepv list, for all of them",
        )


def _problem_rows(factories: dict[str, Any], modules: list[str]) -> list[tuple[str, str, str]]:
    """The rows of a table of problems, described by the first paragraph of the docstring of a
    problem's file or function.

    `modules` lists the file of each problem. The docstring of a file with several problems
    describes none of them.
    """
    rows = []
    for name, factory in factories.items():
        alone = modules.count(factory.__module__) == 1
        module = sys.modules[factory.__module__].__doc__ if alone else None
        words = (module or factory.__doc__ or "").strip().partition("\n\n")[0]
        problem = factory()
        rows.append((name, f"{problem.dimension}, {problem.noises}", " ".join(words.split())))
    return rows
