"""A record as a table on the terminal."""

from __future__ import annotations

from typing import Any

import numpy as np

from sepv._terminal import Table, columns

# The counters in the order of the columns, and their headings.
HEADINGS = {
    "gradient": "∇H", "structure": "B", "hamiltonian": "H", "hessian": "H″", "structure derivative": "B′",
    "iterations": "Newton", "failed solves": "failed",
}  # fmt: skip


# What goes first where a terminal is narrow.
DROPPED = ("H″", "B′", "H", "failed", "Newton", "ΔC", "B", "ΔH")


def record_table(record: dict[str, Any]) -> Table:
    """One row for each case: counters of all paths and steps, rms error and defects."""
    rows = [
        (
            case["case"]["name"].replace("harmonic-", "harmonic-\n"),
            *("–" if (n := case["counters"].get(name)) is None else str(n) for name in HEADINGS),
            *(_rms(case[kind]) for kind in ("error", "energy", "casimir")),
        )
        for case in record["cases"]
    ]
    heads = columns(["case"], [*HEADINGS.values(), "error", "ΔH", "ΔC"], goes=DROPPED)
    return Table(heads, rows, f"{record['target']}: evaluations over all paths and steps, rms over paths")


def _rms(groups: list[str]) -> str:
    return f"{np.sqrt(np.mean([float.fromhex(v) for v in groups])):.1e}".replace("e-0", "e-").replace(
        "e+00", ""
    )
