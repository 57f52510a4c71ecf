"""Narrow terminals lose columns, never digits."""

import io
from typing import Any

import pytest
from doors import command
from rich.cells import cell_len
from rich.console import Console

from sepv.console import Table, columns, kept, markdown, print_table
from sepv.schemes import midpoint
from sepv.verification import Effort, Finding, Report, Verdict
from sepv.verification._report import law_table

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
    print_table(law_table(Report(midpoint, FOUND, Effort())), out)
    text = shown.getvalue()
    assert max(map(cell_len, text.splitlines())) <= width
    for word in ("mean-square-order", "inconclusive", "1.2e+10", "1.02"):
        assert word in text
    assert "…" not in text
    if width >= 80:
        for word in ("52.1", "Prop. 3.1", "ulp of H", "claimed"):
            assert word in text


def test_columns_go_in_their_order_and_only_as_far_as_they_must() -> None:
    needed = {"name": 8, "a": 4, "b": 4, "c": 4}
    assert kept(needed, 23, ("c", "a"), between=1) == ["name", "a", "b", "c"]
    assert kept(needed, 22, ("c", "a"), between=1) == ["name", "a", "b"]
    assert kept(needed, 1, ("c", "a"), between=1) == ["name", "b"]


ROWS = [("one", "Ann & Bob", "1.25e-10", "7"), ("two", "somebody else", "3", "123456")]


def shown(width: int, encoding: str = "utf-8", **more: Any) -> str:
    stream = io.TextIOWrapper(io.BytesIO(), encoding=encoding)
    numbers = columns((), ["Δ", "steps"], goes=("steps", "who"))
    heads = columns(["name"]) + columns(["who"], words=True) + numbers
    print_table(Table(heads, ROWS, **more), Console(file=stream, width=width, color_system=None))
    stream.seek(0)
    return stream.read()


def test_a_table_is_roomy_where_it_fits_and_close_where_it_does_not() -> None:
    assert "Ann & Bob      1.25e-10       7" in shown(60)
    assert "1.25e-10      7" in shown(34)
    for width in range(13, 60):
        text = shown(width)
        assert max(map(cell_len, text.splitlines())) <= width
        assert "1.25e-10" in text  # what stays is whole
        table, _, gone = text.partition("Left out")
        assert ("123456" in table) == ("steps" in table) == ("steps" not in gone)
    assert "name" not in shown(60, headed=False)


def test_a_terminal_of_ascii_measures_what_it_shows() -> None:
    text = shown(60, "ascii")
    assert "Delta" in text
    lines = [line for line in text.splitlines() if line.strip()]
    assert len({cell_len(line) for line in lines}) == 1
    shown(40, "ascii", title="h → 0", ruled=True)  # what cannot be encoded would raise


def test_a_ruled_table_has_its_line_on_a_wide_terminal_alone() -> None:
    assert "───" in shown(80, ruled=True)
    assert "───" not in shown(50, ruled=True)


def test_a_table_of_markdown() -> None:
    assert markdown(["a", "b"], [("1", "2")]) == "| a | b |\n| --- | --- |\n| 1 | 2 |"


# Sentences, which a terminal wraps itself.
NOTES = ("~", "2 cases", "energy-preserving:", "≤")


@pytest.mark.parametrize("width", [40, 60, 80, 120])
@pytest.mark.parametrize(
    ("words", "whole"),
    [
        ("list", "energy-preserving"),
        ("hard --steps 2 --case kepler-0.99 --case rigid-body-inertia-1e6", "rigid-body-inertia-1e6*"),
        ("ulps energy-preserving midpoint -p pendulum --steps 2", "0.0312"),
        ("bench energy-preserving --case rigid-body", "32393"),
        ("compare energy-preserving --steps 4,8 --paths 50 --repeats 3 -q", "energy-preserving"),
        ("run energy-preserving --steps 100", "steps"),
    ],
)
def test_commands_fit_and_lose_no_digit(words: str, whole: str, width: int) -> None:
    printed = command(words, COLUMNS=str(width)).stdout
    shown = [line for line in printed.splitlines() if not line.startswith(NOTES)]
    assert max(map(cell_len, shown)) <= width
    assert any(whole in line.split() for line in shown)
    # The only ellipses are those of ranges.
    assert "…" not in printed.replace(" … ", "")
