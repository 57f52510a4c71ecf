"""The map as a picture: what exists at each state and Δ, and the chance that a step leaves it. Extra ``plots``."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any

import numpy as np

from sepv.solvability.map import Finding, Map

# Okabe and Ito, ordered from light to dark, so that they differ without colour too.
COLOURS = {
    Finding.FOUND: "#DDEEF8",
    Finding.MISSED: "#E69F00",
    Finding.ANOTHER: "#009E73",
    Finding.NONE: "#333333",
    Finding.UNKNOWN: "#CC79A7",
}
_STYLE = {"font.size": 9, "svg.fonttype": "none", "svg.hashsalt": "sepv"}


def draw(map_: Map, steps: Sequence[float], k: int | None, suffix: str) -> bytes:
    """The picture as a file's content; `suffix` is one of .svg, .png and .pdf."""
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    with rc_context(_STYLE):
        figure = Figure(figsize=(10, 4.4), layout="constrained")
        left, right = figure.subplots(1, 2, width_ratios=(1.7, 1))
        _map(left, map_)
        _chances(right, map_, steps, k)
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

    colours = ListedColormap([COLOURS[kind] for kind in Finding])
    edges = BoundaryNorm(np.arange(len(Finding) + 1) - 0.5, len(Finding))
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
    chances = [map_.chances(h, k) for h in steps]
    mean, worst = [float(p.mean()) for p in chances], [float(p.max()) for p in chances]
    axes.set_xscale("log", base=2)
    axes.set_xlabel("h")
    axes.set_ylabel("P(Δ of a step is off the branch)")
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
        (mean, "o-", "#0072B2", "mean over the orbit"),
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
