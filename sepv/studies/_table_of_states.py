"""A table of states (t, y, and dW if there is noise) as a file: CSV, columns,
.npy or the JSON of ``sepv run``.

A number in a text is known to half a unit of its last digit. `Rows.half` has this half unit, so
that a table with six digits is not accused of errors that its digits cause.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sepv.errors import UsageError
from sepv.files import read_json
from sepv.problem import Array, Problem

# The largest file in bytes: a million rows of a large problem.
TABLE_MAX_BYTES = 2**28
FEWEST_ROWS = 2
FORMATS = "rows t, y_1 … y_d, and dW_1 … dW_m if there is noise: .csv, columns of text, .npy, or the JSON of `sepv run`"


@dataclass(frozen=True)
class Rows:
    """The states of one path.

    t : (N + 1,), times; y : (d, N + 1), states; half : (d, N + 1), half a unit in the last digit of
        each y
    t_half : half a unit in the last digit of a time
    dW, dW_half : (N, m), the increments of the steps that end in rows 1 to N, or None if the table
        has none
    """

    t: Array
    y: Array
    half: Array
    t_half: float
    dW: Array | None
    dW_half: Array | None

    @property
    def steps(self) -> int:
        """The number N of steps between rows."""
        return self.t.size - 1


def read_rows(path: str | Path, problem: Problem, h: float | None = None) -> Rows:
    """Read a table of states of the problem.

    Parameters
    ----------
    h : float, optional
        The time between two rows, for a table without times.

    Raises
    ------
    UsageError
        For a file that cannot be read, has another number of columns, or numbers that are not
        finite.
    """
    values, half = _numbers(Path(path))
    d, m, columns = problem.dimension, problem.noises, values.shape[1]
    if columns == d:
        if h is None:
            raise _wrong(path, f"{columns} columns and no times", "--h H, the time between two rows")
        rows = np.arange(len(values), dtype=np.float64)[:, None] * h
        values, half = np.hstack([rows, values]), np.hstack([np.zeros_like(rows), half])
    elif columns not in (1 + d, 1 + d + m):
        wanted = f"{1 + d} columns" + (f", or {1 + d + m} with the increments" if m else "")
        raise _wrong(path, f"{columns} columns", f"{wanted} for {problem.name}, or -p with another problem")
    if len(values) < FEWEST_ROWS:
        raise _wrong(path, f"{len(values)} rows", "at least two states")
    if not np.isfinite(values).all():
        row, column = (int(v) for v in np.argwhere(~np.isfinite(values))[0])
        raise _wrong(
            path, f"{float(values[row, column])!r} in row {row + 1}, column {column + 1}", "finite numbers"
        )
    if not np.all(np.diff(values[:, 0]) > 0):
        row = int(np.argmin(np.diff(values[:, 0]) > 0)) + 1
        raise _wrong(
            path,
            f"t = {float(values[row, 0])!r} after {float(values[row - 1, 0])!r} in row {row + 1}",
            "increasing times",
        )
    given = columns == 1 + d + m and m > 0
    return Rows(
        values[:, 0], values[:, 1 : 1 + d].T, half[:, 1 : 1 + d].T, float(half[:, 0].max()),
        values[1:, 1 + d :] if given else None, half[1:, 1 + d :] if given else None,
    )  # fmt: skip


def _wrong(path: Any, received: str, remedy: str) -> UsageError:
    return UsageError(expected=f"{path}: {FORMATS}", received=received, remedy=remedy)


def _numbers(path: Path) -> tuple[Array, Array]:
    """The numbers of a file, a row for each time, and half a unit in the last digit of each."""
    if path.suffix == ".json":
        found = read_json(
            path, TABLE_MAX_BYTES, expected=f"{path}: {FORMATS}", remedy="sepv run … --json FILE"
        )
        times, states = (found.get(key) if isinstance(found, dict) else None for key in ("times", "states"))
        try:
            values = np.column_stack([np.array(times, dtype=np.float64), np.array(states, dtype=np.float64)])
        except (TypeError, ValueError) as error:
            raise _wrong(
                path, "JSON without times (N,) and states (N, d)", "sepv run … --json FILE"
            ) from error
        return values, np.zeros_like(values)
    if not path.is_file() or path.stat().st_size > TABLE_MAX_BYTES:
        raise _wrong(path, "no file of at most 256 MiB", "name a file")
    if path.suffix == ".npy":
        try:
            values = np.load(path, allow_pickle=False)
        except (ValueError, OSError, EOFError) as error:
            raise _wrong(path, f"no array of NumPy: {error}", "numpy.save") from error
        if values.ndim != 2 or values.dtype.kind not in "fiu":
            raise _wrong(
                path, f"shape {values.shape}, {values.dtype}", "an array of real numbers (rows, columns)"
            )
        return values.astype(np.float64), np.zeros(values.shape)
    return _from_text(path)


def _from_text(path: Path) -> tuple[Array, Array]:
    """The numbers of a text, separated by commas, semicolons or blanks; # begins a comment,
    a heading may come.
    """
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise _wrong(path, f"no text in UTF-8: {error}", "a text, or .npy") from error
    table: list[list[str]] = []
    for number, line in enumerate(lines, 1):
        words = [w for w in re.split(r"[,;\s]+", line.partition("#")[0].strip()) if w]
        if not words or (not table and not _is_number(words[-1])):
            continue
        if not all(map(_is_number, words)) or (table and len(words) != len(table[0])):
            wanted = f"{len(table[0])} numbers, as in the rows before" if table else "numbers alone"
            raise _wrong(path, f"line {number}: {line.strip()[:80]!r}", wanted)
        table.append(words)
    if not table:
        raise _wrong(path, "no row of numbers", "one row for each time")
    values = np.array([[float(_plain(w)) for w in row] for row in table])
    return values, np.array([_half_units([row[k] for row in table]) for k in range(len(table[0]))]).T


def _plain(word: str) -> str:
    """The number with an exponent that Python reads: Fortran writes 1.5D-3."""
    return word.replace("D", "e").replace("d", "e")


def _is_number(word: str) -> bool:
    try:
        float(_plain(word))
    except ValueError:
        return False
    return True


def _half_units(words: list[str]) -> list[float]:
    """Half a unit in the last digit of each number of a column.

    C's %g and Python's repr leave out zeros at the end, so one number does not show its digits. The
    longest numbers of the column do: D decimals, among numbers without an exponent, and S
    significant digits. A fixed format rounds at the D-th decimal, %g and %e at the S-th digit;
    which of the two it was is not known, so the larger unit counts.
    """
    parts = [re.fullmatch(r"[+-]?(\d*)\.?(\d*)(?:e([+-]?\d+))?", _plain(w), re.IGNORECASE) for w in words]
    decimals = max((len(p[2]) for p in parts if p and p[3] is None), default=0)
    digits = max((len((p[1] + p[2]).lstrip("0")) for p in parts if p), default=0)
    halves = []
    for word, part in zip(words, parts, strict=True):
        value = abs(float(_plain(word)))
        significant = 10.0 ** (np.floor(np.log10(value)) + 1 - digits) if 0 < value < np.inf else 0.0
        fixed = 10.0**-decimals if part is not None and part[3] is None else 0.0
        halves.append(0.5 * max(significant, fixed))
    return halves
