"""Plots as numbers: ticks, paths and markers in the units of an SVG drawing; a template writes them down."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from sepv.page._text import name, number, power
from sepv.studies._palette import look

WIDTH, HEIGHT = 520, 330
LEFT, RIGHT, TOP, BOTTOM = 62, 14, 12, 44
# Points drawn of a long line: the least and the largest in each of so many strips.
STRIPS = 110
CLOUD = 110


@dataclass(frozen=True)
class Curve:
    """What is to be drawn: y against x (None where there is nothing), and how."""

    name: str
    x: Sequence[float | None]
    y: Sequence[float | None]
    scheme: str = ""
    style: str = "line"


@dataclass(frozen=True)
class Drawn:
    """A curve in the units of the drawing; `colour` numbers a class of the style sheet."""

    name: str
    colour: str
    dash: str
    path: str
    markers: str


@dataclass(frozen=True)
class Plot:
    """Everything that the template writes down."""

    x_label: str
    y_label: str
    x_ticks: list[tuple[float, str]]
    y_ticks: list[tuple[float, str]]
    curves: list[Drawn]
    guides: list[tuple[str, str, float, float]]
    keys: list[Drawn]

    width: int = WIDTH
    height: int = HEIGHT
    left: int = LEFT
    right: int = WIDTH - RIGHT
    top: int = TOP
    bottom: int = HEIGHT - BOTTOM


class _Scale:
    """Values to one direction of the drawing."""

    def __init__(self, values: list[float], low: float, high: float, *, log: bool, base: int = 10) -> None:
        self.log, self.base = log, base
        forward = [math.log(v, base) for v in values] if log else values
        least, largest = (min(forward), max(forward)) if forward else (0.0, 1.0)
        room = 0.04 * (largest - least) or 0.5
        self.least, self.largest = least - room, largest + room
        self.low, self.high = low, high

    def __call__(self, value: float) -> float:
        v = math.log(value, self.base) if self.log else value
        return self.low + (v - self.least) / (self.largest - self.least) * (self.high - self.low)

    def ticks(self) -> list[tuple[float, str]]:
        if self.log:
            whole = range(math.ceil(self.least - 1e-9), math.floor(self.largest + 1e-9) + 1)
            step = max(1, math.ceil(len(whole) / 7))
            found = [(float(self.base) ** k, power(self.base, k)) for k in whole if k % step == 0]
            if len(found) >= 2:
                return [(self(v), text) for v, text in found]
            found = [(m * 10.0**k, number(m * 10.0**k)) for k in range(-30, 31) for m in range(1, 10)]
            found = [(v, t) for v, t in found if self.least <= math.log(v, self.base) <= self.largest]
            return [(self(v), t) for v, t in found[:: max(1, math.ceil(len(found) / 7))]]
        raw = (self.largest - self.least) / 5
        size = 10.0 ** math.floor(math.log10(raw))
        step_ = next(m * size for m in (1, 2, 5, 10) if m * size >= raw)
        first, last = math.ceil(self.least / step_), math.floor(self.largest / step_)
        digits = max(0, -math.floor(math.log10(step_) + 1e-9))
        return [
            (self(k * step_), f"{k * step_:.{digits}f}".replace("-", "−")) for k in range(first, last + 1)
        ]


def plot(
    curves: Sequence[Curve],
    *,
    x_label: str,
    y_label: str,
    x_log: bool = False,
    y_log: bool = False,
    x_base: int = 10,
    slopes: Sequence[float] = (),
    equal: bool = False,
    window: float | None = None,
) -> Plot:
    """Lay out curves; points that are null, or not positive on a logarithmic axis, are left out.

    With a window only |y| up to it is in the frame, and |x| too if both directions have one scale; the
    template cuts off what leaves it.
    """
    points = [_finite(c, x_log, y_log) for c in curves]
    if window and equal:
        points = [[p for p in own if max(map(abs, p)) <= window] for own in points]
    xs, ys = [x for p in points for x, _ in p], [y for p in points for _, y in p]
    guides = _guides(xs, ys, slopes) if slopes and xs else []
    ys = ys + [y for g in guides for _, y in g[1]]
    across = _Scale(xs, LEFT, WIDTH - RIGHT, log=x_log, base=x_base)
    if window:
        ys = [-window, window]
    up = _Scale(ys, HEIGHT - BOTTOM, TOP, log=y_log)
    if equal:
        _same_unit(across, up)
    return Plot(
        x_label=x_label,
        y_label=y_label,
        x_ticks=across.ticks(),
        y_ticks=up.ticks(),
        # What stays must not vanish behind what runs away.
        curves=[
            _draw(c, p, n, across, up)
            for n, (c, p) in sorted(
                enumerate(zip(curves, points, strict=True)),
                key=lambda k: k[1][0].scheme == "energy-preserving",
            )
        ],
        guides=[
            (text, _path([(across(x), up(y)) for x, y in line]), across(line[-1][0]), up(line[-1][1]))
            for text, line in guides
        ],
        keys=[_key(c, n) for n, c in enumerate(curves)],
    )


def _finite(c: Curve, x_log: bool, y_log: bool) -> list[tuple[float, float]]:
    kept = []
    for x, y in zip(c.x, c.y, strict=True):
        if x is None or y is None or not (math.isfinite(x) and math.isfinite(y)):
            continue
        if (x_log and x <= 0) or (y_log and y <= 0):
            continue
        kept.append((float(x), float(y)))
    return kept


def _guides(
    xs: list[float], ys: list[float], slopes: Sequence[float]
) -> list[tuple[str, list[tuple[float, float]]]]:
    """Lines of given slopes through one point below the lowest curve at the finest step."""
    low, high, anchor = min(xs), max(xs), 0.5 * min(ys)
    return [
        ("slope ½" if s == 0.5 else f"slope {s:g}", [(low, anchor), (high, anchor * (high / low) ** s)])
        for s in slopes
    ]


def _same_unit(across: _Scale, up: _Scale) -> None:
    """Widen the direction that has room, so that circles are circles."""
    unit = max(
        (across.largest - across.least) / abs(across.high - across.low),
        (up.largest - up.least) / abs(up.high - up.low),
    )
    for scale in (across, up):
        middle, half = (scale.least + scale.largest) / 2, unit * abs(scale.high - scale.low) / 2
        scale.least, scale.largest = middle - half, middle + half


def _draw(c: Curve, points: list[tuple[float, float]], n: int, across: _Scale, up: _Scale) -> Drawn:
    shape = look(c.scheme, n)
    placed = [(across(x), up(y)) for x, y in points]
    if c.style == "points":
        marked = placed[:: max(1, math.ceil(len(placed) / CLOUD))]
    elif c.style == "both":
        marked = placed
    else:
        spacing = max(1, len(placed) // 7)
        marked = placed[n * spacing // 6 :: spacing] if shape.marker else []
    marked = [(x, y) for x, y in marked if TOP <= y <= HEIGHT - BOTTOM]
    # What a window cuts off is not followed far beyond it: coordinates stay short.
    placed = [(x, min(max(y, -HEIGHT), 2 * HEIGHT)) for x, y in placed]
    path = "" if c.style == "points" else _path(_thinned(placed))
    size = 2.0 if c.style == "points" else 3.6
    markers = "".join(_marker(shape.marker or ".", x, y, size) for x, y in marked)
    return Drawn(name(c.name), colour_class(c.scheme, n), shape.dash, path, markers)


def _key(c: Curve, n: int) -> Drawn:
    """A curve's sample in the legend, 34 by 12."""
    shape = look(c.scheme, n)
    marker = _marker(shape.marker, 17, 6, 3.6) if shape.marker else ""
    return Drawn(
        name(c.name), colour_class(c.scheme, n), shape.dash, "" if c.style == "points" else "M1 6H33", marker
    )


def colour_class(scheme: str, n: int) -> str:
    """The class of the style sheet that carries the colour: a number, never a name of a stranger."""
    colours = sorted({look(s, k).colour for s, k in _EVERY})
    return f"k{colours.index(look(scheme, n).colour)}"


_EVERY = [("", 0), *(("?", k) for k in range(12))]


def colour_rules() -> list[tuple[str, str, str]]:
    """(class, colour on light, colour on dark) for the style sheet."""
    looks = {look(s, k).colour: look(s, k).dark for s, k in _EVERY}
    return [(f"k{n}", colour, looks[colour]) for n, colour in enumerate(sorted(looks))]


def _thinned(points: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """At most two points a strip, its least and its largest: spikes stay."""
    if len(points) <= 2 * STRIPS:
        return points
    size = math.ceil(len(points) / STRIPS)
    kept = [points[0]]
    for start in range(0, len(points), size):
        strip = points[start : start + size]
        kept += sorted({min(strip, key=lambda p: p[1]), max(strip, key=lambda p: p[1])}, key=strip.index)
    return [*kept, points[-1]]


def _path(points: list[tuple[float, float]]) -> str:
    return "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in points) if points else ""


def _marker(kind: str, x: float, y: float, r: float) -> str:
    """An outline of radius about r around (x, y), as a piece of a path."""
    q, w = 0.8 * r, 1.2 * r
    cross = f"m-{r:g} 0h{2 * r:g}m-{r:g} -{r:g}v{2 * r:g}"
    shapes = {
        "s": f"m-{r:g} -{r:g}h{2 * r:g}v{2 * r:g}h-{2 * r:g}z",
        "D": f"m0 -{w:g}l{w:g} {w:g}l-{w:g} {w:g}l-{w:g} -{w:g}z",
        "^": f"m0 -{w:g}l{w:g} {2 * r:g}h-{2 * w:g}z",
        "v": f"m0 {w:g}l{w:g} -{2 * r:g}h-{2 * w:g}z",
        "+": cross,
        "x": f"m-{q:g} -{q:g}l{2 * q:g} {2 * q:g}m0 -{2 * q:g}l-{2 * q:g} {2 * q:g}",
        # The cross ends below the centre: from there to the corner of the diagonals.
        "*": f"{cross}m-{q:g} -{r + q:g}l{2 * q:g} {2 * q:g}m0 -{2 * q:g}l-{2 * q:g} {2 * q:g}",
    }
    circle = f"m-{r:g} 0a{r:g} {r:g} 0 1 0 {2 * r:g} 0a{r:g} {r:g} 0 1 0 -{2 * r:g} 0"
    return f"M{x:.1f} {y:.1f}" + shapes.get(kind, circle)
