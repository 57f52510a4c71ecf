"""The records of a reproduction of the paper: jobs to compute, panels (plots as data),
and statements with verdicts.

A panel holds everything that is drawn, so that the figures, the page and a reader's own program all
start from the same numbers. Jobs run in any order and any process.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, field
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sepv.files import finite
from sepv.pictures import SUFFIXES, Axis, Series, content, draw_curves, figure, looks
from sepv.statistics import jackknife

from .judge import Verdict

# The paper's schemes: the name at the start of a sentence, and the mean-square order that §4 gives
# (the paper's statements, not the claims of the schemes here).
_PAPER = {
    "energy-preserving": ("The energy-preserving scheme", 1.0),
    "midpoint": ("The midpoint scheme", 1.0),
    "discrete-gradient": ("The discrete gradient scheme", 1.0),
    "euler-heun": ("Euler-Heun", 1.0),
    "milstein": ("Milstein", 1.0),
    "euler-maruyama": ("Euler-Maruyama", 0.5),
}
STATED_ORDERS = {name: order for name, (_, order) in _PAPER.items()}
# The domain-keeping splitting of [23] with exact flows, which the paper names and does not show.
ORDER_OF_OURS = {"splitting": 1.0}
SENTENCE = {name: words for name, (words, _) in _PAPER.items()} | {"splitting": "The splitting scheme"}

# The place of each scheme in a legend; references come first, and schemes of no figure last.
_PLACES = {name: place for place, name in enumerate(("", *STATED_ORDERS, *ORDER_OF_OURS))}

H_AXIS = Axis("step size h", log=True)
ERROR_AXIS = Axis("mean-square error at the end", log=True)

# Schemes with compiled code in the extra `fast`, which takes a few per cent of NumPy's time, and
# time to load.
COMPILED = frozenset(("energy-preserving", "midpoint", "euler-heun", "milstein"))


@dataclass(frozen=True)
class Job:
    """One call of a function, with the seconds that it should take in NumPy,
    which order the jobs and show progress.
    """

    key: tuple[str, ...]
    function: Callable[..., Any]
    arguments: dict[str, Any]
    seconds: float

    def expected(self) -> float:
        """The expected seconds of the job on this machine's engine,
        by which jobs are ordered and progress is shown.
        """
        compiled = self.arguments.get("engine") == "auto" and self.arguments.get("scheme") in COMPILED
        return 0.1 + 0.02 * self.seconds if compiled and find_spec("numba") else self.seconds


@dataclass(frozen=True)
class Size:
    """The size of a reproduction: the fraction of the paper's work that is done,
    the seed and the engine.
    """

    seed: int = 0
    share: float = 1.0
    engine: str = "auto"

    @property
    def given(self) -> dict[str, Any]:
        """The arguments that all jobs with random paths share."""
        return {"seed": self.seed, "engine": self.engine}

    def steps(self, full: int) -> int:
        """The number of steps of this reproduction for a run of the paper with `full` steps."""
        return max(128, round(full * self.share))

    def samples(self, full: int) -> int:
        """The number of samples of this reproduction for a convergence plot of the paper with
        `full` samples.
        """
        return max(128, round(full * self.share))


Results = dict[tuple[str, ...], Any]


@dataclass(frozen=True)
class Statement:
    """A statement of the paper about a quantity that can be computed,
    and the verdict of the computation.

    text, source : the statement, in the paper's words or close to them, and its place in the paper
    measured : what was measured, and the result
    criterion : the condition for "holds"; the text says so if the condition is not derived, but our
        own choice
    correction : the right statement, if the paper's does not hold as printed
    """

    text: str
    source: str
    verdict: Verdict
    measured: str
    criterion: str
    correction: str = ""


@dataclass(frozen=True, kw_only=True)
class Panel:
    """One plot of one figure, as data.

    key : the name of the panel and its files, such as "4.1-phase-space": the figure (or "theory"),
        then its subject
    parameters : the parameters of the paper, and those of the computation
    chosen : the choices made where the paper gives none
    slopes : the reference slopes to draw
    description : the picture in words, for readers who cannot see it
    equal : True if both axes have the same scale
    window : if given, only points with |y| ≤ window are drawn, and |x| ≤ window if `equal`; the
        series have all points
    """

    key: str
    title: str
    source: str
    x: Axis = H_AXIS
    y: Axis = ERROR_AXIS
    series: tuple[Series, ...]
    parameters: dict[str, Any]
    chosen: tuple[str, ...] = ()
    slopes: tuple[float, ...] = ()
    statements: tuple[Statement, ...] = ()
    description: str = ""
    equal: bool = False
    window: float | None = None
    seconds: float = 0.0
    numbers: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Sort the curves, so that the schemes have the same order in every legend."""
        object.__setattr__(self, "series", tuple(sorted(self.series, key=_place)))

    def to_json(self) -> dict[str, Any]:
        """The panel as JSON; numbers that are not finite are null."""
        data: dict[str, Any] = finite({"figure": self.key.partition("-")[0], **asdict(self)})
        return data

    def to_csv(self) -> str:
        """The points of all series as CSV, one row a point: series, scheme, x, y,
        half the width of y's interval.
        """
        out = io.StringIO()
        table = csv.writer(out, lineterminator="\n")
        table.writerow(["series", "scheme", self.x.label, self.y.label, "±"])
        for s in self.series:
            half: Sequence[Any] = s.half or [""] * len(s.y)
            table.writerows((s.name, s.scheme, *point) for point in zip(s.x, s.y, half, strict=True))
        return out.getvalue()


def series(
    name: str, x: ArrayLike, y: ArrayLike, scheme: str = "", style: Any = "line", *, half: ArrayLike = (),
    group: str = "",
) -> Series:  # fmt: skip
    """A `Series` of arrays x and y, and of half the widths of the intervals of y, if there are
    any.
    """
    numbers = (tuple(np.asarray(v, float).tolist()) for v in (x, y, half))
    return Series(name, next(numbers), next(numbers), scheme, style, next(numbers), group)


def points(name: str, x: ArrayLike, y: ArrayLike, scheme: str = "", **more: Any) -> Series:
    """A `Series` of few points, drawn with markers and joined by lines,
    such as errors against step sizes.
    """
    return series(name, x, y, scheme, "both", **more)


def rms_points(name: str, h: ArrayLike, squared: ArrayLike, scheme: str) -> Series:
    """The curve of rms errors with intervals of 95 %, from the squared errors (L, M)
    of M samples for L step sizes.
    """
    estimates = [jackknife(row[None], lambda mean: math.sqrt(mean[0]), 0.05) for row in np.asarray(squared)]
    return points(name, h, [e.value for e in estimates], scheme, half=[e.half for e in estimates])


def counts(statements: Iterable[Statement]) -> dict[str, int]:
    """The numbers of statements with each verdict: holds, fails, open."""
    verdicts = [s.verdict for s in statements]
    return {kind: verdicts.count(kind) for kind in ("holds", "fails", "open")}


def _place(curve: Series) -> int:
    """The place of a curve in a legend; groups keep the order in which a panel gives them."""
    return 0 if curve.group else _PLACES.get(curve.scheme, len(_PLACES))


def stated_in(name: str, place: str) -> str:
    """The place where the paper writes about a scheme: `place`, or §1 for the splitting,
    which no figure shows.
    """
    return "[23] in §1" if name in ORDER_OF_OURS else place


def sentence(name: str) -> str:
    """The name that starts a sentence about a scheme, with "(ours)" if the paper's figures do not
    show it.
    """
    return f"{'(ours) ' if name in ORDER_OF_OURS else ''}{SENTENCE[name]}"


# In inches; the width is that of a journal's column, 86 mm. Type has 8 points, the smallest has
# 6.5.
FIGURE_WIDTH, FIGURE_HEIGHT = 3.39, 3.05
# Letters are drawn as paths, so that a journal's page shows them as they are here.
_FIGURE_STYLE = {
    "svg.fonttype": "path", "font.size": 8, "xtick.labelsize": 7, "ytick.labelsize": 7, "legend.fontsize": 6.5,
    "lines.linewidth": 1.0, "grid.linewidth": 0.4,
}  # fmt: skip


def draw(panel: Panel, folder: Path) -> list[Path]:
    """Write the plot to folder/KEY.svg, .pdf and .png (300 dpi), with the panel's key,
    and return the paths.
    """
    # Two columns of longer labels are wider than the figure. A legend of many rows makes the figure
    # higher.
    columns = 2 if max(len(s.name) for s in panel.series) <= 22 else 1
    more = max(0, math.ceil(len(panel.series) / columns) - 3)
    with figure(FIGURE_WIDTH, FIGURE_HEIGHT + 0.14 * more, _FIGURE_STYLE, layout="constrained") as drawn:
        draw_curves(
            drawn.add_subplot(), panel.series, looks(s.look_key for s in panel.series), panel.x, panel.y,
            slopes=panel.slopes, equal=panel.equal, window=panel.window,
        )  # fmt: skip
        drawn.suptitle(panel.title, fontsize=8)
        drawn.legend(loc="outside lower center", ncols=columns, handlelength=2.6)
        paths = [folder / f"{panel.key}{suffix}" for suffix in SUFFIXES]
        for path in paths:
            path.write_bytes(content(drawn, path.suffix, title=panel.title, dpi=300))
    return paths
