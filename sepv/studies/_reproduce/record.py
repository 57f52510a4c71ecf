"""What a reproduction leaves: panels as data, and the paper's statements with a verdict each.

A panel holds everything that is drawn, so that the figures, the page and a reader's own program all
start from the same numbers.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from sepv._terminal import counted
from sepv.files import finite
from sepv.studies._picture import Axis, Series

# What became of a statement: it holds, it does not, or the measurement does not decide.
Verdict = Literal["holds", "fails", "open"]


@dataclass(frozen=True)
class Statement:
    """A statement of the paper about what is computed, and what the computation says.

    Attributes
    ----------
    text : str
        The statement, in the paper's words or close to them.
    source : str
        Where it stands.
    measured : str
        What was measured and what it came to.
    criterion : str
        When the statement counts as true; derived, or apologised for.
    correction : str
        What should stand there, where it does not hold as printed.
    """

    text: str
    source: str
    verdict: Verdict
    measured: str
    criterion: str
    correction: str = ""


@dataclass(frozen=True)
class Panel:
    """One panel of one figure.

    Attributes
    ----------
    key : str
        Names the panel and its files, such as "4.1-phase-space": the figure, or "theory", and what is shown.
    parameters : dict
        What the paper gives and what was used.
    chosen : tuple of str
        What the paper leaves open, and what was taken.
    slopes : tuple of float
        The reference slopes to draw.
    description : str
        What there is to see, for whoever does not see it.
    equal : bool
        Whether both axes have one scale.
    window : float, optional
        Only |y| up to this is drawn, and |x| too where both axes have one scale; the series go on beyond.
    """

    key: str
    title: str
    source: str
    x: Axis
    y: Axis
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

    def to_json(self) -> dict[str, Any]:
        """The panel as JSON; numbers that are not finite are null."""
        data: dict[str, Any] = finite({"figure": self.key.partition("-")[0], **asdict(self)})
        return data

    def to_csv(self) -> str:
        """series, scheme, x, y: one row a point."""
        out = io.StringIO()
        table = csv.writer(out, lineterminator="\n")
        table.writerow(["series", "scheme", self.x.label, self.y.label])
        for s in self.series:
            table.writerows((s.name, s.scheme, repr(x), repr(y)) for x, y in zip(s.x, s.y, strict=True))
        return out.getvalue()


def series(name: str, x: ArrayLike, y: ArrayLike, scheme: str = "", style: Any = "line") -> Series:
    """A series from arrays."""
    return Series(
        name, tuple(np.asarray(x, float).tolist()), tuple(np.asarray(y, float).tolist()), scheme, style
    )


def decide(true: bool, false: bool) -> Verdict:
    """The verdict from two criteria that exclude each other; open where neither is met."""
    assert not (true and false)
    return "holds" if true else "fails" if false else "open"


def counts(statements: Iterable[Statement]) -> dict[str, int]:
    """How many statements hold, fail and stay open."""
    found = [s.verdict for s in statements]
    return {kind: found.count(kind) for kind in ("holds", "fails", "open")}


def in_words(counts: Mapping[str, int]) -> str:
    """12 statements: 10 hold, 1 does not, 1 open."""
    holds, fails = counts["holds"], counts["fails"]
    return (
        f"{counted(sum(counts.values()), 'statement')}: {holds} hold{'s' * (holds == 1)}, "
        f"{fails} {'does' if fails == 1 else 'do'} not, {counts['open']} open"
    )
