"""The map as a picture: what exists at each state and Δ, the chance that a step leaves it, and when paths did.

Needs the extra ``plots``.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any

import numpy as np

from sepv.studies._solvability.map import Ending, Map
from sepv.studies._solvability.paths import Exits

# Okabe and Ito, ordered from light to dark, so that they differ without colour too.
COLOURS = {
    Ending.FOUND: "#DDEEF8",
    Ending.MISSED: "#E69F00",
    Ending.ANOTHER: "#009E73",
    Ending.NONE: "#333333",
    Ending.UNKNOWN: "#CC79A7",
}
_STYLE = {"font.size": 9, "svg.fonttype": "none", "svg.hashsalt": "sepv"}


def draw(map_: Map, steps: Sequence[float], k: int | None, suffix: str, exits: Sequence[Exits] = ()) -> bytes:
    """The picture as a file's content; `suffix` is one of .svg, .png and .pdf."""
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    with rc_context(_STYLE):
        panels = 3 if exits else 2
        figure = Figure(figsize=(10 if panels == 2 else 14, 4.4), layout="constrained")
        left, right, *last = figure.subplots(1, panels, width_ratios=(1.7, 1, 1)[:panels])
        _map(left, map_)
        _chances(right, map_, steps, k)
        if last:
            _exits(last[0], exits)
        figure.suptitle(
            f"{map_.problem.name}, {map_.scheme.name}: solutions y1(Δ) connected to y0", fontsize=10
        )
        out = io.BytesIO()
        metadata = {"Date": None} if suffix == ".svg" else {"CreationDate": None} if suffix == ".pdf" else {}
        figure.savefig(out, format=suffix[1:], dpi=160, metadata=metadata)
    return out.getvalue()


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
        axes.plot(reach, map_.theta, color="#D55E00", lw=1.4)
    axes.axvline(0, color="#888888", lw=0.6)
    axes.set_xlabel("Δ")
    axes.set_ylabel("y0 = φ_θ(initial state), θ")
    present = [kind for kind, count in map_.counts().items() if count]
    handles: list[Any] = [
        Patch(facecolor=COLOURS[kind], edgecolor="#555555", label=kind.text) for kind in present
    ]
    if min(map_.forward.reach.min(), map_.backward.reach.min()) < np.abs(map_.delta).max():
        handles.append(Line2D([], [], color="#D55E00", lw=1.4, label="end of the branch"))
    axes.legend(
        handles=handles, loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=2, frameon=False, fontsize=8
    )


def _chances(axes: Any, map_: Map, steps: Sequence[float], k: int | None) -> None:
    mean, worst = [float(map_.chances(h, k).mean()) for h in steps], [map_.worst(h, k) for h in steps]
    axes.set_xscale("log", base=2)
    axes.set_xlabel("h")
    axes.set_ylabel("P(Δ off the branch), exact orbit")
    c = ", ".join(f"{v:g}" for v in map_.problem.c)
    axes.set_title(f"c = {c or 'none'}; " + (f"truncated, k = {k}" if k else "untruncated"), fontsize=9)
    if max(worst) <= 0:
        axes.set_yticks([])
        axes.plot(steps, [0.0] * len(steps), "o-", color="#0072B2")
        axes.text(
            0.5,
            0.6,
            "0 for every h shown:\nevery branch reaches as far as the range",
            transform=axes.transAxes,
            ha="center",
        )
        return
    axes.set_yscale("log")
    for values, marker, colour, label in (
        (mean, "o-", "#0072B2", "mean over the states"),
        (worst, "s--", "#D55E00", "worst state"),
    ):
        shown = [(h, p) for h, p in zip(steps, values, strict=True) if p > 0]
        axes.plot(*zip(*shown, strict=True), marker, color=colour, label=label)
    axes.set_xlim(min(steps) / 1.4, max(steps) * 1.4)
    none = [h for h, p in zip(steps, worst, strict=True) if p <= 0]
    if none:
        words = f"0 for h ≤ 2^{round(np.log2(max(none)))}"
        axes.text(0.04, 0.05, words, transform=axes.transAxes)
    axes.grid(alpha=0.3)
    axes.legend(frameon=False, fontsize=8, loc="lower right")


def _exits(axes: Any, exits: Sequence[Exits]) -> None:
    """When paths met a step without a solution; a triangle where none did as far as they were followed."""
    axes.set_xscale("log", base=2)
    axes.set_yscale("log")
    axes.set_xlabel("h")
    axes.set_ylabel("t")
    axes.set_title("exits of paths: first, and half of them", fontsize=9)
    for number, name in enumerate(dict.fromkeys(e.scheme for e in exits)):
        colour = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")[number % 6]
        own = [e for e in exits if e.scheme == name]
        for what, line in (("first", "o-"), ("median", "s--")):
            # An exit in the very first step has no place on a logarithmic axis but the first step's end.
            shown = [(e.h, max(t, e.h)) for e in own for t in [getattr(e, what)] if t is not None]
            if shown:
                axes.plot(*zip(*shown, strict=True), line, color=colour, ms=4)
        none = [(e.h * 2 ** (0.08 * number), e.until) for e in own if not e.failed]
        if none:
            axes.plot(*zip(*none, strict=True), "^", color=colour, mfc="none")
        axes.plot([], [], "o-", color=colour, label=name)
    axes.plot([], [], "^", color="#555555", mfc="none", label="none failed until there")
    axes.grid(alpha=0.3)
    axes.legend(frameon=False, fontsize=8, loc="lower left")
