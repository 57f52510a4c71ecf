"""What does not hold as printed: quotations with their neighbours, evidence that decides, and the page."""

import html
import re
from dataclasses import replace

import pytest
from doors import command, doc
from sepv.reference.paper import errata
from sepv.reference.paper.errata import ENTRIES, Erratum, Evidence

from benchmarks.errata import missing, to_markdown


def test_every_entry_is_refuted_by_its_evidence() -> None:
    assert {s.source: s.verdict for s in errata.statements()} == {e.place: "fails" for e in ENTRIES}


@pytest.mark.parametrize("entry", ENTRIES, ids=lambda e: e.place)
def test_an_entry_quotes_its_sentence_with_its_neighbours(entry: Erratum) -> None:
    """Words before or after the formula that is decided on, and each field filled in."""
    assert all(getattr(entry, name) for name in ("printed", "criterion", "hypotheses", "right", "command"))
    words = re.findall(r"[A-Za-z]{2,}", re.sub(r"`[^`]*`", "", entry.quote))
    assert len(words) >= 15


def test_no_verdict_is_written_by_hand(monkeypatch: pytest.MonkeyPatch) -> None:
    """An entry whose evidence holds, or decides nothing, is not shown as an erratum."""
    held = replace(ENTRIES[0], evidence=lambda: Evidence(True, False, "equal"))
    open_ = replace(ENTRIES[1], evidence=lambda: Evidence(False, False, "not decided"))
    monkeypatch.setattr(errata, "ENTRIES", (held, open_, ENTRIES[2]))
    assert [entry.place for entry, _ in errata.errata()] == [ENTRIES[2].place]
    assert [s.verdict for s in errata.statements()] == ["holds", "open", "fails"]


def test_quotations_are_compared_with_a_text_word_by_word() -> None:
    text = "Indeed, the set is\nopen A = 3 and it is con-\nvex. Hence it is simple."
    assert missing("the set is open `A = 3` and it is convex.", text) == ""
    assert missing("the set is open … Hence it is simple", text) == ""
    assert missing("the set is closed `A = 3`", text) == "the set is closed"
    assert missing("Hence it is simple … Indeed", text) == "Indeed"


def test_the_page_shows_what_is_computed() -> None:
    assert doc("errata.md") == to_markdown(), "python -m benchmarks.errata > docs/errata.md"


def test_the_committed_report_refutes_nothing_of_the_paper_but_the_errata() -> None:
    """What is not the paper's says "(ours)". Where it fails: python -m benchmarks.page"""
    refuted = [html.unescape(t) for t in re.findall(r"does not hold</span> (.*?) <span", doc("report.html"))]
    assert refuted
    assert {text for text in refuted if not text.startswith("(ours)")} <= {e.printed for e in ENTRIES}


def test_the_command_prints_place_correction_evidence_and_command() -> None:
    result = command("reproduce --errata")
    for entry in ENTRIES:
        assert entry.place in result.output
        assert entry.command in result.output
    assert result.output.count("evidence:") == len(ENTRIES)
