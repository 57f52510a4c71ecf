"""Write the heads of the laws' pages from the `Law` objects: ``python -m benchmarks.law_pages``.

The head of a law's page, all that comes before the formula, is made from the `Law`; the rest is
written by hand. The table of `docs/adapting.md` that says how laws are measured in the middle of a
path is made from them too.
"""

from __future__ import annotations

import re
from pathlib import Path

from benchmarks import start
from sepv.law import Law, Middle
from sepv.problem import FACTS
from sepv.schemes import page_of as name_of_page
from sepv.verification import ALL_LAWS, load_laws

DOCS = Path(__file__).resolve().parents[1] / "docs"
# Parts of a page that are written by hand, in their order; each begins a paragraph. The last part
# is present only if the report of a violation needs an explanation.
PAGE_PARTS = ("Why", "Measured", "Bound", "Broken by", "A violation")
OPTIONAL = PAGE_PARTS[-1:]


def page_of(law: Law) -> Path:
    """The file of the page of a law and its parts."""
    return DOCS / "laws" / f"{name_of_page(law.name)}.md"


def head(law: Law) -> str:
    """The lines of a page up to its formula: the law's statement and its other fields,
    and those of its parts.
    """
    file = f"test_{law.name.replace('-', '_')}.py"
    facts = f"{_facts(law)} [{file}](../../properties/{file})."
    facts += " Every scheme claims it." if law.always_claimed else ""
    text = law.statement
    text = (
        text[0].upper() + text[1:] if re.match(r"(?!det )(a|[a-z]{2,}) ", text) else text
    )  # y1 and det Φ′ are kept
    parts = [part for part in load_laws(ALL_LAWS) if part.name.startswith(f"{law.name}:")]
    listed = "".join(f"- *{part.name}*: {part.statement}. {_facts(part)}\n" for part in parts)
    return f"# {law.name}\n\n{text}.\n\n{facts}\n\n" + (f"{PARTS_OF_LAW}{listed}\n" if parts else "")


def _facts(law: Law) -> str:
    needs = ", ".join(FACTS[fact] for fact in law.cases.needs) if law.cases else ""
    needs = f" Needs: [{needs}](../laws.md#terms)." if needs else ""
    return f"Source: {law.source}. Unit: [{law.unit}](../laws.md#terms).{needs}"


def with_pages() -> list[Law]:
    """The laws that have a page: all but parts of laws."""
    return [law for law in load_laws(ALL_LAWS) if name_of_page(law.name) == law.name]


def page(law: Law, text: str) -> str:
    """The text of a law's page with a new head."""
    return head(law) + text[text.index("$$") :]


PARTS_OF_LAW = "Its parts, claimed and measured apart:\n\n"
MIDDLES_HEAD = "| laws | with a state |\n|---|---|\n"


def middles() -> str:
    """The table that says how each law is measured in the middle of a path of a scheme with a
    state, or why not.
    """
    by_words: dict[str, list[str]] = {middle.value: [] for middle in Middle}
    for law in load_laws(ALL_LAWS):
        words = law.middle.value if isinstance(law.middle, Middle) else f"first steps: {law.middle}"
        by_words.setdefault(words, []).append(f"*{law.name}*")
    return MIDDLES_HEAD + "".join(f"| {', '.join(laws)} | {words} |\n" for words, laws in by_words.items())


def main() -> None:
    file = DOCS / "adapting.md"
    before, _, after = file.read_text(encoding="utf-8").partition(MIDDLES_HEAD)
    file.write_text(before + middles() + after[after.index("\n\n") + 1 :], encoding="utf-8")
    for law in with_pages():
        file = page_of(law)
        file.write_text(page(law, file.read_text(encoding="utf-8")), encoding="utf-8")


if __name__ == "__main__":
    start(main)
