"""Long measurements, each stored in a file as soon as it is made,
so that an interrupted run can continue.

A cell is the measurement of one law on one solver, or of one number on one problem. Its key lists
what the result depends on: the releases of the library and of sepv, the seed, and the law's text.
If one of these changes, the cell is measured again. Other changes to sepv's code are not in the
key; after such a change begin with an empty folder.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sepv.console import ShownProgress
from sepv.errors import UsageError
from sepv.files import write_atomically


@dataclass(frozen=True)
class Cell:
    """One measurement."""

    solver: str  # cells of one solver share a file
    name: str  # a law, or a number on a problem
    key: tuple[Any, ...]  # what the result depends on, besides the solver and the name, as JSON
    measure: Callable[
        [], Any
    ]  # returns a value that Python's json can write; this includes NaN and infinities

    @property
    def digest(self) -> str:
        """The digest of solver, name and key, under which the file has the value."""
        return hashlib.sha256(json.dumps([self.solver, self.name, self.key]).encode()).hexdigest()[:24]


def measured(cells: Iterable[Cell], folder: Path | None, shown: ShownProgress) -> dict[tuple[str, str], Any]:
    """The value of every cell, by solver and name: read from the folder,
    or else measured and stored there.
    """
    listed = list(cells)
    kept = {solver: _read(folder, solver) for solver in {cell.solver for cell in listed}}
    missing = [cell for cell in listed if cell.digest not in kept[cell.solver]]
    if folder is not None and len(missing) < len(listed):
        shown.update(f"{len(listed) - len(missing)} of {len(listed)} cells are in {folder}")
    for n, cell in enumerate(missing):
        shown.update(f"{cell.solver}, {cell.name}, {n + 1} of {len(missing)} cells", n / len(missing))
        # The value passes through JSON, so that it is the same now and when it is read again.
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
