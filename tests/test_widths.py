"""Narrow terminals lose columns, never digits."""

from __future__ import annotations

import io

import pytest
from rich.cells import cell_len
from rich.console import Console

from sepv.law import Effort, Finding, Verdict
from sepv.report import law_table
from sepv.schemes import midpoint
from sepv.suite import Report

FOUND = tuple(
    Finding(law, verdict, source, unit, law != "energy", defect, bound)
    for law, verdict, source, unit, defect, bound in (
        ("mean-square-order", Verdict.INCONCLUSIVE, "Thm 3.3, 3.4", "slope", 1.0234, 0.75),
        ("energy", Verdict.VIOLATED, "Prop. 3.1", "ulp of H", 1.234e10, 52.125),
        ("contract", Verdict.HOLDS, "contract", "faults", 0.0, 0.0),
    )
)


@pytest.mark.parametrize("width", [40, 48, 60, 72, 80, 100])
def test_a_report_fits_and_shows_whole_numbers(width: int) -> None:
    shown = io.StringIO()
    out = Console(file=shown, width=width)
    out.print(law_table(Report(midpoint, FOUND, Effort()), out.width))
    text = shown.getvalue()
    assert max(map(cell_len, text.splitlines())) <= width
    for word in ("mean-square-order", "inconclusive", "1.2e+10", "1.02"):
        assert word in text
    assert "…" not in text
    if width >= 80:
        for word in ("52.1", "Prop. 3.1", "ulp of H", "claimed"):
            assert word in text
