"""docs/class.md, which `python -m benchmarks.hamiltonians` prints: its prose, its names, and some of its numbers."""

from __future__ import annotations

from pathlib import Path

import pytest
from sepv.reference.faults.saboteurs import SABOTEURS

import sepv
from benchmarks.hamiltonians import CLAIMS, DIFFERENCES, SCHEMES, TITLE, table, verdicts
from sepv import schemes

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "class.md").read_text(encoding="utf-8")


def test_the_page_has_the_text_of_the_command_and_all_names() -> None:
    assert TITLE in PAGE
    assert DIFFERENCES in PAGE
    assert table(["scheme", "source", "claimed there", "claimed here besides"], CLAIMS) in PAGE
    assert set(SCHEMES) == set(schemes.HAMILTONIANS) == {row[0] for row in CLAIMS}
    for saboteur in SABOTEURS.values():
        if saboteur.family == "hamiltonians":
            assert f"| {saboteur.name} | {saboteur.broken} | {saboteur.caught_by[0]} | 10/10 | " in PAGE


def test_the_page_says_what_is_measured_now() -> None:
    """Slopes by quadrature, and one verdict, of the quickest scheme."""
    report = sepv.verify("isospectral-midpoint", laws="poisson-map,local-mean,local-mean-square,local-weak")
    shown = next(
        row for row in PAGE.splitlines() if row.startswith("| isospectral-midpoint | random-inertia")
    )
    witness = report.finding("local-mean-square").witness or {}
    now = {m["problem"]: m for m in witness["measured"]}
    assert float(shown.split("|")[5].split()[0]) == pytest.approx(now["random-inertia"]["slope"], abs=0.02)
    (verdict,) = [row for row in PAGE.splitlines() if row.startswith("| isospectral-midpoint | contract, ")]
    claimed = verdict.split(" | ")[1].split(", ")
    assert {f.law for f in report.findings if f.claimed and f.verdict.value == "holds"} <= set(claimed)
    assert "| isospectral-midpoint | poisson-map, local-mean, " in verdicts({"isospectral-midpoint": report})
