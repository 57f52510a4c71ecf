"""Convergence plots: rms errors at the end against the step size, and whether each slope is the stated order."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sepv.record._binary64 import EPS
from sepv.studies._reproduce import record, runs
from sepv.studies._reproduce.record import Job, Panel, Results, Size, Statement, decide, series
from sepv.verification._orders.convergence import StrongErrors, join, slope

# Two-sided, for each slope: the chance that an interval misses the slope that it estimates.
ALPHA = 0.01
# A job is one scheme and so many samples: large enough for batches, small enough to share out.
PART = 1024
# Microseconds a sample and step in batches, for the time left.
COST = {"energy-preserving": 3.0, "midpoint": 2.5, "discrete-gradient": 5.0}


@dataclass(frozen=True)
class Setting:
    """A convergence experiment: h = T/steps, `samples` paths."""

    figure: str
    problem: str
    T: float
    steps: tuple[int, ...]
    samples: int
    schemes: tuple[str, ...] = tuple(record.STATED)

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


def order_statement(name: str, found: StrongErrors, source: str) -> Statement:
    """Whether the measured slope is the order that the paper gives the scheme."""
    stated = (record.STATED | record.OURS)[name]
    measured = slope(found, ALPHA)
    words = {0.5: "1/2", 1.0: "1"}[stated]
    return Statement(
        text=f"{record.sentence(name)} has mean-square order {words}",
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
    first, second = (record.SENTENCE[name] for name in (one, other))
    return Statement(
        text=f"{first} and {second.replace('The', 'the')} are one integrator here, because {reason}",
        source=source,
        verdict=decide(difference <= bound, difference > 1e3 * bound),
        measured=f"largest difference of the ends over all samples and step sizes {difference:.1e}",
        criterion=f"at most 64 eps N |y| = {bound:.1e}, a rounding for each step",
    )


def panel(
    setting: Setting, results: Results, *, title: str, source: str, place: str, chosen: Sequence[str],
    same: Sequence[tuple[str, str, str, str]] = (), extra: Sequence[Statement] = (),
) -> Panel:  # fmt: skip
    """The convergence plot with a statement about every scheme in it, and about pairs that are `same`."""
    found = collect(setting, results)
    statements = [
        order_statement(name, e, place if name == "energy-preserving" else record.stated_in(name, "§4"))
        for name, e in found.items()
    ]
    statements += [same_statement(one, other, found, where, why) for one, other, where, why in same]
    samples = next(iter(found.values())).squared.shape[1]
    return Panel(
        key=f"{setting.figure}-order",
        title=title,
        source=source,
        series=tuple(
            series(name, e.T / np.array(e.steps), e.rms(), scheme=name, style="both")
            for name, e in found.items()
        ),
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


def fine_jobs(setting: Setting, size: Size) -> list[Job]:
    """The reference's scheme, the first of two, down to its own step, the last of `steps`, and the other scheme."""
    samples = range(size.samples(setting.samples))
    counting = {**setting.given, "samples": len(samples), "seed": size.seed}
    return [
        *(setting.job(("fine", name), name, samples, size, 0.3) for name in setting.schemes),
        Job((setting.figure, "fine", "truncated"), runs.truncated, counting, 1.0),
    ]


def fine_panel(setting: Setting, results: Results, source: str, stated: str) -> Panel:
    """True errors, and errors as the paper's own kind of reference sees them; `stated` is where the paper names it.

    Errors against a scheme with a fine step are differences of two errors. Where the scheme under test is that scheme,
    or h comes near its step, they are too small and the slope is too steep; at its own step it has no error at all.
    """
    found: dict[str, StrongErrors] = {n: results[setting.figure, "fine", n] for n in setting.schemes}
    reference = setting.schemes[0]
    h = setting.T / np.array(setting.steps)
    truth = found[reference].errors[-1]
    curves, seen = [], {}
    for name, e in found.items():
        against = np.sqrt(np.mean(np.sum((e.errors - truth) ** 2, axis=1), axis=1))
        seen[name] = against
        curves.append(series(f"{name}, exact reference", h, e.rms(), scheme=name, style="both"))
        # The reference's own scheme has error zero at its own step, which a logarithmic axis cannot show.
        kept = against > 0
        curves.append(series(f"{name}, fine-step reference", h[kept], against[kept], style="both"))
    own, true = seen[reference], found[reference].rms()
    share = ", ".join(
        f"{o / t:.0%} at h = 2^{np.log2(step):.0f}" for step, o, t in zip(h, own, true, strict=True)
    )
    own_step = f"2^{np.log2(h[-1]):.0f}"
    # One truncated increment is an error of that sample that no step size explains.
    truncated = ", ".join(
        f"{n} at h = 2^{np.log2(step):.0f}"
        for n, step in zip(results[setting.figure, "fine", "truncated"], h, strict=True)
        if n
    )
    bumps = f"increments that Remark 2.1 truncates, each a bump in the curves: {truncated}"
    exact = Statement(
        text=f"(ours) The {reference} scheme with step {own_step} serves as the exact solution down to its own step",
        source=stated,
        verdict=decide(bool(np.all(own > 0.95 * true)), bool(own[-1] < 0.05 * true[-1])),
        measured=f"of the true error of the {reference} scheme it sees {share}",
        criterion="at least 95 % of the true error, at every step size",
        correction="the exact solution is the flow at the time t + Σ c_j W_j(t), without a step size. At the steps of "
        f"the paper's plot, well above {own_step}, the bias is small and its slopes stand",
    )
    return Panel(
        key=f"{setting.figure}-fine-step-reference",
        title="What a fine-step reference hides",
        source=source,
        series=tuple(curves),
        parameters={"problem": setting.problem, "T": setting.T, "samples": truth.shape[1], "h": h.tolist()},
        chosen=(
            f"{truth.shape[1]} samples; step sizes down to the reference's own, {own_step}, where its bias is largest",
            *([bumps] if truncated else []),
        ),
        slopes=(0.5, 1.0),
        statements=(exact,),
        description="Against the exact solution both schemes go on with slope one; against the fine-step one the "
        "curve of its own scheme bends down and reaches zero at the reference's step.",
        numbers={
            n: {"exact reference": found[n].rms().tolist(), "fine-step reference": seen[n].tolist()}
            for n in found
        },
    )
