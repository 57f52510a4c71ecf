"""docs/sources.md says of every work that the pages name what was read."""

import re
from pathlib import Path

import pytest
from doors import PAGES, ROOT, doc

SOURCES = doc("sources.md")
NAME = r"(?:[A-Z]\. )?[A-Z][a-zé]+"
# "Cohen and Hairer (2011)", "D. Cohen and G. Vilmart, … 2022": names, and a year within the next words.
CITED = re.compile(rf"({NAME}(?:, {NAME})*,? and {NAME}|{NAME}) \(?((?:19|20)\d\d)\b")


def cited(text: str) -> set[tuple[str, str]]:
    """Last names and years."""
    found = set()
    for names, year in CITED.findall(text):
        found |= {(name, year) for name in re.findall(r"[A-Z][a-zé]+", names)}
    return found


def test_citations_are_recognised() -> None:
    assert cited("as (Ge and Marsden 1988) say") == {("Ge", "1988"), ("Marsden", "1988")}
    assert cited("Cohen and Hairer (2011) and Pébay 2008") == {
        ("Cohen", "2011"), ("Hairer", "2011"), ("Pébay", "2008"),
    }  # fmt: skip


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_every_work_that_a_page_names_is_listed_with_what_was_read(page: Path) -> None:
    rows = [row for row in SOURCES.splitlines() if row.startswith("- ")]
    for name, year in cited(page.read_text("utf-8")):
        assert name in ("November",) or any(name in row and year in row for row in rows), f"{name} {year}"
    for number in re.findall(r"arXiv:? ?(\d{4}\.\d{4,5})", page.read_text("utf-8")):
        assert any(number in row for row in rows), number


def test_every_library_is_listed() -> None:
    libraries = [folder.name for folder in (ROOT / "results").iterdir() if folder.is_dir()]
    assert libraries
    assert all(re.search(rf"^- {library} \d", SOURCES, re.MULTILINE) for library in libraries)
