"""Panels as pictures, SVG and PNG, one column of a journal wide. Needs the extra ``plots`` (matplotlib)."""

from __future__ import annotations

import math
from pathlib import Path

from sepv.studies._picture import content, draw_curves, figure, looks
from sepv.studies._reproduce.record import Panel

# 86 mm, a column; type of 8 points, none below 6.5.
WIDTH, HEIGHT = 3.39, 2.9
# Letters are drawn: a journal's page shows them as they are here.
_STYLE = {
    "svg.fonttype": "path",
    "font.size": 8,
    "xtick.labelsize": 7,
    "ytick.labelsize": 7,
    "legend.fontsize": 6.5,
    "lines.linewidth": 1.0,
    "grid.linewidth": 0.4,
}


def draw(panel: Panel, folder: Path) -> tuple[Path, Path]:
    """Write folder/KEY.svg and folder/KEY.png (300 dpi) and return both paths."""
    # Two columns of longer labels are wider than the figure; a legend of many rows makes it higher, not its axes lower.
    columns = 2 if max(len(s.name) for s in panel.series) <= 22 else 1
    more = max(0, math.ceil(len(panel.series) / columns) - 3)
    with figure(WIDTH, HEIGHT + 0.14 * more, _STYLE, layout="constrained") as drawn:
        draw_curves(
            drawn.add_subplot(),
            panel.series,
            looks(s.scheme for s in panel.series),
            panel.x,
            panel.y,
            slopes=panel.slopes,
            equal=panel.equal,
            window=panel.window,
        )
        drawn.legend(loc="outside upper center", ncols=columns, handlelength=2.6)
        paths = folder / f"{panel.key}.svg", folder / f"{panel.key}.png"
        for path in paths:
            path.write_bytes(content(drawn, path.suffix, title=panel.title, dpi=300))
    return paths
