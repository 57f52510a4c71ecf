"""The picture of a comparison: work-precision on the left, invariants against time on the right.

Colours are those of Okabe and Ito, which differ for every kind of colour vision; markers and dashes differ too, so
that the picture survives a black-and-white printer. Needs the extra ``plots``.
"""

from __future__ import annotations

import io
import math
from pathlib import Path
from typing import Any

from sepv.errors import UsageError
from sepv.studies._compare.record import Comparison, Point

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "<", ">", "*", "h")
DASHES = ("-", "--", "-.", ":")
SUFFIXES = (".svg", ".png", ".pdf")
# A defect of exactly zero has no logarithm: it is drawn at half a rounding of one.
FLOOR = 1.1e-16


def require_picture(path: str | None) -> None:
    """Complain about a missing library or a wrong suffix before the work, not after.

    Raises
    ------
    UsageError
    """
    if path is None:
        return
    if Path(path).suffix.lower() not in SUFFIXES:
        raise UsageError(
            expected=f"a picture that ends in {', '.join(SUFFIXES)}", received=path, remedy="name it so"
        )
    try:
        import matplotlib  # noqa: F401
    except ModuleNotFoundError as error:
        raise UsageError(
            expected="matplotlib, for pictures",
            received=str(error),
            remedy="pip install matplotlib; tables, JSON and CSV need no extra",
        ) from error


def draw(comparison: Comparison, suffix: str) -> bytes:
    """The picture as a file's content; `suffix` is one of .svg, .png and .pdf."""
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    # Text stays text in SVG, and equal comparisons give equal files.
    with rc_context({"svg.fonttype": "none", "svg.hashsalt": "sepv", "font.size": 9}):
        rows = math.ceil(len(comparison.sources) / 4)
        figure = Figure(figsize=(9.5, 4.2 + 0.22 * rows), layout="constrained")
        error, defect = figure.subplots(1, 2)
        for n, name in enumerate(comparison.sources):
            style = _style(n)
            _error_curve(error, comparison.of(name), name, style)
            _defect_curve(defect, comparison.of(name), style)
        error.set_ylabel("strong error at T")
        defect.set_ylabel("largest |H(yₙ) − H(y₀)|")
        for axes in (error, defect):
            axes.set_xscale("log")
            axes.set_yscale("log")
            axes.set_xlabel("processor time of one path [µs]")
            axes.grid(True, which="major", linewidth=0.4, alpha=0.5)
            for side in ("top", "right"):
                axes.spines[side].set_visible(False)
        figure.suptitle(f"{comparison.problem}, T = {comparison.T:g}")
        figure.legend(loc="outside lower center", ncols=4, frameon=False, fontsize=8)
        content = io.BytesIO()
        kind = suffix.lower().lstrip(".")
        metadata: dict[str, Any] = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}.get(kind, {})
        figure.savefig(content, format=kind, dpi=160, metadata=metadata)
        return content.getvalue()


def _style(n: int) -> dict[str, Any]:
    return {
        "color": COLOURS[n % len(COLOURS)],
        "marker": MARKERS[n % len(MARKERS)],
        "linestyle": DASHES[n // len(COLOURS) % len(DASHES)],
        "markersize": 5,
        "linewidth": 1.2,
    }


def _error_curve(axes: Any, points: list[Point], name: str, style: dict[str, Any]) -> None:
    """Error with its interval; step sizes at which paths failed are hollow."""
    drawn = [p for p in points if 0 < p.strong.value < math.inf]
    x, y = [p.microseconds_a_path for p in drawn], [p.error for p in drawn]
    axes.plot(x, y, label=name, **style)
    low = [min(p.strong.half, 0.9 * p.strong.value) for p in drawn]
    axes.errorbar(
        x, y, yerr=[low, [p.strong.half for p in drawn]], fmt="none", ecolor=style["color"], elinewidth=0.8
    )
    _hollow(axes, [(p.microseconds_a_path, p.error) for p in drawn if p.failures], style)


def _defect_curve(axes: Any, points: list[Point], style: dict[str, Any]) -> None:
    drawn = [p for p in points if math.isfinite(p.energy_defect)]
    pairs = [(p.microseconds_a_path, max(p.energy_defect, FLOOR)) for p in drawn]
    axes.plot([x for x, _ in pairs], [y for _, y in pairs], **style)
    _hollow(axes, [xy for xy, p in zip(pairs, drawn, strict=True) if p.failures], style)


def _hollow(axes: Any, pairs: list[tuple[float, float]], style: dict[str, Any]) -> None:
    plain = {**style, "linestyle": "none", "markerfacecolor": "white", "zorder": 3}
    axes.plot([x for x, _ in pairs], [y for _, y in pairs], **plain)
