"""Pictures for the page: SVG made by matplotlib, adapted to the page's style sheet and security
policy.

The policy forbids styles in elements, so properties become attributes. Colours become variables of
the style sheet, which has a light and a dark theme. Each marker and frame is defined once for all
pictures, with an identifier.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any
from xml.etree import ElementTree

from markupsafe import Markup

from sepv import pictures as drawing
from sepv.page._text import name
from sepv.pictures import GRID_COLOUR, GUIDE_COLOUR, SOFT_COLOUR, TEXT_COLOUR, Axis, Series
from sepv.schemes import Look

# The size of a drawing, its margins, and the size of a sample in its legend, in points (1/72 inch).
DRAWING_WIDTH, DRAWING_HEIGHT = 520, 330
LEFT_MARGIN, RIGHT_MARGIN, TOP_MARGIN, BOTTOM_MARGIN = 62, 14, 12, 44
# The space for the name of the vertical axis, left of its numbers, in points.
AXIS_NAME_SPACE = 30
SAMPLE = 34, 12
# The width at the right of a drawing for the names of reference slopes, in points.
SLOPE_NAMES_WIDTH = 50
# The largest number of points of a cloud or strips of a long line, and the tolerance for simplified
# lines in points.
CLOUD_MAX_POINTS, LINE_TOLERANCE = 110, 0.35
MARKER = 6.5
_DRAWING_STYLE = {
    "font.size": 12, "text.color": TEXT_COLOUR, "axes.labelcolor": TEXT_COLOUR, "axes.labelpad": 4, "axes.linewidth": 1,
    "xtick.color": TEXT_COLOUR, "ytick.color": TEXT_COLOUR, "xtick.major.pad": 5, "ytick.major.pad": 6,
    "lines.linewidth": 1.5,
    "grid.linewidth": 1, "path.simplify_threshold": LINE_TOLERANCE,
}  # fmt: skip
# Properties that are dropped from each element, because the style sheet or enclosing elements set
# them.
_DROPPED_PROPERTIES = re.compile("font|stroke-linejoin|stroke-linecap|stroke-dashoffset")


@dataclass(frozen=True)
class Picture:
    """A drawing as SVG elements without the tag `svg`; `samples` has pairs (name, piece of a curve)
    for its legend.
    """

    inside: Any
    samples: list[tuple[str, Any]]


class Pictures:
    """All pictures of one page."""

    def __init__(self, schemes: Iterable[str] = (), given: Mapping[str, Look] | None = None) -> None:
        self.looks = drawing.looks(["", *schemes], given)
        self._shared: dict[str, str] = {}  # identifiers by element
        self._colours: dict[str, str] = {}  # colours on light and on dark
        self._samples: dict[tuple[Look, str], Any] = {}

    @property
    def colours(self) -> list[tuple[str, str, str]]:
        """Rows (variable, colour on light, colour on dark) of the pictures' colours,
        for the style sheet.
        """
        return [(f"k{n}", light, dark) for n, (light, dark) in enumerate(self._colours.items())]

    @property
    def definitions(self) -> Any:
        """The SVG of markers and frames, which all drawings refer to; the page has it once,
        before the drawings.
        """
        # matplotlib and ElementTree have escaped this SVG, so that the template must not escape it
        # again.
        named = (re.sub("^<([a-zA-Z]+)", rf'<\1 id="{at}"', e) for e, at in self._shared.items())
        return Markup("".join(named))

    def draw(self, series: Sequence[Series], x: Axis, y: Axis, **more: Any) -> Picture:
        """Draw curves in a picture; `more` are further arguments of `sepv.pictures.draw_curves`."""
        drawing.require_matplotlib("a page of verdicts and counters alone needs none")
        with (
            drawing.figure(DRAWING_WIDTH / 72, DRAWING_HEIGHT / 72, _DRAWING_STYLE) as drawn,
            warnings.catch_warnings(),
        ):
            # If matplotlib's font lacks a sign, the reader's fonts draw it.
            warnings.filterwarnings("ignore", "Glyph .* missing from")
            right = SLOPE_NAMES_WIDTH if more.get("slopes") else RIGHT_MARGIN
            frame = (
                LEFT_MARGIN,
                BOTTOM_MARGIN,
                DRAWING_WIDTH - LEFT_MARGIN - right,
                DRAWING_HEIGHT - TOP_MARGIN - BOTTOM_MARGIN,
            )
            unit = (DRAWING_WIDTH, DRAWING_HEIGHT, DRAWING_WIDTH, DRAWING_HEIGHT)
            axes = drawn.add_axes(tuple(v / of for v, of in zip(frame, unit, strict=True)))
            drawing.draw_curves(axes, series, self.looks, x, y, size=MARKER, most=CLOUD_MAX_POINTS, **more)
            if not more.get("equal"):  # with equal axes the frame is narrower
                numbers = max(t.get_window_extent().width for t in axes.get_yticklabels()) * 72 / drawn.dpi
                left = max(LEFT_MARGIN, AXIS_NAME_SPACE + numbers)
                width = DRAWING_WIDTH - left - right
                axes.set_position(
                    (
                        left / DRAWING_WIDTH,
                        BOTTOM_MARGIN / DRAWING_HEIGHT,
                        width / DRAWING_WIDTH,
                        frame[3] / DRAWING_HEIGHT,
                    )
                )
                axes.yaxis.set_label_coords((14 - left) / width, 0.5)
            drawn.patch.set_visible(False)
            axes.patch.set_visible(False)
            used = drawing.looks_of(series, self.looks)
            inside = self._inside(drawn, used)
        samples = [(name(s.name), self._sample(look, s.style)) for s, look in zip(series, used, strict=True)]
        return Picture(inside, samples)

    def _sample(self, look: Look, style: str) -> Any:
        """Return the SVG of a short piece of a curve, for the legend."""
        if (look, style) not in self._samples:
            from matplotlib.lines import Line2D

            width, height = SAMPLE
            with drawing.figure(width / 72, height / 72, _DRAWING_STYLE) as drawn:
                drawn.patch.set_visible(False)
                across = (0.03, 0.5, 0.97)
                how = drawing.line(look, style, MARKER) | {
                    "markersize": MARKER,
                    "markeredgewidth": 0.2 * MARKER,
                }
                drawn.add_artist(Line2D(across, (0.5, 0.5, 0.5), **how, markevery=(1, 2)))
                self._samples[look, style] = self._inside(drawn, [look])
        return self._samples[look, style]

    def _inside(self, drawn: Any, used: Iterable[Look]) -> Any:
        """Return the SVG of a figure without its outermost tag, adapted to the page."""
        for look in used:
            self._colours.setdefault(look.colour, look.dark)
        root = ElementTree.fromstring(drawing.content(drawn, ".svg"))
        paint = {c.lower(): f"var(--{k})" for k, c, _ in self.colours}
        paint |= {
            GUIDE_COLOUR: "var(--guide)",
            GRID_COLOUR: "var(--grid)",
            SOFT_COLOUR: "var(--soft)",
            TEXT_COLOUR: "var(--fg)",
        }
        new: dict[str, str] = {}
        identifiers = [(element, _inert(element, paint)) for element in root.iter()]
        for element, old in identifiers:
            if element.tag in ("path", "clipPath") and old:
                if element.tag == "path":
                    element.set("fill", "none")
                text = ElementTree.tostring(element, encoding="unicode")
                new[old] = self._shared.setdefault(text, f"d{len(self._shared)}")
        for element in root.iter():
            if "href" in element.attrib:
                element.set("href", f"#{new[element.attrib['href'][1:]]}")
            if "clip-path" in element.attrib:
                element.set("clip-path", f"url(#{new[element.attrib['clip-path'][5:-1]]})")
        group = next(e for e in root if e.tag == "g")
        _flat(group)
        return Markup("".join(ElementTree.tostring(e, encoding="unicode") for e in group))


def _inert(element: ElementTree.Element, paint: Mapping[str, str]) -> str:
    """Adapt an element of matplotlib's SVG to the page, remove its identifier,
    and return the identifier.

    Names lose their namespaces, styles become attributes, colours become variables, and numbers get
    one decimal.
    """
    element.tag = element.tag.rpartition("}")[2]
    attributes = {key.rpartition("}")[2]: value for key, value in element.attrib.items()}
    for part in attributes.pop("style", "").split(";"):
        key, _, value = (v.strip() for v in part.partition(":"))
        if key and not _DROPPED_PROPERTIES.match(key):
            attributes[key] = paint.get(value.lower(), value)
    for key in ("d", "x", "y", "transform", "stroke-width"):
        if key in attributes:
            attributes[key] = re.sub(
                r"-?\d+\.\d+", lambda n: f"{float(n[0]):.1f}".removesuffix(".0"), attributes[key]
            )
    if "d" in attributes:
        attributes["d"] = re.sub(r"\s*([MLCQz])\s*", r"\1", attributes["d"]).strip()
    if attributes.get("fill") == "none":  # the style sheet sets it for every path
        del attributes["fill"]
    if attributes.get("transform", "").startswith("rotate(-0"):
        del attributes["transform"]
    identifier = attributes.pop("id", "")
    element.attrib = attributes
    element.text = element.text if element.tag == "text" else None
    element.tail = None
    return identifier


def _flat(element: ElementTree.Element) -> None:
    """Simplify what is below `element`: dissolve groups without attributes, drop definitions,
    which the page has.

    Markers keep only their place and reference, because their definition contains their look.
    """
    pieces: list[ElementTree.Element] = []
    for child in element:
        _flat(child)
        if child.tag == "use":
            child.attrib = {key: child.attrib[key] for key in ("href", "x", "y")}
        if child.tag == "g" and not child.attrib:
            pieces += list(child)
        elif child.tag != "defs":
            pieces.append(child)
    element[:] = pieces
