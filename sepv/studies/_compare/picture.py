"""The picture of a comparison: work-precision on the left, invariants against time on the right.

Needs the extra ``plots``.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from sepv.pictures import DRAWN_ZERO, Axis, draw_intervals, figure, frame, line, looks
from sepv.schemes import Look

if TYPE_CHECKING:
    from sepv.studies._compare.record import Compared, Point

# The size of markers, in points.
MARKER_SIZE = 5


def comparison_figure(comparison: Compared) -> Any:
    """The picture of a comparison as a figure of matplotlib."""
    rows = math.ceil(len(comparison.sources) / 4)
    look_of = looks(comparison.sources, comparison.looks)
    with figure(9.5, 4.2 + 0.22 * rows, layout="constrained") as drawn:
        error, defect = drawn.subplots(1, 2)
        for name in comparison.sources:
            _error_curve(error, comparison.of(name), look_of[name])
            drawn_defects = [p for p in comparison.of(name) if math.isfinite(p.energy_defect)]
            pairs = [(p.microseconds_a_path, max(p.energy_defect, DRAWN_ZERO)) for p in drawn_defects]
            _curve(defect, pairs, drawn_defects, look_of[name])
        time = Axis("processor time of one path [µs]", log=True)
        frame(error, time, Axis("strong error at T", log=True))
        frame(defect, time, Axis("largest |H(yₙ) − H(y₀)|", log=True))
        drawn.suptitle(f"{comparison.problem}, T = {comparison.T:g}")
        handles = [error.plot([], [], **_filled(look_of[name]))[0] for name in comparison.sources]
        drawn.legend(handles, list(comparison.sources), loc="outside lower center", ncols=4, fontsize=8)
        return drawn


def _error_curve(axes: Any, points: list[Point], look: Look) -> None:
    """Draw the strong error with its interval against time, without errors that are 0 or
    infinite.
    """
    drawn = [p for p in points if 0 < p.strong.value < math.inf]
    pairs = [(p.microseconds_a_path, p.error) for p in drawn]
    x, y = np.array([x for x, _ in pairs]), np.array([y for _, y in pairs])
    draw_intervals(axes, x, y, np.array([p.strong.half for p in drawn]), look, log=True)
    _curve(axes, pairs, drawn, look)


def _curve(axes: Any, pairs: list[tuple[float, float]], points: list[Point], look: Look) -> None:
    """Draw a curve; a marker is filled if every path was finished at this step size,
    and hollow if some failed.
    """
    axes.plot([x for x, _ in pairs], [y for _, y in pairs], **line(look, size=MARKER_SIZE))
    whole = [xy for xy, p in zip(pairs, points, strict=True) if not p.failures]
    axes.plot([x for x, _ in whole], [y for _, y in whole], **_filled(look) | {"linestyle": "none"})


def _filled(look: Look) -> dict[str, Any]:
    return line(look, size=MARKER_SIZE) | {"markerfacecolor": look.colour}
