"""Pictures: looks of schemes, curves on axes, and a figure's content as a file.
Drawing needs the extra ``plots``.

The look of a scheme (colours, marker, dashes) is a field of the scheme. A scheme without a look
gets one that no other has in the picture. Colours are those of M. Okabe and K. Ito (2008), darker
on light paper, lighter on a dark screen.
"""

from __future__ import annotations

import io
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cache
from itertools import cycle
from pathlib import Path
from typing import Any, Literal

import numpy as np

from sepv._arguments import optional
from sepv.errors import UsageError
from sepv.schemes import Look

SUFFIXES = (".svg", ".png", ".pdf")
# Colours of lines that are not a scheme's: a reference, slopes, the grid.
REFERENCE = Look("#333333", "#DDDDDD", "", "1 2")
GUIDE_COLOUR, GRID_COLOUR, SOFT_COLOUR, TEXT_COLOUR = "#6e7781", "#e3e7eb", "#57606a", "#1b1f24"
# A defect of exactly zero has no logarithm, so it is drawn at half an ulp of 1.
DRAWN_ZERO = 1.1e-16
# Colours (light, dark) and markers for schemes without a look: 77 pairs, because 7 and 11 have no
# common divisor.
_COLOURS = (
    ("#A85C32", "#E8A77F"), ("#9A5BA8", "#D9A6E4"), ("#3D7F7A", "#7CC7C1"), ("#8A7A1F", "#CDBD5C"),
    ("#B04A5A", "#EE97A5"), ("#5F6B2F", "#AFBE78"), ("#56789A", "#9BB8D3"),
)  # fmt: skip
_MARKERS = ("v", "<", ">", "h", "p", "d", "P", "X", "s", "^", "x")
_DASHES = ("8 2 2 2", "", "4 2", "2 1")
# Dashes and markers of a scheme's second curve in one picture, and of its further curves.
_FURTHER_LOOKS = (("9 4", "x"), ("1 2", "|"), ("9 2 1 2", "_"))

# Line widths and font size for a picture beside text.
STYLE = {
    "font.size": 9,
    "axes.linewidth": 0.6,
    "axes.edgecolor": SOFT_COLOUR,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "grid.color": GRID_COLOUR,
    "grid.linewidth": 0.8,
    "axes.axisbelow": True,
    "lines.scale_dashes": False,
    "legend.frameon": False,
    # A name with a dollar sign is text, not a formula.
    "text.parse_math": False,
    # Text stays text in SVG, and pictures of equal numbers are equal files.
    "svg.fonttype": "none",
    "svg.hashsalt": "sepv",
}


@dataclass(frozen=True)
class Series:
    """One curve: y against x, with the scheme that made it ("" for a reference).
    A point with a None is not drawn.

    half : half the widths of the intervals of y, as many as y; empty for a curve without intervals
    group : curves of one group have one colour and marker, such as a measurement and its theory; by
        default the scheme
    """

    name: str
    x: Sequence[float | None]
    y: Sequence[float | None]
    scheme: str = ""
    style: Literal["line", "points", "both"] = "line"
    half: Sequence[float | None] = ()
    group: str = ""

    @property
    def look_key(self) -> str:
        """The key of the curve's look: its group, or its scheme if it has none."""
        return self.group or self.scheme


@dataclass(frozen=True)
class Axis:
    """An axis of a picture: its label with the unit, and True if its scale is logarithmic."""

    label: str
    log: bool = False


TIME_AXIS = Axis("time t")


def looks(names: Iterable[str], own_looks: Mapping[str, Look] | None = None) -> dict[str, Look]:
    """The look of each scheme in a picture: from `own_looks`, else from the scheme itself,
    else a generated one.

    Generated looks are assigned in the order of the names, so that the same names always look the
    same. Their markers differ from the markers of the other schemes.
    """
    given = dict(own_looks or {})
    stated = {n: given.get(n) or _of_record(n) if n else REFERENCE for n in dict.fromkeys(names)}
    taken = {look.marker for look in stated.values() if look}
    every = [_free(number) for number in range(len(_COLOURS) * len(_MARKERS))]
    free = cycle([look for look in every if look.marker not in taken] or every)
    return {name: look or next(free) for name, look in stated.items()}


def looks_of(series: Sequence[Series], look_of: Mapping[str, Look]) -> list[Look]:
    """The look of each curve: that of its group or scheme,
    with other dashes and markers from the second curve on.

    If some curves have a group or scheme, the curves without one all look alike. If no curve has
    one, all look different.
    """
    if not any(s.look_key for s in series):
        return [_free(n) for n in range(len(series))]
    used = []
    for number, s in enumerate(series):
        again = sum(s.look_key == other.look_key for other in series[:number]) if s.look_key else 0
        look = look_of[s.look_key]
        dash, marker = _FURTHER_LOOKS[(again - 1) % len(_FURTHER_LOOKS)]
        used.append(replace(look, dash=dash, marker=marker if look.marker else "") if again else look)
    return used


def _of_record(name: str) -> Look | None:
    from sepv.schemes import by_name

    try:
        return by_name(name).look
    except UsageError:
        return None


@cache
def _free(number: int) -> Look:
    colour, dark = _COLOURS[number % len(_COLOURS)]
    return Look(colour, dark, _MARKERS[number % len(_MARKERS)], _DASHES[number % len(_DASHES)])


def require_picture(path: str | None) -> None:
    """Raise UsageError, before any work, if a picture's file has a wrong suffix or matplotlib is
    not installed.
    """
    if path is None:
        return
    if Path(path).suffix.lower() not in SUFFIXES:
        raise UsageError(
            expected=f"a picture that ends in {', '.join(SUFFIXES)}", received=path, remedy="name it so"
        )
    require_matplotlib("tables, JSON and CSV need no extra")


def require_matplotlib(otherwise: str) -> None:
    """Raise UsageError if matplotlib is not installed;
    `otherwise` names what works without matplotlib.
    """
    optional("matplotlib", "matplotlib, for pictures", f"pip install 'sepv[plots]'; {otherwise}")


@contextmanager
def figure(width: float, height: float, style: Mapping[str, Any] | None = None, **more: Any) -> Iterator[Any]:
    """A matplotlib figure of a size in inches; `style` adds to the rc settings STYLE,
    `more` is passed to `Figure`.
    """
    import matplotlib as mpl

    settings = {**STYLE, **(style or {})}
    with mpl.rc_context(settings):
        drawn = _figure_class()(figsize=(width, height), **more)
        drawn.settings = settings
        yield drawn


@cache
def _figure_class() -> Any:
    """Matplotlib's `Figure` with its rc settings, which a notebook shows even if it has not loaded
    pyplot.
    """
    from matplotlib.figure import Figure

    class NotebookFigure(Figure):
        settings: Mapping[str, Any] = STYLE

        def _repr_png_(self) -> bytes:
            return content(self, ".png", dpi=110)

    return NotebookFigure


def content(drawn: Any, suffix: str, *, title: str | None = None, dpi: int = 160) -> bytes:
    """The content of a file with the figure `drawn`, without a date; `suffix` is one of
    `SUFFIXES`.
    """
    kind = suffix.lower().lstrip(".")
    nameless: dict[str, Any] = {{"svg": "Date", "pdf": "CreationDate", "png": "Software"}[kind]: None}
    import matplotlib as mpl

    out = io.BytesIO()
    with mpl.rc_context(drawn.settings):  # some are read when the file is written
        drawn.savefig(out, format=kind, dpi=dpi, metadata=nameless | ({"Title": title} if title else {}))
    return out.getvalue()


def line(look: Look, style: str = "both", size: float = 4) -> dict[str, Any]:
    """The arguments of matplotlib for a curve with the given look; markers are outlines."""
    dashes: Any = (0, tuple(float(v) for v in look.dash.split())) if look.dash else "-"
    return {
        "color": look.colour,
        "linestyle": "none" if style == "points" else dashes,
        "marker": look.marker or ("." if style != "line" else ""),
        "markersize": 0.6 * size if style == "points" else size,
        "markerfacecolor": "none",
        "markeredgewidth": 0.2 * size,
    }


def draw_curves(
    axes: Any,
    series: Sequence[Series],
    look_of: Mapping[str, Look],
    x: Axis,
    y: Axis,
    *,
    slopes: Sequence[float] = (),
    equal: bool = False,
    window: float | None = None,
    size: float = 4,
    most: int | None = None,
) -> None:
    """Draw curves with their axes, without points that are not finite or, on a logarithmic axis,
    not positive.

    slopes : the slopes of dashed lines below the curves; if any are given, the ticks of x are
        powers of two
    equal : True if both axes have the same scale
    window : if given, the frame shows |y| ≤ window only, and |x| ≤ window if `equal`
    size : the size of markers, in points
    most : the largest number of markers of a curve without a line; a long line has two points in
        each of `most` parts
    """
    points = [_finite(s, x.log, y.log) for s in series]
    for number, (s, look, (across, up, half)) in enumerate(
        zip(series, looks_of(series, look_of), points, strict=True)
    ):
        drawn = np.arange(len(across))
        if window and s.style == "points":
            drawn = drawn[(np.abs(up) <= window) & ((np.abs(across) <= window) | (not equal))]
        elif most and s.style == "line":
            drawn = _spikes(up, most)
        every = _marked(s.style, len(drawn), number, most)
        if s.half:
            draw_intervals(axes, across, up, half, look, log=y.log)
        axes.plot(
            across[drawn],
            up[drawn],
            **line(look, s.style, size),
            markevery=every,
            label=s.name,
            # The curve of the energy-preserving scheme is drawn above the others.
            zorder=3 if s.scheme == "energy-preserving" else 2,
        )
    _slopes(axes, points, slopes)
    frame(axes, x, y, x_base=2 if slopes else 10)
    if window:
        axes.set_ylim(-window, window)
        if equal:
            axes.set_xlim(-window, window)
    if equal:
        axes.set_aspect("equal", adjustable="box" if window else "datalim")


def panels(
    sides: Sequence[tuple[Sequence[Series], Axis, Axis]], look_of: Mapping[str, Look], title: str, suffix: str
) -> bytes:
    """The content of a file with a panel for each (curves, x, y) of `sides`,
    under one title and above one legend.
    """
    with figure(7.0 if len(sides) == 1 else 9.5, 4.4, layout="constrained") as drawn:
        for axes, (series, x, y) in zip(np.ravel(drawn.subplots(1, len(sides))), sides, strict=True):
            draw_curves(axes, series, look_of, x, y)
        drawn.suptitle(title)
        named = drawn.axes[0].get_legend_handles_labels()
        drawn.legend(*named, loc="outside lower center", ncols=2 * len(sides), fontsize=8)
        return content(drawn, suffix)


def frame(axes: Any, x: Axis, y: Axis, *, x_base: int = 10) -> None:
    """Draw labels, scales, ticks and the grid of both axes, after the curves."""
    _scale(axes, axes.xaxis, x, x_base)
    _scale(axes, axes.yaxis, y, 10)
    axes.grid(visible=True, which="major", clip_on=False)
    axes.tick_params(length=0)


def draw_intervals(axes: Any, x: Any, y: Any, half: Any, look: Look, *, log: bool) -> None:
    """Draw the intervals y ± half as bars, which end above 0 on a logarithmic axis."""
    below = np.minimum(half, 0.9 * y) if log else half
    axes.errorbar(x, y, yerr=[below, half], fmt="none", ecolor=look.colour, elinewidth=0.8, capsize=2)


def _finite(s: Series, x_log: bool, y_log: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The points (x, y) of a curve that can be drawn, with half the widths of their intervals,
    0 for none.

    Beyond 1e300 the limits of the axes would overflow.
    """
    x, y = np.array(s.x, dtype=float), np.array(s.y, dtype=float)
    half = np.nan_to_num(np.array(s.half or np.zeros(len(y)), dtype=float), posinf=0.0)
    finite = (np.abs(x) < 1e300) & (np.abs(y) < 1e300) & ((x > 0) | (not x_log)) & ((y > 0) | (not y_log))
    return x[finite], y[finite], half[finite]


def _marked(style: str, count: int, number: int, most: int | None) -> Any:
    """The `markevery` of matplotlib for curve `number`, which has `count` points.

    A line has a few markers; the next curve has them at other places. A cloud (markers without a
    line) has at most `most` points.
    """
    if style == "line":
        spacing = max(1, count // 8)
        return (number * spacing // 6, spacing)
    return max(1, math.ceil(count / most)) if most and style == "points" else 1


def _spikes(y: np.ndarray, strips: int) -> np.ndarray:
    """The indices of the drawn points of a long line: both ends,
    and the least and largest y of each of `strips` parts.

    This choice keeps spikes visible.
    """
    every = np.arange(len(y))
    if len(y) <= 2 * strips:
        return every
    indices = {0, len(y) - 1}
    for strip in np.array_split(every, strips):
        indices |= {int(strip[np.argmin(y[strip])]), int(strip[np.argmax(y[strip])])}
    return np.array(sorted(indices))


def _slopes(axes: Any, points: Sequence[tuple[np.ndarray, ...]], slopes: Sequence[float]) -> None:
    """Draw dashed lines of these slopes below the points; each starts at the least x,
    at half of the least y.
    """
    x, y = (np.concatenate([p[k] for p in points]) if points else np.empty(0) for k in (0, 1))
    if not len(x):
        return
    ends = np.array([x.min(), x.max()])
    for slope in slopes:
        drawn = 0.5 * y.min() * (ends / ends[0]) ** slope
        axes.plot(ends, drawn, color=GUIDE_COLOUR, linestyle=(0, (5, 4)), linewidth=0.8, zorder=1)
        axes.annotate(
            "slope ½" if slope == 0.5 else f"slope {slope:g}", (ends[1], drawn[1]),
            textcoords="offset points", xytext=(3, 0), ha="left", va="center", color=SOFT_COLOUR,
        )  # fmt: skip


def _scale(axes: Any, direction: Any, axis: Axis, base: int) -> None:
    """Set label, scale and ticks of one axis. Powers are plain text, which every reader can
    copy.
    """
    from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullLocator

    direction.set_label_text(axis.label)
    if not axis.log:
        direction.set_major_locator(MaxNLocator(6, steps=[1, 2, 5, 10]))
        return
    set_scale = axes.set_xscale if direction.axis_name == "x" else axes.set_yscale
    set_scale("log", base=base, nonpositive="mask")
    low, high = (math.log(v, base) for v in direction.get_view_interval())
    powers = base == 2 or math.floor(high) > math.ceil(low)
    between: Sequence[float] = (1.0, 2.0, 5.0) if high - low > 0.4 else tuple(0.5 * k for k in range(2, 20))
    direction.set_major_locator(LogLocator(base, subs=(1.0,) if powers else between, numticks=8))
    direction.set_major_formatter(FuncFormatter(lambda v, _: power(v, base) if powers else f"{v:.3g}"))
    direction.set_minor_locator(NullLocator())


def power(value: float, base: int) -> str:
    """The power of the base that is nearest to the value, with superscript digits, such as 2⁻³."""
    exponent = round(math.log(value, base))
    return f"{base}" + str(exponent).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
