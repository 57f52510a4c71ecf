"""Convergence plots: rms errors at the end against the step size, and whether each slope is the stated order."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sepv.record._binary64 import EPS
from sepv.studies._picture import Axis, Series
from sepv.studies._reproduce import runs
from sepv.studies._reproduce.job import Job, Results, Size
from sepv.studies._reproduce.record import Panel, Statement, decide, series
from sepv.verification._orders.convergence import StrongErrors, join, slope

# Two-sided, for each slope: the chance that an interval misses the slope that it estimates.
ALPHA = 0.01
# A job is one scheme and so many samples: large enough for batches, small enough to share out.
PART = 1024
# Microseconds a sample and step in batches, for the time left.
COST = {"energy-preserving": 3.0, "midpoint": 2.5, "discrete-gradient": 5.0}

# The mean-square orders that §4 gives: the paper's statements, not what the schemes here claim.
STATED = {
    "energy-preserving": 1.0,
    "midpoint": 1.0,
    "discrete-gradient": 1.0,
    "euler-heun": 1.0,
    "milstein": 1.0,
    "euler-maruyama": 0.5,
}

# The domain-keeping splitting of [23] with exact flows, which the paper names and does not show.
OURS = {"splitting": 1.0}

H_AXIS = Axis("step size h", log=True)
ERROR_AXIS = Axis("mean-square error at the end", log=True)


@dataclass(frozen=True)
class Setting:
    """A convergence experiment: h = T/steps, `samples` paths."""

    figure: str
    problem: str
    T: float
    steps: tuple[int, ...]
    samples: int
    schemes: tuple[str, ...] = tuple(STATED)

    @property
    def given(self) -> dict[str, Any]:
        """What every job of it is told."""
        return {"problem": self.problem, "T": self.T, "steps": self.steps}

    def job(self, key: tuple[str, ...], scheme: str, samples: range, size: Size, cost: float) -> Job:
        """The errors of one scheme on these samples; `cost` in microseconds a sample and step."""
        arguments = {
            "scheme": scheme,
            "samples": len(samples),
            "first": samples.start,
            **self.given,
            **size.given,
        }
        seconds = len(samples) * sum(self.steps) * COST.get(scheme, cost) * 1e-6
        return Job((self.figure, *key), runs.errors, arguments, seconds)


def jobs(setting: Setting, size: Size) -> list[Job]:
    """One job a scheme and part of the samples."""
    total = size.samples(setting.samples)
    parts = [range(first, min(first + PART, total)) for first in range(0, total, PART)]
    return [
        setting.job(("order", scheme, str(part.start)), scheme, part, size, 0.5)
        for scheme in setting.schemes
        for part in parts
    ]


def collect(setting: Setting, results: Results) -> dict[str, StrongErrors]:
    """The errors of each scheme, all its samples together."""
    found = {}
    for scheme in setting.schemes:
        keys = [k for k in results if k[:3] == (setting.figure, "order", scheme)]
        found[scheme] = join([results[k] for k in sorted(keys, key=lambda k: int(k[3]))])
    return found


def curves(found: dict[str, StrongErrors]) -> tuple[Series, ...]:
    """rms error against h, a series for each scheme."""
    return tuple(
        series(name, e.T / np.array(e.steps), e.rms(), scheme=name, style="both") for name, e in found.items()
    )


def order_statement(name: str, found: StrongErrors, source: str) -> Statement:
    """Whether the measured slope is the order that the paper gives the scheme."""
    stated = (STATED | OURS)[name]
    measured = slope(found, ALPHA)
    words = {0.5: "1/2", 1.0: "1"}[stated]
    return Statement(
        text=f"{sentence(name)} has mean-square order {words}",
        source=source,
        verdict=decide(
            stated - 0.25 < measured.low and measured.high < stated + 0.25,
            measured.high < stated - 0.25 or measured.low > stated + 0.25,
        ),
        measured=f"slope {measured.value:.3f} in [{measured.low:.3f}, {measured.high:.3f}]"
        + (f"; {sum(found.failures)} samples with a step that failed" if any(found.failures) else ""),
        criterion=f"the 99 % interval lies within {stated:g} ± 1/4, the middle between the orders 1/2 and 1",
    )


def same_statement(
    one: str, other: str, found: dict[str, StrongErrors], source: str, reason: str
) -> Statement:
    """Whether two schemes are one and the same on this problem: their ends differ by rounding only."""
    a, b = found[one], found[other]
    difference = float(np.max(np.abs(a.errors - b.errors)))
    # Rounding enters at every step and is carried to the end by the flow's Lipschitz constant, e^2 or less here.
    bound = 64 * EPS * a.scale * max(a.steps)
    return Statement(
        text=f"{SENTENCE[one]} and {SENTENCE[other].replace('The', 'the')} are one integrator here, because {reason}",
        source=source,
        verdict=decide(difference <= bound, difference > 1e3 * bound),
        measured=f"largest difference of the ends over all samples and step sizes {difference:.1e}",
        criterion=f"at most 64 eps N |y| = {bound:.1e}, a rounding for each step",
    )


def panel(
    setting: Setting,
    found: dict[str, StrongErrors],
    *,
    title: str,
    source: str,
    place: str,
    chosen: Sequence[str],
    extra: Sequence[Statement] = (),
) -> Panel:
    """The convergence plot with a statement about every scheme in it."""
    statements = [
        order_statement(name, e, place if name == "energy-preserving" else stated_in(name, "§4"))
        for name, e in found.items()
    ]
    samples = next(iter(found.values())).squared.shape[1]
    return Panel(
        key=f"{setting.figure}-order",
        title=title,
        source=source,
        x=H_AXIS,
        y=ERROR_AXIS,
        series=curves(found),
        parameters={
            "problem": setting.problem,
            "T": setting.T,
            "samples": samples,
            "h": [setting.T / n for n in setting.steps],
        },
        chosen=tuple(chosen),
        slopes=(0.5, 1.0),
        statements=(*statements, *extra),
        description="Mean-square errors fall with the step size along lines of slope one, those of "
        "Euler-Maruyama along slope one half.",
        numbers={
            name: {"rms": e.rms().tolist(), "failures": list(e.failures), "slope": slope(e, ALPHA).value}
            for name, e in found.items()
        },
    )


# A scheme's name as a sentence begins.
SENTENCE = {
    "energy-preserving": "The energy-preserving scheme",
    "midpoint": "The midpoint scheme",
    "discrete-gradient": "The discrete gradient scheme",
    "euler-heun": "Euler-Heun",
    "milstein": "Milstein",
    "euler-maruyama": "Euler-Maruyama",
    "splitting": "The splitting scheme",
}


def stated_in(name: str, place: str) -> str:
    """Where the paper speaks of a scheme: in the place of the figure, or where it names what it does not show."""
    return "[23] in §1" if name in OURS else place


def sentence(name: str) -> str:
    """The beginning of a statement; what is not the paper's says so."""
    return f"{'(ours) ' if name in OURS else ''}{SENTENCE[name]}"
