"""``sepv list``: schemes, problems, laws."""

from __future__ import annotations

import sys
from typing import Any

import click

from sepv.commands._shared import friendly


@click.command("list", short_help="Schemes, problems and laws.")
@friendly
def list_(debug: bool) -> None:  # noqa: ARG001  (every command takes it)
    """Schemes, problems and laws: the names that the other commands take.

    \b
    sepv list

    The hard cases are listed, with their reasons, by sepv hard --explain, the saboteurs by docs/teeth.md.
    """
    from sepv import problems, schemes
    from sepv._terminal import Table, columns, print_table
    from sepv.verification import load_laws
    from sepv.verification._report import console

    out = console()
    for title, heading, rows in (
        (
            "Schemes",
            ("scheme", "order", "source"),
            [
                (s.name, _order(s), s.source)
                for s in (schemes.PAPER | schemes.EXTENSIONS | schemes.HAMILTONIANS).values()
            ]
            + _families(schemes),
        ),
        ("Problems", ("problem", "d, m", "what"), _problem_rows(problems.PAPER | problems.EXTENSIONS)),
        (
            "Problems with several structures or Hamiltonians",
            ("problem", "d, m", "what"),
            _problem_rows(problems.SEVERAL | problems.HAMILTONIANS),
        ),
        ("Laws", ("law", "source", "statement"), [(x.name, x.source, x.statement) for x in load_laws()]),
    ):
        # Of the laws the statement stays; of schemes and problems what they are.
        goes = ["order", "d, m", "source"] if title == "Laws" else []
        heads = columns(heading[:1]) + columns(heading[1:], words=True, goes=goes)
        print_table(Table(heads, rows, title), out)
        out.print()


def _order(scheme: Any) -> str:
    return f"{scheme.mean_square_order:g}"


def _families(schemes: Any) -> list[tuple[str, str, str]]:
    """One row for each family: its members are NAME-1 … NAME-6."""
    from sepv.schemes._tableaux import MAX_STAGES

    return [
        (f"{name}-s, s = 1 … {MAX_STAGES}", "s", make(1).source) for name, make in schemes.FAMILIES.items()
    ]


def _problem_rows(factories: dict[str, Any]) -> list[tuple[str, str, str]]:
    """What a problem is says its file, or its function where the file has several."""
    modules = [factory.__module__ for factory in factories.values()]
    rows = []
    for name, factory in factories.items():
        alone = modules.count(factory.__module__) == 1
        module = sys.modules[factory.__module__].__doc__ if alone else None
        words = (module or factory.__doc__ or "").strip()
        problem = factory()
        rows.append((name, f"{problem.dimension}, {problem.noises}", words.partition("\n")[0]))
    return rows
