"""A record as a table on the terminal."""

from __future__ import annotations

from typing import Any

import numpy as np
from rich.table import Table
from rich.text import Text

from sepv._terminal import fitted

# The counters in the order of the columns, and their headings.
HEADINGS = {
    "gradient": "∇H", "structure": "B", "hamiltonian": "H", "hessian": "H″", "structure derivative": "B′",
    "iterations": "Newton", "failed solves": "failed",
}  # fmt: skip


# What goes first where a terminal is narrow.
DROPPED = ("H″", "B′", "H", "failed", "Newton", "ΔC", "B", "ΔH")


def record_table(record: dict[str, Any], width: int = 120) -> Table:
    """One row for each case: counters of all paths and steps, rms error and defects."""
    table = Table(
        box=None,
        title=Text(f"{record['target']}: evaluations over all paths and steps, rms over paths", style="bold"),
        title_justify="left",
        pad_edge=False,
        padding=(0, 1, 0, 0),
    )
    table.add_column("case")
    for heading in (*HEADINGS.values(), "error", "ΔH", "ΔC"):
        table.add_column(heading, justify="right", no_wrap=True)
    for case in record["cases"]:
        counts = [case["counters"].get(name) for name in HEADINGS]
        table.add_row(
            case["case"]["name"].replace("harmonic-", "harmonic-\n"),
            *("–" if n is None else str(n) for n in counts),
            *(_rms(case[kind]) for kind in ("error", "energy", "casimir")),
        )
    return fitted(table, width, DROPPED, wrapped=["case"])


def _rms(groups: list[str]) -> str:
    return f"{np.sqrt(np.mean([float.fromhex(v) for v in groups])):.1e}".replace("e-0", "e-").replace(
        "e+00", ""
    )
