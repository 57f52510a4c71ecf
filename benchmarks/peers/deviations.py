"""Scripts that use a library alone, without sepv, to show where its solver differs from its
documentation.

``python -m benchmarks.peers.deviations --out docs`` runs the scripts and makes two pages:
deviations.md has solvers of stochastic equations, integrator-deviations.md integrators without
noise.

A script is a file of the folder ``docs/peers``. Its docstring begins with the solver, "library
name", a colon and the statement. Its list NOTES has a (place, date, quotation) for each place where
the library itself speaks of the matter. README, docstring, source and public threads were read, and
no deviation is published without these quotations. The exit code is 1 if the difference is there,
and 0 if not.
"""

from __future__ import annotations

import ast
import datetime
import subprocess
import sys
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import click

from sepv.errors import UsageError
from sepv.files import write_atomically

DEVIATIONS_COMMAND = "python -m benchmarks.peers.deviations --out docs"
# Libraries with solvers of stochastic equations. All other libraries have integrators without
# noise.
STOCHASTIC = ("diffrax", "sdeint", "torchsde")


class Note(NamedTuple):
    """A quotation from the library's own notes, with its place and its date (YYYY-MM-DD)."""

    place: str
    date: str
    quotation: str


@dataclass(frozen=True)
class ScriptResult:
    """The result of a script that shows a deviation: its output and exit code."""

    name: str  # of the script's file
    title: str  # the first line of its docstring
    body: str  # the rest of the docstring, up to the exit code
    notes: tuple[Note, ...]  # quotations of the library itself
    code: int  # 1: the library deviates; 0: it does not; else the script failed
    output: str
    errors: str

    @property
    def solver(self) -> str:
        """The name of the solver that the script is about."""
        return self.title.partition(":")[0]

    @property
    def deviates(self) -> bool | None:
        """True if the library still deviates from its documentation;
        None if the script itself failed.
        """
        return None if self.code not in (0, 1) or "Traceback" in self.errors else self.code == 1


def shown_by(folder: Path, libraries: Collection[str] = ()) -> Iterator[ScriptResult]:
    """Run each script of the folder, or each about one of these libraries, in a process of its own.

    Raise a UsageError for a script that does not quote the library's own notes.
    """
    for script in sorted(folder.glob("*.py")):
        tree = ast.parse(script.read_text("utf-8"))
        docstring = ast.get_docstring(tree) or script.stem
        title, _, rest = docstring.partition("\n")
        if libraries and title.split()[0] not in libraries:
            continue
        notes = _notes(script.name, tree)
        done = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, check=False)
        body = rest.split("Exit code 1")[0].strip()
        yield ScriptResult(script.name, title, body, notes, done.returncode, done.stdout.strip(), done.stderr)


@dataclass(frozen=True)
class Deviation:
    """A solver, "library name", that differs from its documentation,
    and the section of a page about it.
    """

    solver: str
    text: str

    @property
    def page(self) -> str:
        """The file of the page that has the section."""
        return "deviations.md" if self.solver.split()[0] in STOCHASTIC else "integrator-deviations.md"


def deviations_shown_by(folder: Path, libraries: Collection[str] = ()) -> list[Deviation]:
    """The `Deviation` of every script that still shows its deviation."""
    found = []
    for script in shown_by(folder, libraries):
        if not script.deviates:
            click.echo(f"{folder / script.name} left out: exit code {script.code}\n{script.errors}", err=True)
            continue
        found.append(Deviation(script.solver, section(script, folder.name)))
    return found


def section(script: ScriptResult, folder: str) -> str:
    """The section of the page on one deviation: quotations from the library, then the
    measurement.
    """
    notes = "\n".join(f"- {note.place}, {note.date}: “{note.quotation}”" for note in script.notes)
    run = f"[`{folder}/{script.name}`]({folder}/{script.name}) prints"
    return f"### {script.title}\n\n{notes}\n\n{script.body}\n\n{run}\n\n```\n{script.output}\n```"


# The heading of each page.
TITLES = {
    "deviations.md": "# Solvers of stochastic equations that differ from their documentation",
    "integrator-deviations.md": "# Integrators that differ from their documentation",
}


def document(page: str, deviations: Sequence[Deviation]) -> str:
    """One of the two pages, in Markdown."""
    head = (
        "Each section quotes a library, and shows the output of a script without sepv. README, docstrings, source "
        f"and issues were read. Made by `{DEVIATIONS_COMMAND}`."
    )
    sections = [d.text.removeprefix("#") for d in deviations if d.page == page]
    return "\n\n".join([TITLES[page], head, *sections]) + "\n"


@click.command()
@click.option(
    "--out", type=click.Path(file_okay=False, path_type=Path), required=True, help="The folder of pages."
)
def main(out: Path) -> None:
    """Run the scripts of the folder ``peers`` in the output, and write the pages."""
    shown = deviations_shown_by(out / "peers")
    for page in TITLES:
        write_atomically(str(out / page), document(page, shown))


def _notes(script: str, tree: ast.Module) -> tuple[Note, ...]:
    """The list NOTES of a script, after a check."""
    try:
        (value,) = (
            node.value
            for node in tree.body
            if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "NOTES"
        )
        notes = tuple(Note(*entry) for entry in ast.literal_eval(value))
        for note in notes:
            datetime.date.fromisoformat(note.date)
        if notes and all(isinstance(text, str) and text.strip() for note in notes for text in note):
            return notes
        received = "one that is empty"
    except (ValueError, TypeError) as error:
        received = str(error)
    raise UsageError(
        expected=f"{script} with a list NOTES of (place, YYYY-MM-DD, quotation): what the library itself says",
        received=received,
        remedy="read its README, docstrings, changelog and issues, and quote them",
    )


if __name__ == "__main__":
    main()
