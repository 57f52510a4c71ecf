"""Pictures of a path and of an ensemble, for notebooks. They need the extra ``plots``."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np

from sepv.pictures import (
    DRAWN_ZERO,
    TIME_AXIS,
    Axis,
    Series,
    draw_curves,
    figure,
    frame,
    line,
    looks,
    looks_of,
    require_matplotlib,
)
from sepv.problem import Array, Problem, changes_of_invariants

# The largest numbers of curves, of points of a curve's strips, and of ends in a picture.
MAX_CURVES, MAX_STRIPS, MAX_ENDS = 6, 400, 2000
ENDS_SIZE = (9.5, 3.8)


class Path(Protocol):
    """The parts of a `Trajectory` that its picture shows: times (N + 1,), states (d, N + 1),
    and the problem.
    """

    @property
    def t(self) -> Array: ...
    @property
    def y(self) -> Array: ...
    @property
    def problem(self) -> Problem | None: ...


class DrawnEnds(Protocol):
    """The parts of an `Ensemble` that its picture shows; `Ensemble` documents them."""

    @property
    def y(self) -> Any: ...
    @property
    def status(self) -> Any: ...
    @property
    def times(self) -> Array: ...
    @property
    def states(self) -> Any: ...
    @property
    def energy_defect(self) -> Any: ...
    @property
    def casimir_defect(self) -> Any: ...
    @property
    def about(self) -> Mapping[str, Any]: ...


def path_figure(path: Path) -> Any:
    """The components of y over time, and the changes of the invariants if the path knows its
    problem.
    """
    require_matplotlib("the arrays t and y need none")
    components = [_curve(f"y{i}", path.t, values) for i, values in enumerate(path.y[:MAX_CURVES], 1)]
    sides = {_label("state", path.y.shape[0]): components}
    if path.problem is not None:
        changes = list(changes_of_invariants(path.problem, path.y).items())
        sides[_label("change since t = 0", len(changes))] = [
            _curve(name, path.t, values) for name, values in changes[:MAX_CURVES]
        ]
    with figure(
        ENDS_SIZE[0] if len(sides) > 1 else ENDS_SIZE[0] / 2, ENDS_SIZE[1], layout="constrained"
    ) as drawn:
        for axes, (label, curves) in zip(np.ravel(drawn.subplots(1, len(sides))), sides.items(), strict=True):
            draw_curves(axes, curves, looks([""]), TIME_AXIS, Axis(label), most=MAX_STRIPS)
            axes.legend(ncols=3, loc="lower right", bbox_to_anchor=(1, 1))
        if path.problem is not None:
            drawn.suptitle(f"{path.problem.name}: {path.y.shape[1] - 1:,} steps")
        return drawn


def ensemble_figure(ends: DrawnEnds) -> Any:
    """The states of the paths that got through, and the distribution of their defects."""
    require_matplotlib("the arrays y and states need none")
    got_through = np.asarray(ends.status) == 0
    with figure(*ENDS_SIZE, layout="constrained") as drawn:
        states, defects = drawn.subplots(1, 2)
        if len(ends.times):
            _bands(states, ends.times, np.asarray(ends.states[...])[:, :, got_through])
        else:
            _ends(states, np.asarray(ends.y[...])[:, got_through])
        _shares(defects, ends, got_through)
        names = [str(ends.about[key]) for key in ("scheme", "problem") if key in ends.about]
        failed = np.count_nonzero(~got_through)
        count = f"{got_through.sum():,} paths" + (f", and {failed:,} that failed" if failed else "")
        drawn.suptitle(f"{' on '.join(names)}: {count}" if names else count)
        return drawn


def _label(what: str, count: int) -> str:
    return what if count <= MAX_CURVES else f"{what}, the first {MAX_CURVES} of {count}"


def _curve(name: str, t: Array, values: Array) -> Series:
    return Series(name, t.tolist(), values.tolist())


def _bands(axes: Any, times: Array, states: Array) -> None:
    """The median of each component of `states` (d, K, M) over time,
    in the band between its quantiles.
    """
    if not states.shape[2]:
        return
    low, middle, high = np.quantile(states[:MAX_CURVES], (0.05, 0.5, 0.95), axis=2)
    curves = [_curve(f"y{i}", times, values) for i, values in enumerate(middle, 1)]
    for look, below, above in zip(looks_of(curves, looks([""])), low, high, strict=True):
        axes.fill_between(times, below, above, color=look.colour, alpha=0.15, linewidth=0)
    draw_curves(axes, curves, looks([""]), TIME_AXIS, Axis(_label("median, and 5 % to 95 %", len(states))))
    axes.legend(ncols=3, loc="lower right", bbox_to_anchor=(1, 1))


def _ends(axes: Any, y: Array) -> None:
    """The ends y (d, M) of the first `MAX_ENDS` paths: y2 against y1,
    or their order against y1 if d = 1.
    """
    drawn = (
        y[:, :MAX_ENDS]
        if len(y) > 1
        else np.stack([np.sort(y[0]), np.arange(1, y.shape[1] + 1) / y.shape[1]])
    )
    (look,) = looks_of([Series("", (), ())], looks([""]))
    axes.plot(drawn[0], drawn[1], **line(look, "points"))
    frame(axes, Axis("y1 at T"), Axis("y2 at T" if len(y) > 1 else "share of paths"))


def _shares(axes: Any, ends: DrawnEnds, got_through: Any) -> None:
    """The share of paths whose largest change of an invariant is at most x;
    no change is drawn at half an ulp of 1.
    """
    curves = []
    for name, values in (("H", ends.energy_defect), ("a Casimir", ends.casimir_defect)):
        sorted_defects = np.sort(np.maximum(np.asarray(values[...])[got_through], DRAWN_ZERO))
        if sorted_defects.size and (name == "H" or sorted_defects[-1] > DRAWN_ZERO):
            curves.append(
                _curve(name, sorted_defects, np.arange(1, sorted_defects.size + 1) / sorted_defects.size)
            )
    draw_curves(
        axes, curves, looks([""]), Axis("largest change along a path", log=True), Axis("share of paths")
    )
    axes.legend(ncols=2, loc="lower right", bbox_to_anchor=(1, 1))
