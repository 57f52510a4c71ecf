"""docs/class.md, which `python -m benchmarks.hamiltonians` prints: its prose, its names, and some of its numbers."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from sepv.reference.faults.saboteurs import SABOTEURS

import sepv
from benchmarks.hamiltonians import CLAIMS, DIFFERENCES, SCHEMES, TITLE, slopes, table, verdicts
from sepv import schemes

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "class.md").read_text(encoding="utf-8")


def test_the_page_has_the_text_of_the_command_and_all_names() -> None:
    assert TITLE in PAGE
    assert DIFFERENCES in PAGE
    assert table(["scheme", "source", "claimed there", "claimed here besides"], CLAIMS) in PAGE
    assert set(SCHEMES) == set(schemes.HAMILTONIANS) == {row[0] for row in CLAIMS}
    for saboteur in SABOTEURS.values():
        if saboteur.family == "hamiltonians":
            assert f"| {saboteur.name} | {saboteur.broken} | {saboteur.caught_by[0]} |" in PAGE
    assert "kills it with 10 of 10 seeds" in PAGE


def test_the_page_says_what_is_measured_now() -> None:
    """Slopes by quadrature, and one verdict, of the quickest scheme."""
    laws = "poisson-map,energy-drift,local-mean-square,local-weak"
    report = sepv.verify("isospectral-midpoint", laws=laws)
    now = slopes({"isospectral-midpoint": report}).splitlines()[-1]
    (shown,) = [
        row
        for row in PAGE.partition("## Slopes")[2].splitlines()
        if row.startswith("| isospectral-midpoint ")
    ]
    assert numbers(now) == pytest.approx(numbers(shown), abs=0.02)
    assert len(numbers(now)) == 6
    assert verdicts({"isospectral-midpoint": report}).splitlines()[-1] in PAGE


def numbers(row: str) -> list[float]:
    return [float(number) for number in re.findall(r"\d\.\d+", row)]
