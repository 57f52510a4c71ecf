"""Energy over long times: E[H(y_n)] − H(y0) and the rms of H(y_n) − H(y0) against t,
with a verdict on both.

Scheme (2.1) keeps H up to rounding. A symplectic scheme with a fixed step has an error that stays
bounded for very long. With random steps, its energy does a random walk of rms O(√t), and its mean
energy drifts; the drift is smaller than the walk until t is of the order 1/h²
(`_energy_diffusion`). An explicit scheme drifts by O(h)t, and faster later.

The errors at the times T/2^k are taken on the same paths. The growth is the exponent p of rms ∝ t^p
over the last SLOPE_DOUBLINGS doublings of t; the drift is the mean over paths of (H(T) −
H(T/4))/(3T/4). Both have intervals of confidence 1 − GROWTH_LEVEL, the first by a jackknife over
paths. If means over many paths are normal, one kind of growth is mistaken for another with
probability at most GROWTH_LEVEL. A drift that does not exist is found with probability at most
GROWTH_LEVEL.

This is a study and not a law of the suite. Schemes that do not keep H claim nothing about how the
error of H grows. Seeing the drift of a symplectic scheme takes 10⁷ steps, fifty times the steps of
all laws. The laws *energy* and *rounding* check schemes that keep H; the law *long-time-energy* is
for problems without noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np

from sepv.errors import UsageError
from sepv.files import finite
from sepv.pictures import Axis, Series, looks, panels
from sepv.problem import Array, Problem
from sepv.properties import GROWTH_LEVEL
from sepv.properties import energy_rounding_walk as rounding_walk
from sepv.properties import growth_exponent as exponent
from sepv.properties import growth_kind as kind_of
from sepv.schemes import Look, Scheme
from sepv.simulate import ensemble
from sepv.statistics import students_t
from sepv.studies._energy_diffusion import EnergyDiffusion, energy_diffusion

# A bounded error oscillates. If its size doubles between two times, the slope is 1 over one
# doubling of t, but at most 1/4 over four. The period of the oscillation has to be below
# T/2^SLOPE_DOUBLINGS.
SLOPE_DOUBLINGS = 4
# Line styles of a scheme's measured curve, and of its curve by theory.
CURVE_STYLES: tuple[Literal["points", "line"], ...] = ("points", "line")


@dataclass(frozen=True)
class Growth:
    """The energy's error of one scheme over long times.

    times, mean, error, rms : (L,), times, E[H(y_n)] − H(y0) with its standard error, and the rms of
        H(y_n) − H(y0)
    exponent, drift : each a value and half the width of its interval; the drift is per unit of time
    rounding : a bound of the rms at T that rounding alone may cause
    failed : the number of paths with a failed step or an energy that is not finite; if not 0,
        nothing is judged
    derived : offset, drift and diffusion by theory; None if the theory does not hold for the
        scheme, or not up to T
    """

    scheme: str
    paths: int
    times: Array
    mean: Array
    error: Array
    rms: Array
    exponent: tuple[float, float]
    drift: tuple[float, float]
    rounding: float
    failed: int
    derived: EnergyDiffusion | None

    @property
    def kind(self) -> str:
        """The kind of growth of the rms: "rounding", "bounded", "a random walk",
        "linear" or "faster than linear".

        The kind is "open" (undecided) if the interval of the exponent does not decide, or if paths
        failed.
        """
        if self.failed:
            return "open"
        return "rounding" if self.rms[-1] <= self.rounding else kind_of(*self.exponent)

    @property
    def drifts(self) -> bool:
        """True if the mean energy drifts: the drift's interval excludes 0,
        and the error exceeds rounding.
        """
        return self.kind != "rounding" and not self.failed and abs(self.drift[0]) > self.drift[1]

    def to_json(self) -> dict[str, Any]:
        """The fields, and the verdicts `kind` and `drifts`, for a JSON file;
        numbers that are not finite are null.
        """
        fields = {k: v.tolist() if isinstance(v, np.ndarray) else v for k, v in asdict(self).items()}
        return {k: finite(v) for k, v in fields.items()} | {"kind": self.kind, "drifts": self.drifts}

    def sentence(self) -> str:
        """The verdict on one line, for the terminal."""
        if self.failed:
            return f"{self.failed} of {self.paths} paths failed: nothing is judged"
        if self.kind == "rounding":
            return f"rounding: the rms is at most {self.rounding:.1g}"
        grows = self.kind if self.kind != "open" else "not decided"
        text = f"t^({self.exponent[0]:.2f} ± {self.exponent[1]:.2f}), {grows}; the mean "
        text += "drifts" if self.drifts else "is not seen to drift"
        text += f", {self.drift[0]:.2g} ± {self.drift[1]:.1g} per unit of time"
        return text + (f" (theory {self.derived.drift:.2g})" if self.derived else "")


def growth(
    scheme: Scheme, problem: Problem, *, h: float, T: float, paths: int, seed: int = 0, engine: str = "auto"
) -> Growth:  # fmt: skip
    """Measure the growth of the energy's error over `paths` paths from the problem's initial state
    up to T.

    Raises UsageError unless T/h is a multiple of 2^SLOPE_DOUBLINGS, because the times T/2^k must be
    multiples of h.
    """
    steps = round(T / h)
    if steps < 2**SLOPE_DOUBLINGS or steps % 2**SLOPE_DOUBLINGS or not np.isclose(steps * h, T, rtol=1e-12):
        raise UsageError(
            expected=f"a time T that is a multiple of {2**SLOPE_DOUBLINGS} h, h = {h:g}",
            received=f"T = {T:g}",
            remedy=f"T = {max(1, round(steps / 2**SLOPE_DOUBLINGS)) * 2**SLOPE_DOUBLINGS * h:g}",
        )
    counts = [steps]
    while counts[-1] % 2 == 0:
        counts.append(counts[-1] // 2)
    times = np.array(counts[::-1]) * h
    runs = ensemble(scheme, problem, h=h, steps=steps, paths=paths, seed=seed, times=times, engine=engine)
    y0 = np.array(problem.initial, dtype=np.float64)
    derived = energy_diffusion(scheme, problem, h)
    with np.errstate(over="ignore", invalid="ignore"):
        energies = runs.energy() - float(problem.hamiltonian(y0))
        failed = int(np.count_nonzero((runs.status != 0) | ~np.isfinite(energies).all(axis=0)))
        return judged(
            scheme.name, times, energies, rounding=rounding_walk(problem, y0[:, None], steps), failed=failed,
            derived=derived if derived and derived.reaches(T) else None,
        )  # fmt: skip


def judged(
    scheme: str, times: Array, errors: Array, *, rounding: float, failed: int = 0,
    derived: EnergyDiffusion | None = None,
) -> Growth:  # fmt: skip
    """The growth and drift of the energy's `errors` (L, M) on M paths at `times` (L,),
    which end in T/4, T/2, T.
    """
    paths = errors.shape[1]
    rates = (errors[-1] - errors[-3]) / (times[-1] - times[-3])
    half = float(students_t(GROWTH_LEVEL / 2, paths - 1) * np.std(rates, ddof=1) / np.sqrt(paths))
    late = slice(-SLOPE_DOUBLINGS - 1, None)
    return Growth(
        scheme, paths, times, np.mean(errors, axis=1), np.std(errors, axis=1, ddof=1) / np.sqrt(paths),
        np.sqrt(np.mean(errors**2, axis=1)), exponent(times[late], errors[late]),
        (float(np.mean(rates)), half), rounding, failed, derived,
    )  # fmt: skip


def draw(rows: Sequence[Growth], title: str, suffix: str, own: dict[str, Look] | None = None) -> bytes:
    """Draw how the energy's error of each scheme grows, and return the content of a file;
    needs the extra `plots`.

    The left panel has |E[H] − H(y0)| against time, the right panel the rms of H − H(y0), with the
    theory if any.
    """
    sides = []
    for side, label in enumerate(("|mean of H − H(y0)|", "rms of H − H(y0)")):
        shown = []
        for row in rows:
            curves = {row.scheme: (row.mean, row.rms)[side]}
            if row.derived and row.kind != "rounding":
                curves[f"{row.scheme}, theory"] = row.derived.at(row.times)[side]
            shown += [
                Series(name, row.times.tolist(), np.abs(values).tolist(), row.scheme, style)
                for (name, values), style in zip(curves.items(), CURVE_STYLES, strict=False)
            ]
        sides.append((shown, Axis("time t", log=True), Axis(label, log=True)))
    return panels(sides, looks((row.scheme for row in rows), own), title, suffix)
