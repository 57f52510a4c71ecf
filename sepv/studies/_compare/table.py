"""A comparison as a table on the terminal, and as CSV."""

from __future__ import annotations

import csv
import io
import math
import statistics
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from sepv.console import Table, columns, longest
from sepv.statistics import Estimate

if TYPE_CHECKING:
    from sepv.studies._compare.record import Compared, Point, TimeToError

# The error of clipping is noted if it is more than this fraction of the strong error (its square is
# about a tenth).
NOTED_CLIPPING_SHARE = 0.3
# The mark before a time to an error, for each value of `TimeToError.how`.
TIME_MARKS = {"between": "", "beyond": "~", "coarsest": "≤"}
# A driver is said to wait for something outside this process if its quotient of clock time to
# processor time is this many times the median of all drivers. On a busy machine, the quotient is
# larger for all drivers.
WAITS_FACTOR = 10.0

# The headings of the columns, with their least widths.
COLUMN_WIDTHS = {
    "steps": 6, "strong error": 12, "weak error": 11, "|ΔH|": 5, "|ΔC|": 5, "ns/step": 7, "±%": 3, "∇H": 4, "B": 4,
    "Newton": 6, "failed": 8,
}  # fmt: skip
# Columns that are dropped on a narrow terminal, in order.
COMPARISON_DROPPED = ("±%", "B", "∇H", "Newton", "|ΔC|", "ns/step", "weak error", "|ΔH|", "failed")


def heading(comparison: Compared) -> str:
    """The line above the tables of points: the problem, T, and the meaning of errors,
    defects and times.
    """
    rounds = comparison.repeats
    known = "without noise: errors"
    if not comparison.deterministic:
        known = f"errors with {comparison.confidence:.0%} intervals"
    return (
        f"{comparison.problem}, T = {comparison.T:g}: {known}, the largest "
        "defects; ns of processor time for a step of one path on one core, "
        + (
            f"median of {rounds} rounds ± half the distance of the quartiles"
            if rounds > 1
            else "of one round"
        )
    )


def point_tables(comparison: Compared) -> list[Table]:
    """One table for each method under its name, with a row for each step size;
    the tables' columns are aligned.
    """
    absent = {"failed"} if not any(p.failures for p in comparison.points) else set()
    absent |= {"±%"} if comparison.repeats == 1 else set()  # one time has no spread
    absent |= {"weak error"} if comparison.deterministic else set()  # equal to the strong error
    names = [name for name in COLUMN_WIDTHS if name not in absent]
    rows = {
        (p.method, p.steps): dict(zip(COLUMN_WIDTHS, _cells(comparison, p), strict=True))
        for p in comparison.points
    }
    least = {n: max(COLUMN_WIDTHS[n], longest(row[n] for row in rows.values())) for n in names}
    heads = tuple(replace(c, least=least[c.heading]) for c in columns((), names, goes=COMPARISON_DROPPED))
    return [
        Table(
            heads,
            [[rows[method, p.steps][name] for name in names] for p in comparison.of(method)],
            method,
            headed=number == 0,
        )
        for number, method in enumerate(comparison.sources)
    ]


def _cells(comparison: Compared, p: Point) -> list[str]:
    spread = 50 * (p.seconds.high - p.seconds.low) / p.seconds.median
    return [
        str(p.steps) if p.steps_matter else "none",
        _defect(p.strong.value, 1) if comparison.deterministic else _estimate(p.strong),
        _weak(p.weak),
        _defect(p.energy_defect),
        _defect(p.casimir_defect) if comparison.has_casimirs else "–",
        f"{p.nanoseconds:.3g}" if p.nanoseconds < 999 else f"{p.nanoseconds:.0f}",
        f"{spread:.0f}",
        _count(p.evaluations.get("gradient")),
        _count(p.evaluations.get("structure")),
        _count(p.iterations),
        f"{p.failures}/{p.paths}" if p.failures else "",
    ]


def target_tables(comparison: Compared) -> list[Table]:
    """A table of each method's time per path to reach each target as strong error,
    and of its energy defects then.

    Without noise, a second table has the times to reach each target as largest |H(y_n) − H(y_0)|.
    """
    tables = {"an error at T" if comparison.deterministic else "a strong error": comparison.times_to_error()}
    if comparison.deterministic:
        tables["|ΔH| up to T"] = comparison.times_to_energy_error()
    return [
        _target_table(comparison, times, f"µs a path to {target}, and |ΔH| there")
        for target, times in tables.items()
    ]


def _target_table(comparison: Compared, times: list[TimeToError], title: str) -> Table:
    targets = [f"{target:.0e}" for target in comparison.targets]
    by_target = {(t.method, t.error): t for t in times}
    rows = [
        (name, *(cell for target in comparison.targets for cell in _target_cells(by_target[name, target])))
        for name in comparison.sources
    ]
    numbers = [heading for target in targets for heading in (target, "|ΔH|")]
    heads = columns(["method"], numbers, goes=["|ΔH|", *targets[:0:-1]])
    return Table(heads, rows, title, ruled=True, edged=False)


def notes(comparison: Compared) -> list[str]:
    """Notes below the table: on marks, compilation, methods with fewer paths, clipping,
    failed paths, slow drivers.
    """
    lines = []
    ways = {t.how for t in comparison.times_to_error()}
    if "beyond" in ways:
        lines.append(
            "~ beyond the finest step, by the slope of the last two errors; |ΔH| is that of the finest step"
        )
    if "coarsest" in ways:
        lines.append("≤ already reached at the coarsest step")
    called = comparison.called_each_step
    loops = [n for n in comparison.sources if n not in called and comparison.of(n)[0].steps_matter]
    if called and loops:
        lines.append(
            f"{', '.join(called)}: called from Python once a step, where {', '.join(loops)} "
            f"{'is' if len(loops) == 1 else 'are'} one compiled loop. Their times compare Python with compiled code; "
            "numpy/SCHEME calls a scheme of sepv once a step too"
        )
    most = max(p.paths for p in comparison.points)
    busy = statistics.median(p.seconds.wall / p.seconds.median for p in comparison.points)
    for name in comparison.sources:
        points = comparison.of(name)
        first = sum(p.seconds.first for p in points)
        if first > 0.1 and first > 3 * sum(p.seconds.median for p in points):
            lines.append(f"{name}: {first:.2g} s of compilation, not in the times above")
        if points[0].paths < most:
            lines.append(f"{name}: goes path by path, {points[0].paths} paths instead of {most}")
        clipped = [p for p in points if p.clipping > NOTED_CLIPPING_SHARE * p.strong.value]
        if clipped:
            worst = max(clipped, key=lambda p: p.clipping / (p.strong.value or p.clipping))
            lines.append(
                f"{name}: truncated increments alone cost {worst.clipping:.1e} at {worst.steps} steps, which a sample "
                "of this size does not show: the strong error is larger by that, in squares"
            )
        if any(p.failures for p in points):
            lines.append(
                f"{name}: paths that failed count in no error and no defect; such steps reach no target"
            )
        if all(p.seconds.wall > WAITS_FACTOR * busy * p.seconds.median for p in points):
            lines.append(
                f"{name}: much slower by the clock than its processor time says: it waits for something"
            )
    return lines


def to_csv(comparison: Compared) -> str:
    """The points as CSV: one line for each method and step size,
    with an empty field for a missing number.
    """
    rows = [_csv_row(comparison.problem, p) for name in comparison.sources for p in comparison.of(name)]
    text = io.StringIO()
    writer = csv.DictWriter(text, rows[0], lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def _csv_row(problem: str, p: Point) -> dict[str, Any]:
    row: dict[str, Any] = {"problem": problem}
    row |= {name: getattr(p, name) for name in ("method", "h", "steps", "paths", "failures")}
    for kind, e in (("strong", p.strong), ("weak", p.weak)):
        row |= {f"{kind}_error": e.value, f"{kind}_low": max(e.low, 0.0), f"{kind}_high": e.high}
    row |= {"energy_defect": p.energy_defect, "casimir_defect": p.casimir_defect}
    row |= {f"seconds_{name}": value for name, value in vars(p.seconds).items()}
    row |= {"ns_per_step": p.nanoseconds}
    row |= {f"{kind}_per_step": p.evaluations.get(kind) for kind in ("gradient", "structure")}
    return row | {"iterations_per_step": p.iterations}


def _target_cells(t: TimeToError) -> tuple[str, str]:
    if t.microseconds is None or t.energy_defect is None:
        return "–", ""
    short = f"{t.microseconds:.3g}" if 1e-2 <= t.microseconds < 1e4 else f"{t.microseconds:.1e}"
    return f"{TIME_MARKS[t.how]}{short}", _defect(t.energy_defect)


def _estimate(e: Estimate) -> str:
    if not math.isfinite(e.value):
        return "∞"
    return f"{e.value:.1e}±{100 * e.half / e.value:.0f}%" if e.value else "0"


def _weak(e: Estimate) -> str:
    """A weak error as text: its value, or "≤" and its upper bound if its interval contains 0."""
    if not math.isfinite(e.value):
        return "∞"
    return _estimate(e) if e.value > e.half else f"≤ {e.high:.1e}"


def _defect(value: float, digits: int = 0) -> str:
    return f"{value:.{digits}e}" if math.isfinite(value) else "∞"


def _count(value: float | None) -> str:
    return "–" if value is None else f"{value:.3g}"
