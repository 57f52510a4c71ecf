"""A report for GitHub Actions: a summary in Markdown, and an annotation for each finding that makes
a run fail.

All text of a scheme is escaped, so that it cannot act as markup, as a row of a table or as a
command of the runner.
"""

from __future__ import annotations

import inspect
from html import escape
from pathlib import Path
from typing import Any

from sepv.console import markdown, printable
from sepv.law import Verdict, same_error
from sepv.verification._report import law_table, summary
from sepv.verification._shown import Report

# The most characters of a message, because a summary may have 1 MiB.
MESSAGE_MAX_CHARACTERS = 4000


def step_summary(report: Report) -> str:
    """The table of the laws, the last line, and each violation with its replay, as Markdown."""
    table = law_table(report)
    rows = [[_cell(cell if isinstance(cell, str) else cell.plain) for cell in row] for row in table.rows]
    red = bool(report.exit_code)
    parts = [
        f"### {'❌' if red else '✅'} sepv: {_cell(report.scheme.name)}",
        _cell(summary(report).plain),
        markdown([c.heading for c in table.columns], rows),
    ]
    shown = [f for f in report.findings if f.verdict in (Verdict.VIOLATED, Verdict.ERROR) and not f.waived]
    for f in _told(report, sorted(shown, key=lambda f: f not in report.failing)):
        again = f"\nreplay: {report.again(f)}" if report.again(f) else ""
        text = escape(printable(_short(f.message) + again))
        parts.append(f"<details><summary>{_cell(f.words)}</summary><pre>{text}</pre></details>")
    parts += [_cell(f.words) for f in report.findings if f.waived]
    return "\n\n".join(parts) + "\n\n"


def error_lines(report: Report) -> list[str]:
    """GitHub commands that show an error for each finding that fails,
    at the scheme's source line if it is known.
    """
    red = [f for f in report.findings if f in report.failing or f.verdict is Verdict.ERROR]
    place = _place(report.scheme.step)
    lines = [
        _command(
            "error",
            f"{f.words}\n{_short(f.message)}\n{report.again(f)}".rstrip(),
            **place,
            title=f"sepv: {f.law}",
        )
        for f in _told(report, red)
    ]
    lines += [_command("error", f"required and not found: {why}", title="sepv") for why in report.missing]
    return lines + [_command("warning", gap, title="sepv") for gap in report.gaps]


def _told(report: Report, findings: list[Any]) -> list[Any]:
    """The `findings` without those whose error an earlier finding of the report already has."""
    errors = {same_error(f.message): f for f in reversed(report.findings) if f.verdict is Verdict.ERROR}
    return [f for f in findings if f.verdict is not Verdict.ERROR or errors[same_error(f.message)] is f]


def _place(step: Any) -> dict[str, str]:
    """File and line of a function below the working folder, as the runner names them;
    empty for other steps.
    """
    try:
        function = inspect.unwrap(step)
        file = Path(inspect.getsourcefile(function) or "").resolve().relative_to(Path.cwd())
        return {"file": file.as_posix(), "line": str(inspect.getsourcelines(function)[1])}
    except (TypeError, ValueError, OSError):
        return {}


def _command(kind: str, text: str, **properties: str) -> str:
    named = ",".join(f"{key}={_data(value, {':': '%3A', ',': '%2C'})}" for key, value in properties.items())
    return f"::{kind} {named}::{_data(text, {})}"


def _data(text: str, more: dict[str, str]) -> str:
    table = {"%": "%25", "\r": "%0D", "\n": "%0A"} | more
    return "".join(table.get(c, c) for c in printable(text, "\n\r"))


def _cell(text: str) -> str:
    """Escape a text for a table of Markdown: one line that contains no markup."""
    return "".join(
        f"&#{ord(c)};" if c in "&<>|`*_[]#~!\\$@:" else c for c in " ".join(printable(text).split())
    )


def _short(text: str) -> str:
    return text if len(text) <= MESSAGE_MAX_CHARACTERS else f"{text[:MESSAGE_MAX_CHARACTERS]}…"
