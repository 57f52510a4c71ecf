"""Make the page of sentences that do not hold as printed:
``python -m benchmarks.errata > docs/errata.md``.

``--check FILE`` compares every quotation with a plain text of the paper instead, letter by letter.
"""

from __future__ import annotations

import re
from pathlib import Path

import click

from benchmarks import start
from sepv.paper.errata import ENTRIES, Erratum, errata

# The most letters that a formula and an omission between two quoted pieces may have.
FORMULA, OMISSION = 250, 3000


def to_markdown() -> str:
    """The text of docs/errata.md from the entries and their evidence."""
    lines = [
        "# Sentences of the paper that do not hold as printed",
        "",
        "This page quotes [Cohen and Dujardin](paper.md); […] replaces text quoted above. Each verdict rests on",
        "computed evidence; brackets say how the evidence satisfies the passage's assumptions.",
        "`sepv reproduce --errata` prints this page.",
    ]
    quoted: set[str] = set()
    for entry, measured in errata():
        sentences = re.split(r"(?<=[a-z]\.) (?=[A-Z])|(?<=…) (?=[A-Z])", entry.quote)
        quote = " ".join("[…]" if sentence in quoted else sentence for sentence in sentences)
        quoted |= {*sentences}
        command = "" if entry.command == Erratum.command else f" (`{entry.command}`)"
        lines += ["", f"## {entry.place}", "", f"> {quote.replace('[…] […]', '[…]')}", ""]
        lines += [
            f"- printed: {entry.printed}",
            f"- correct: {entry.right}",
            f"- evidence ({entry.hypotheses}): {measured}{command}",
        ]
    return "\n".join(lines) + "\n"


def missing(quote: str, text: str) -> str:
    """The first piece of the quotation that does not follow the ones before it in the text;
    empty if all do.
    """
    pieces = re.split(r"(`[^`]*`|…)", quote)
    letters = _letters(text)
    first, at, gap = True, 0, 0
    for piece in pieces:
        if piece == "…" or piece.startswith("`"):
            gap += OMISSION if piece == "…" else FORMULA
        elif wanted := _letters(piece):
            end = len(letters) if first else at + gap + len(wanted)
            here = letters.find(wanted, at, end)
            if here < 0:
                return piece.strip()
            first, at, gap = False, here + len(wanted), 0
    return ""


def _letters(text: str) -> str:
    return re.sub(r"[^a-z]", "", text.lower())


@click.command()
@click.option("--check", type=click.Path(exists=True, path_type=Path), help="A plain text of the paper.")
def main(check: Path | None) -> None:
    """Print the page, or compare the quotations with a text of the paper."""
    if check is None:
        print(to_markdown(), end="")
        return
    text = check.read_text("utf-8")
    wrong = [f"{e.place}: {piece!r}" for e in ENTRIES if (piece := missing(e.quote, text))]
    if wrong:
        raise click.ClickException("not in the text: " + "; ".join(wrong))
    print(f"{len(ENTRIES)} quotations are in the text")


if __name__ == "__main__":
    start(main)
