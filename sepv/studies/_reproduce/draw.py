"""Panels as pictures, SVG and PNG, one column of a journal wide. Needs the extra ``plots`` (matplotlib)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from sepv.errors import UsageError
from sepv.studies._palette import Look, look
from sepv.studies._reproduce.record import Panel, Series

# 86 mm, a column; type of 8 points, none below 6.5.
WIDTH, HEIGHT = 3.39, 2.9
_STYLE = {
    "font.size": 8,
    "axes.labelsize": 8,
    "xtick.labelsize": 7,
    "ytick.labelsize": 7,
    "legend.fontsize": 6.5,
    "axes.linewidth": 0.6,
    "lines.linewidth": 1.0,
    "lines.markersize": 4,
    "axes.spines.top": False,
    "axes.spines.right": False,
    # The same file for the same numbers: no date, no random identifiers.
    "svg.hashsalt": "sepv",
}


def require_matplotlib() -> None:
    """
    Raises
    ------
    UsageError
        Where matplotlib is not installed.
    """
    try:
        import matplotlib  # noqa: F401
    except ImportError:
        raise UsageError(
            expected="matplotlib, to draw figures",
            received="no module matplotlib",
            remedy="pip install matplotlib, or --no-figures: numbers and verdicts need none",
        ) from None


def draw(panel: Panel, folder: Path) -> tuple[Path, Path]:
    """Write folder/KEY.svg and folder/KEY.png (300 dpi) and return both paths."""
    import matplotlib as mpl
    from matplotlib.figure import Figure

    with mpl.rc_context(_STYLE):
        figure = Figure(figsize=(WIDTH, HEIGHT), layout="constrained")
        axes = figure.add_subplot()
        for number, s in enumerate(panel.series):
            _curve(axes, s, look(s.scheme, number), number)
        if panel.x.log:
            axes.set_xscale("log", base=2)
        if panel.y.log:
            axes.set_yscale("log")
        _slopes(axes, panel)
        if panel.window:
            axes.set_ylim(-panel.window, panel.window)
        if panel.equal:
            axes.set_aspect("equal", adjustable="box" if panel.window else "datalim")
        if panel.window and panel.equal:
            axes.set_xlim(-panel.window, panel.window)
        axes.set_xlabel(panel.x.label)
        axes.set_ylabel(panel.y.label)
        # Two columns of longer labels are wider than the figure.
        columns = 2 if max(len(s.name) for s in panel.series) <= 22 else 1
        figure.legend(loc="outside upper center", ncols=columns, frameon=False, handlelength=2.6)
        paths = folder / f"{panel.key}.svg", folder / f"{panel.key}.png"
        figure.savefig(paths[0], metadata={"Date": None, "Title": panel.title})
        figure.savefig(paths[1], dpi=300, metadata={"Title": panel.title, "Software": None})
    return paths


def _curve(axes: Any, s: Series, shape: Look, number: int) -> None:
    line = "none" if s.style == "points" else _dashes(shape.dash)
    marker = shape.marker if s.scheme else ""
    if (
        not s.scheme and s.style == "both"
    ):  # a second curve of the same scheme, such as another reference's view
        marker = "."
    every: Any = None
    if s.style == "line" and marker:
        # A few markers on a line, staggered so that curves on top of each other stay visible.
        spacing = max(1, len(s.x) // 8)
        every = (number * spacing // 6, spacing)
    axes.plot(
        s.x,
        s.y,
        linestyle=line,
        color=shape.colour,
        marker=marker,
        markevery=every,
        markerfacecolor="none",
        markeredgewidth=0.8,
        markersize=2.5 if s.style == "points" else 4,
        label=s.name,
        # What stays must not vanish behind what runs away.
        zorder=3 if s.scheme == "energy-preserving" else 2,
    )


def _dashes(pattern: str) -> Any:
    return (0, tuple(float(v) for v in pattern.split())) if pattern else "-"


def _slopes(axes: Any, panel: Panel) -> None:
    """Dashed reference lines below the curves, labelled."""
    if not panel.slopes:
        return
    x = np.array(sorted({v for s in panel.series for v in s.x}))
    # Through one point below the lowest curve at the finest step: neither line then crosses a curve of order one.
    anchor = 0.5 * min(v for s in panel.series for v in s.y if v > 0)
    for slope in panel.slopes:
        y = anchor * (x / x[0]) ** slope
        axes.plot(x, y, color="#777777", linestyle=(0, (4, 3)), linewidth=0.8)
        axes.annotate(
            "slope 1/2" if slope == 0.5 else f"slope {slope:g}",
            (x[-1], y[-1]),
            textcoords="offset points",
            xytext=(0, -4),
            ha="right",
            va="top",
            fontsize=6.5,
            color="#555555",
        )
