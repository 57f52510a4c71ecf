"""Measurements that take long, one by one, each kept in a file as soon as it is made: an interrupted run goes on there.

A cell is one law on one solver, or one number on one problem. What it was measured with is its key: another release
of the library or of sepv, another seed, a law that says something else, and it is measured again. Other changes to
sepv's code are not in the key; whoever makes them begins with an empty folder.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sepv.console import Shown
from sepv.errors import UsageError
from sepv.files import write_atomically


@dataclass(frozen=True)
class Cell:
    """One measurement."""

    solver: str  # cells of one solver share a file
    name: str  # a law, or a number on a problem
    key: tuple[Any, ...]  # all that the result depends on, as JSON, beside the solver and the name
    measure: Callable[
        [], Any
    ]  # a value that JSON keeps: NaN and infinities too, as Python's json writes them

    @property
    def digest(self) -> str:
        """The key as it stands in the file."""
        return hashlib.sha256(json.dumps([self.solver, self.name, self.key]).encode()).hexdigest()[:24]


def measured(cells: Iterable[Cell], folder: Path | None, shown: Shown) -> dict[tuple[str, str], Any]:
    """The value of every cell, by solver and name: from the folder where it has it, else measured and put there."""
    listed = list(cells)
    kept = {solver: _read(folder, solver) for solver in {cell.solver for cell in listed}}
    missing = [cell for cell in listed if cell.digest not in kept[cell.solver]]
    if folder is not None and len(missing) < len(listed):
        shown.update(f"{len(listed) - len(missing)} of {len(listed)} cells are in {folder}")
    for n, cell in enumerate(missing):
        shown.update(f"{cell.solver}, {cell.name}, {n + 1} of {len(missing)} cells", n / len(missing))
        # Through JSON, so that a value measured now and one read again are the same.
        kept[cell.solver][cell.digest] = json.loads(json.dumps(cell.measure()))
        if folder is not None:
            # Another process may measure other cells of the same solver into the same folder.
            kept[cell.solver] = {**_read(folder, cell.solver), **kept[cell.solver]}
            content = json.dumps(kept[cell.solver], indent=1) + "\n"
            write_atomically(str(_file(folder, cell.solver)), content)
    return {(cell.solver, cell.name): kept[cell.solver][cell.digest] for cell in listed}


def _file(folder: Path, solver: str) -> Path:
    return folder / (re.sub(r"[^A-Za-z0-9._-]+", "-", solver) + ".json")


def _read(folder: Path | None, solver: str) -> dict[str, Any]:
    if folder is None or not _file(folder, solver).exists():
        return {}
    try:
        found = json.loads(_file(folder, solver).read_text("utf-8"))
    except ValueError as error:
        found = str(error)
    if not isinstance(found, dict):
        raise UsageError(
            expected="a file of measured cells, as an earlier run left it",
            received=f"{_file(folder, solver)}: {found!s:.200}",
            remedy="remove it, and its cells are measured again",
        )
    return found
