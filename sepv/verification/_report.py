"""A report on the terminal: the table, the counterexamples, and the commands that replay them."""

from __future__ import annotations

import io
import sys
from collections.abc import Callable, Sequence
from html import escape
from typing import TYPE_CHECKING

from rich.console import Console
from rich.text import Text

from sepv.console import (
    Column,
    Table,
    ascii_text,
    cannot_show,
    counted,
    plain_console,
    print_sentence,
    print_table,
)
from sepv.law import Finding, Verdict, same_error
from sepv.verification._profiles import PROFILES, SUITE, found

if TYPE_CHECKING:
    from sepv.verification._outcome import Outcome

# The style of each verdict in a table, and its mark in the matrix of schemes and laws.
_STYLE_AND_MARK = {
    Verdict.HOLDS: ("green", "holds"),
    Verdict.VIOLATED: ("bold red", "–"),
    Verdict.INCONCLUSIVE: ("yellow", "?"),
    Verdict.NOT_APPLICABLE: ("dim", "n/a"),
    Verdict.ERROR: ("bold magenta", "error"),
    Verdict.NOT_MEASURED: ("dim", ""),
}
_VERDICT_STYLES = {verdict: style for verdict, (style, _) in _STYLE_AND_MARK.items()}
VERDICT_MARKS = {verdict: mark for verdict, (_, mark) in _STYLE_AND_MARK.items()}
# Laws that every scheme claims. If a scheme claims no more, the violation of another law fails a
# run only with a pin.
CLAIMED_BY_ALL = ("contract",)


def show(report: Outcome, out: Console, *, debug: bool = False) -> None:
    """Print the table of a report, then each counterexample with the command that replays it.

    Findings that make the run fail come first; laws that are violated as expected come last, in one
    line each.
    """
    print_table(law_table(report), out)
    errors_shown: set[str] = set()
    for finding in sorted(report.findings, key=lambda f: (f.waived, f not in report.failing)):
        error = same_error(finding.message) if finding.verdict is Verdict.ERROR else ""
        if error in errors_shown:
            continue
        errors_shown |= {error} if error else set()
        if finding.verdict is Verdict.NOT_MEASURED:
            continue  # the table and the last line already show it
        if finding.waived:
            print_sentence(out, Text(finding.words, style="dim"))
            continue
        if finding.message or finding.verdict is not Verdict.HOLDS or finding.expected is not None:
            _details(finding, report, out, debug=debug)
    print_sentence(out, summary(report))


def as_text(report: Outcome) -> str:
    """The output of `show` as text without colour, for `print(report)`."""
    return _plain(lambda out: show(report, out))


def in_notebook(report: Outcome, page: str) -> str:
    """HTML for a notebook: the `page` of a report in a frame that runs no script,
    and the last line of the report.
    """
    frame = '<iframe sandbox="allow-same-origin" style="width:100%;height:42rem;border:1px solid #8886"'
    return f'{frame} srcdoc="{escape(page)}"></iframe><p>{escape(summary(report).plain)}</p>'


def _plain(write: Callable[[Console], None]) -> str:
    """The text that `write` prints on a console, without colour."""
    out = io.StringIO()
    write(plain_console(out))
    text = "\n".join(line.rstrip() for line in out.getvalue().rstrip().splitlines())
    return ascii_text(text) if cannot_show(sys.stdout) else text


# The columns of the table. On a narrow terminal the columns with a number `goes` are dropped, in
# order of this number.
_REPORT_COLUMNS = (
    Column("law"), Column("claimed", goes=3), Column("verdict"), Column("defect", right=True),
    Column("bound", right=True, goes=4), Column("unit", words=True, goes=2), Column("source", words=True, goes=1),
)  # fmt: skip


def law_table(report: Outcome) -> Table:
    """The table of laws: law, claimed, verdict, defect against bound, unit, source."""
    title = report.scheme.name + (f" · {report.scheme.source}" if report.scheme.source else "")
    rows = [_law_row(report, f) for f in report.findings]
    return Table(_REPORT_COLUMNS, rows, Text(title, style="bold"), ruled=True)


def _law_row(report: Outcome, f: Finding) -> tuple[str | Text, ...]:
    text = "n/a" if f.verdict is Verdict.NOT_APPLICABLE else f.verdict_text
    claim = "yes" if f.law in report.scheme.claims else "always"
    claimed = "fails" if f.expected is not None else claim if f.claimed else ""
    bound = "" if f.bound is None else f"{'≥' if f.at_least else '≤'} {_number(f.bound)}"
    style = "dim" if f.waived else _VERDICT_STYLES[f.verdict]
    return f.law, claimed, Text(text, style=style), _number(f.defect), bound, f.unit, f.source


def summary(report: Outcome, before: str = "") -> Text:
    """The last line of a report: the counts, the claims, the profiles,
    and advice for a scheme without claims.

    If the line is printed without the table, `before` names the scheme.
    """
    return Text(before, style="bold").append_text(_outcome(report)).append_text(_profiles(report))


def _outcome(report: Outcome) -> Text:
    counts = ", ".join(Verdict(k).of(n) for k, n in report.counts.items() if n)
    checks, skipped = (sum(getattr(f, what) for f in report.findings) for what in ("checks", "skipped"))
    left_out = f", {skipped} skipped" if skipped else ""
    text = Text(f"{counted(len(report.findings), 'law')}: {counts}; {counted(checks, 'check')}{left_out}. ")
    if report.interrupted:
        why = report.lost.partition("\n")[0] or "Interrupted"
        return text.append(f"{why.rstrip('.')}: what was not measured is not judged.", style="bold")
    for gap in report.gaps:
        text.append(f"{gap} ", style="yellow")
    wrong = _complaints(report)
    if wrong:
        return text.append(" ".join(wrong), style="bold red")
    errors = [f.law for f in report.findings if f.verdict is Verdict.ERROR]
    if errors:
        text.append(f"Ended in an error: {', '.join(errors)}. ", style="bold magenta")
    claims = [f for f in report.findings if f.claimed and f.expected is None]
    claims = [f for f in claims if f.verdict is not Verdict.ERROR]
    if report.pinned is None and not frozenset(report.scheme.claims) - set(CLAIMED_BY_ALL):
        return text.append(_unguarded(report))
    vacuous = [f.law for f in claims if f.verdict is Verdict.NOT_APPLICABLE]
    held = len(claims) - len(vacuous)
    if held:
        words = "The claimed law holds." if held == 1 else f"All {held} claimed laws hold."
        text.append(words, style="green")
    elif not vacuous and not errors:
        text.append("None of them is claimed." if len(report.findings) > 1 else "It is not claimed.")
    if vacuous:
        text.append(f" Claimed, but not about this scheme: {', '.join(vacuous)}.", style="yellow")
    return text


def _profiles(report: Outcome) -> Text:
    """Name the profiles that the scheme was found to have,
    and the required profiles that were not found.
    """
    text, profiles = Text(""), report.profiles
    if report.interrupted:
        return text
    if named := found(profiles) or ["no profile"] * (len(profiles) == len(PROFILES)):
        waived = f"; waived: {', '.join(report.waived)}" if report.waived else ""
        text.append(f" Found (suite {SUITE}): {', '.join(named)}{waived}.")
    if report.missing:
        text.append(f" Required and not found: {', '.join(report.missing)}.", style="bold red")
    return text


def _complaints(report: Outcome) -> list[str]:
    """The reasons why a run fails, one sentence for each kind of reason."""
    findings, failing = report.findings, report.failing
    wrong = (Verdict.VIOLATED, Verdict.INCONCLUSIVE, Verdict.ERROR)
    named = [f for f in failing if f.expected is None]
    kinds = {
        "Claimed and not found to hold": (
            f for f in findings if f.claimed and f.expected is None and f.verdict in wrong
        ),
        "Claimed and not measured": (f for f in named if f.verdict is Verdict.NOT_APPLICABLE),
        "Expected failures that pass": (f for f in failing if f.expected is not None),
        "Violated and not in the pin": (f for f in named if not f.claimed),
    }
    laws = {words: ", ".join(f.law for f in which) for words, which in kinds.items()}
    return [f"{words}: {which}." for words, which in laws.items() if which]


def _unguarded(report: Outcome) -> str:
    """Advice for a scheme without claims: which claims would make a later run fail if a law that
    holds now breaks.
    """
    if report.pins:
        return "Nothing is claimed yet: the file of --pin guards what was found, once --expected names it."
    unguarded = [f.law for f in report.findings if f.verdict is Verdict.HOLDS and f.law not in CLAIMED_BY_ALL]
    text = "Nothing is claimed, so nothing is guarded but the contract of a step."
    if not report.target:
        claims = f' To guard what held today: sepv.verify(scheme, claims="{",".join(unguarded)}").'
        return text + claims if unguarded else text
    named, guard = f"sepv verify {report.target}", "To guard what is violated"
    if unguarded:
        guard = (
            f"To guard what held today: {named} --claim {','.join(unguarded)}; and what is violated with it"
        )
    return f"{text} {guard}: {named} --pin FILE."


def matrix(reports: Sequence[Outcome]) -> Table:
    """A table of verdicts: a row for each law, a column for each scheme."""

    def cell(f: Finding) -> Text:
        return Text(VERDICT_MARKS[f.verdict] + (" +" if f.claimed else ""), style=_VERDICT_STYLES[f.verdict])

    rows = [[f[0].law, *map(cell, f)] for f in zip(*(r.findings for r in reports), strict=True)]
    # Blanks after a name make the headings differ, because two schemes may have the same name.
    named = [Column(f"{r.scheme.name}{' ' * n}", words=True) for n, r in enumerate(reports)]
    caption = "+ claimed, – violated, ? inconclusive"
    return Table((Column("law"), *named), rows, caption=caption, ruled=True)


def show_finding(finding: Finding, out: Console, *, debug: bool = False) -> None:
    """Print one finding, as after a replay."""
    line = _headed(finding, f"  {finding.source}")
    if finding.defect is not None:
        line.append(f"  {_number(finding.defect)} against {_number(finding.bound)} {finding.unit}")
    out.print(line)
    _indented(finding.message + (f"\n{finding.traceback}" if debug else ""), out)


def _headed(finding: Finding, source: str) -> Text:
    return Text.assemble(
        (finding.law, "bold"), " ", (finding.verdict_text, _VERDICT_STYLES[finding.verdict]), source
    )


def _details(finding: Finding, report: Outcome, out: Console, *, debug: bool) -> None:
    out.print(_headed(finding, f"  {finding.source}" if finding.verdict is not Verdict.HOLDS else ""))
    _indented(finding.message + (f"\n{finding.traceback}" if debug else ""), out)
    if finding.verdict is not Verdict.HOLDS and (again := report.again(finding)):
        out.print(Text("  replay:", style="dim"))
        # One line, however long, so that it can be copied.
        out.print(Text(f"  {again}"), soft_wrap=True)
    out.print()


def _indented(message: str, out: Console) -> None:
    for line in message.splitlines():
        out.print(Text("  " + line), soft_wrap=not out.is_terminal)


def _number(value: float | None) -> str:
    if value is None:
        return ""
    return f"{value:.3g}" if 1e-3 <= abs(value) < 1e4 or not value else f"{value:.1e}"
