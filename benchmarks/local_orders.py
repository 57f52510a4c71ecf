"""Local orders of the schemes by quadrature over ΔW, as a table:
``python -m benchmarks.local_orders``.

The table has for each scheme the slopes of (3.8), (3.9) and of the weak condition, beside the
slopes that its claims require, and the number of steps. A slope is the smallest over the problems
of the laws "local-mean", "local-mean-square" and "local-weak". No random numbers are drawn, so that
results repeat. ``--points`` shows instead weak schemes with increments of two and three points, by
"local-weak" and "weak-order".
"""

from __future__ import annotations

import argparse

from rich.console import Console
from rich.table import Table

from benchmarks import over, start
from sepv import schemes
from sepv.law import Finding, Verdict
from sepv.schemes import Scheme, weakly
from sepv.verification import verify

LAWS = ("local-mean", "local-mean-square", "local-weak")
POINTS = (
    ("modified-weak-2", "three-point"),
    ("modified-weak-2", "two-point"),
    ("collocation-2", "three-point"),
    ("energy-preserving", "two-point"),
)


def every() -> list[Scheme]:
    """The schemes of the table: the built-in ones, and the families with up to six stages."""
    families = [family(s) for family in schemes.FAMILIES.values() for s in range(1, 7)]
    return [*schemes.PAPER.values(), *schemes.EXTENSIONS.values(), *families]


def shown(finding: Finding) -> str:
    """A slope beside the least slope that is allowed, as text;
    "rounding" if all errors are rounding.
    """
    if finding.verdict is Verdict.NOT_APPLICABLE:
        return "–"
    slope = "rounding" if finding.defect is None else f"{finding.defect:.2f}"
    mark = "" if finding.verdict is Verdict.HOLDS else f" {finding.verdict.text}"
    return f"{slope} ≥ {finding.bound:g}{mark}"


def number(order: float | None) -> str:
    """A claimed order as text."""
    return "–" if order is None else f"{order:g}"


def points() -> None:
    """Print the slopes of weak schemes with increments of a few points, as a table in Markdown."""
    print("| scheme | increments | local-weak | weak-order |\n|---|---|---|---|")
    for name, increments in POINTS:
        findings = verify(weakly(schemes.by_name(name), increments), laws="local-weak,weak-order").findings
        print(f"| {name} | {increments} | {' | '.join(map(shown, findings))} |", flush=True)


def main() -> None:
    """Print the table, in Markdown with --markdown."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scheme", action="append", help="only these, by name")
    parser.add_argument("--markdown", action="store_true")
    parser.add_argument("--points", action="store_true")
    options = parser.parse_args()
    if options.points:
        points()
        return
    chosen = [schemes.by_name(name) for name in options.scheme] if options.scheme else every()
    headings = ("scheme", "claims", "k", "(3.8)", "(3.9)", "weak", "steps")
    table = Table(box=None)
    for heading in headings:
        table.add_column(heading)
    if options.markdown:
        print("| " + " | ".join(headings) + " |\n|" + "---|" * len(headings))
    for scheme in over(chosen, lambda s: s.name):
        report = verify(scheme, laws=LAWS)
        if report.interrupted:
            raise KeyboardInterrupt
        findings = report.findings
        claims = f"{number(scheme.mean_square_order)} / {number(scheme.weak_order)}"
        steps = str(max(f.checks for f in findings))
        row = (scheme.name, claims, number(scheme.truncation), *map(shown, findings), steps)
        if options.markdown:
            print("| " + " | ".join(row) + " |", flush=True)
        table.add_row(*row)
    if not options.markdown:
        Console(width=110).print(table)


if __name__ == "__main__":
    start(main)
