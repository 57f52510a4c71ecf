"""What does not hold as printed: every entry is computed, and the page shows what is computed."""

from __future__ import annotations

from pathlib import Path

from click.testing import CliRunner

from benchmarks.errata import to_markdown
from sepv.commands import main
from sepv.studies._reproduce.errata import errata, statements


def test_every_statement_of_the_file_fails_as_printed() -> None:
    found = statements()
    assert [s.verdict for s in found] == ["fails"] * len(found)
    assert all(s.correction and s.measured and s.criterion and s.source for s in found)


def test_the_page_shows_what_is_computed() -> None:
    page = Path(__file__).parents[1] / "docs" / "errata.md"
    assert page.read_text(encoding="utf-8") == to_markdown(), "python -m benchmarks.errata > docs/errata.md"


def test_the_command_prints_place_correction_evidence_and_command() -> None:
    result = CliRunner().invoke(main, ["reproduce", "--errata"])
    assert result.exit_code == 0
    for entry in errata():
        assert entry.place in result.output
        assert entry.command in result.output
    assert result.output.count("evidence:") == len(errata())
