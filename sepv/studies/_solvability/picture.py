"""Picture of a map of solvability: solutions by state and Δ,
the probability of a Δ without solution, exits of paths.

Needs the extra ``plots``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from sepv.pictures import REFERENCE, Axis, content, figure, frame, line, looks, power
from sepv.schemes import Look
from sepv.studies._solvability.map import Ending, Map
from sepv.studies._solvability.paths import Exits

# Colours of Okabe and Ito, ordered from light to dark, so that they also differ in grey.
COLOURS = {
    Ending.FOUND: "#DDEEF8",
    Ending.MISSED: "#E69F00",
    Ending.ANOTHER: "#009E73",
    Ending.NONE: "#333333",
    Ending.UNKNOWN: "#CC79A7",
}
# The style of mean chances, and the style of worst chances and of the ends of branches.
MEAN_LOOK, WORST_LOOK = Look("#0072B2", "#56B4E9", "o"), Look("#D55E00", "#FF8A3D", "s", "4 2")


def draw(map_: Map, steps: Sequence[float], k: int | None, suffix: str, exits: Sequence[Exits] = ()) -> bytes:
    """The picture of a map as the content of a file; `suffix` is one of .svg, .png and .pdf."""
    panels = 3 if exits else 2
    with figure(10 if panels == 2 else 14, 4.4, layout="constrained") as drawn:
        left, right, *last = drawn.subplots(1, panels, width_ratios=(1.7, 1, 1)[:panels])
        _map(left, map_)
        _chances(right, map_, steps, k)
        if last:
            _exits(last[0], exits)
        drawn.suptitle(
            f"{map_.problem.name}, {map_.scheme.name}: solutions y1(Δ) connected to y0", fontsize=10
        )
        return content(drawn, suffix)


def _map(axes: Any, map_: Map) -> None:
    from matplotlib.colors import BoundaryNorm, ListedColormap
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    colours = ListedColormap([COLOURS[kind] for kind in Ending])
    edges = BoundaryNorm(np.arange(len(Ending) + 1) - 0.5, len(Ending))
    axes.pcolormesh(
        map_.delta, map_.theta, map_.findings.T, cmap=colours, norm=edges, shading="nearest", rasterized=True
    )
    for branch, sign in ((map_.forward, 1), (map_.backward, -1)):
        furthest = np.abs(map_.delta).max()
        reach = np.where(branch.reach < furthest, sign * branch.reach, np.nan)
        axes.plot(reach, map_.theta, color=WORST_LOOK.colour, lw=1.4)
    axes.axvline(0, color="#888888", lw=0.6)
    axes.set_xlabel("Δ")
    axes.set_ylabel("y0 = φ_θ(initial state), θ")
    present = [kind for kind, count in map_.counts().items() if count]
    handles: list[Any] = [
        Patch(facecolor=COLOURS[kind], edgecolor="#555555", label=kind.text) for kind in present
    ]
    if min(map_.forward.reach.min(), map_.backward.reach.min()) < np.abs(map_.delta).max():
        handles.append(Line2D([], [], color=WORST_LOOK.colour, lw=1.4, label="end of the branch"))
    axes.legend(handles=handles, loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=2, fontsize=8)


def _chances(axes: Any, map_: Map, steps: Sequence[float], k: int | None) -> None:
    mean, worst = [float(map_.chances(h, k).mean()) for h in steps], [map_.worst(h, k) for h in steps]
    chance = "P(Δ off the branch), exact orbit"
    c = ", ".join(f"{v:g}" for v in map_.problem.c)
    axes.set_title(f"c = {c or 'none'}; " + (f"truncated, k = {k}" if k else "untruncated"), fontsize=9)
    if max(worst) <= 0:
        axes.plot(steps, [0.0] * len(steps), **line(MEAN_LOOK))
        frame(axes, Axis("h", log=True), Axis(chance), x_base=2)
        axes.set_yticks([])
        axes.text(
            0.5,
            0.6,
            "0 for every h shown:\nevery branch reaches as far as the range",
            transform=axes.transAxes,
            ha="center",
        )
        return
    for values, look, label in (
        (mean, MEAN_LOOK, "mean over the states"),
        (worst, WORST_LOOK, "worst state"),
    ):
        shown = [(h, p) for h, p in zip(steps, values, strict=True) if p > 0]
        axes.plot(*zip(*shown, strict=True), **line(look), label=label)
    axes.set_xlim(min(steps) / 1.4, max(steps) * 1.4)
    frame(axes, Axis("h", log=True), Axis(chance, log=True), x_base=2)
    none = [h for h, p in zip(steps, worst, strict=True) if p <= 0]
    if none:
        words = f"0 for h ≤ {power(max(none), 2)}"
        axes.text(0.04, 0.05, words, transform=axes.transAxes)
    axes.legend(fontsize=8, loc="lower right")


def _exits(axes: Any, exits: Sequence[Exits]) -> None:
    """Draw the times at which steps were refused against h, with a triangle if no step was
    refused.
    """
    axes.set_title("exits of paths: first (circles), half of them (squares)", fontsize=9)
    for number, (name, look) in enumerate(looks(e.scheme for e in exits).items()):
        of_scheme = [e for e in exits if e.scheme == name]
        for what, marker, dash in (("first", "o", ""), ("median", "s", "4 2")):
            # An exit in the first step, at t = 0, is drawn at t = h, because the axis is
            # logarithmic.
            shown = [(e.h, max(t, e.h)) for e in of_scheme for t in [getattr(e, what)] if t is not None]
            if shown:
                axes.plot(*zip(*shown, strict=True), **line(replace(look, marker=marker, dash=dash)))
        none = [(e.h * 2 ** (0.08 * number), e.until) for e in of_scheme if not e.failed]
        if none:
            axes.plot(*zip(*none, strict=True), "^", color=look.colour, mfc="none")
        axes.plot([], [], **line(replace(look, marker="o", dash="")), label=name)
    axes.plot([], [], "^", color=REFERENCE.colour, mfc="none", label="none failed until there")
    frame(axes, Axis("h", log=True), Axis("t", log=True), x_base=2)
    axes.legend(fontsize=8, loc="lower left")
