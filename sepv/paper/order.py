"""Convergence plots: rms errors at the end time against the step size,
and verdicts on the stated orders.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sepv.properties import StrongErrors
from sepv.properties import mean_square_slope as slope
from sepv.record import EPS

from . import judge, record, runs
from .record import Job, Panel, Results, Size, Statement, rms_points

# The probability that the two-sided confidence interval of a slope does not contain the slope.
SLOPE_ALPHA = 0.01
# Microseconds for each sample and step in a batch, from which the time left is estimated.
SAMPLE_MICROSECONDS = {"energy-preserving": 3.0, "midpoint": 2.5, "discrete-gradient": 5.0}


@dataclass(frozen=True)
class Setting:
    """A convergence experiment with step sizes h = T/steps over `samples` paths,
    and the texts of its plot.

    source : the plot of the paper that the experiment repeats
    place : where the paper states the order of (2.1), or names a reference with a fine step
    same : pairs of schemes with equal steps on this problem, each with the place in the paper and
        the reason
    """

    figure: str
    problem: str
    T: float
    steps: tuple[int, ...]
    samples: int
    schemes: tuple[str, ...] = tuple(record.STATED_ORDERS)
    title: str = ""
    source: str = ""
    place: str = ""
    chosen: tuple[str, ...] = ()
    same: tuple[tuple[str, str, str, str], ...] = ()

    @property
    def given(self) -> dict[str, Any]:
        """The arguments that all jobs of the experiment share."""
        return {"problem": self.problem, "T": self.T, "steps": self.steps}

    def job(self, key: tuple[str, ...], scheme: str, samples: int, size: Size, cost: float) -> Job:
        """The job that measures the errors of one scheme on `samples` paths.

        `cost` is the expected time of one step of one sample, in microseconds.
        """
        arguments = {"scheme": scheme, "samples": samples, **self.given, **size.given}
        seconds = samples * sum(self.steps) * SAMPLE_MICROSECONDS.get(scheme, cost) * 1e-6
        return Job((self.figure, *key), runs.errors, arguments, seconds)


def jobs(setting: Setting, size: Size) -> list[Job]:
    """The jobs of a convergence experiment: one for each scheme."""
    samples = size.samples(setting.samples)
    return [setting.job(("order", scheme), scheme, samples, size, 0.5) for scheme in setting.schemes]


def order_statement(name: str, errors: StrongErrors, source: str) -> Statement:
    """The statement of the paper on the order of a scheme, with a verdict by the measured slope."""
    stated = (record.STATED_ORDERS | record.ORDER_OF_OURS)[name]
    measured = slope(errors, SLOPE_ALPHA)
    failed = f"; {sum(errors.failures)} samples with a step that failed" if any(errors.failures) else ""
    return Statement(
        f"{record.sentence(name)} has mean-square order {'1/2' if stated == 0.5 else '1'}", source,
        judge.interval_near(measured.low, measured.high, stated, 0.25),
        f"slope {measured.value:.3f} in [{measured.low:.3f}, {measured.high:.3f}]{failed}",
        f"the 99 % interval lies within {stated:g} ± 1/4, the middle between the orders 1/2 and 1",
    )  # fmt: skip


def same_statement(
    one: str, other: str, errors: dict[str, StrongErrors], source: str, reason: str
) -> Statement:
    """The statement that the schemes `one` and `other` are equal here:
    their y at T differ by rounding only.
    """
    a, b = errors[one], errors[other]
    difference = float(np.max(np.abs(a.errors - b.errors)))
    # Each step adds a rounding error, which the flow multiplies by its Lipschitz constant, e^2 or
    # less here.
    bound = 64 * EPS * a.scale * max(a.steps)
    first, second = (record.SENTENCE[name] for name in (one, other))
    return Statement(
        f"{first} and {second.replace('The', 'the')} are one integrator here, because {reason}", source,
        judge.at_most(difference, bound, 1e3 * bound),
        f"largest difference of the ends over all samples and step sizes {difference:.1e}",
        f"at most 64 eps N |y| = {bound:.1e}, a rounding for each step",
    )  # fmt: skip


def panel(setting: Setting, results: Results, extra: Sequence[Statement] = ()) -> Panel:
    """The panel with the convergence plot, a statement on each scheme,
    and one on each pair that is one integrator.
    """
    errors: dict[str, StrongErrors] = {n: results[setting.figure, "order", n] for n in setting.schemes}
    places = {n: setting.place if n == "energy-preserving" else record.stated_in(n, "§4") for n in errors}
    h = setting.T / np.array(setting.steps)
    return Panel(
        key=f"{setting.figure}-order", title=setting.title, source=setting.source,
        series=tuple(rms_points(name, h, e.squared, name) for name, e in errors.items()),
        parameters={
            "problem": setting.problem, "T": setting.T, "samples": next(iter(errors.values())).squared.shape[1],
            "h": h.tolist(),
        },
        chosen=setting.chosen,
        slopes=(0.5, 1.0),
        statements=(
            *(order_statement(name, e, places[name]) for name, e in errors.items()),
            *(same_statement(one, other, errors, where, why) for one, other, where, why in setting.same),
            *extra,
        ),
        description="Mean-square errors with intervals of 95 % fall with the step size along lines of slope one, "
        "those of Euler-Maruyama along slope one half.",
        numbers={
            name: {"rms": e.rms().tolist(), "failures": list(e.failures), "slope": slope(e, SLOPE_ALPHA).value}
            for name, e in errors.items()
        },
    )  # fmt: skip


def fine_jobs(setting: Setting, size: Size) -> list[Job]:
    """The jobs that show how errors change if a scheme with a fine step stands for the exact
    solution.

    This reference is the first scheme with steps[-1] steps; errors are measured for each number in
    `steps`.
    """
    samples = size.samples(setting.samples)
    counting = {**setting.given, "samples": samples, "seed": size.seed}
    return [
        *(setting.job(("fine", name), name, samples, size, 0.3) for name in setting.schemes),
        Job((setting.figure, "fine", "truncated"), runs.truncated, counting, 1.0),
    ]


def fine_panel(setting: Setting, results: Results) -> Panel:
    """The panel of errors against the exact solution beside errors against a scheme with a fine
    step, as in the paper.

    An error against a scheme with a fine step is the difference of two errors. If both are errors
    of the same scheme, the difference is too small, and the slope too steep, for h near the fine
    step; there it is zero.
    """
    errors: dict[str, StrongErrors] = {n: results[setting.figure, "fine", n] for n in setting.schemes}
    reference = setting.schemes[0]
    h = setting.T / np.array(setting.steps)
    at = [f"at h = 2^{np.log2(step):.0f}" for step in h]
    own_step = at[-1].removeprefix("at h = ")
    truth = errors[reference].errors[-1]
    curves, numbers = [], {}
    for name, e in errors.items():
        squared = np.sum((e.errors - truth) ** 2, axis=1)
        against = np.sqrt(np.mean(squared, axis=1))
        numbers[name] = {"exact reference": e.rms().tolist(), "fine-step reference": against.tolist()}
        # The reference's own scheme has error zero at its own step, which a logarithmic axis cannot
        # show.
        nonzero = against > 0
        curves.append(rms_points(f"{name}, exact reference", h, e.squared, name))
        curves.append(rms_points(f"{name}, fine-step reference", h[nonzero], squared[nonzero], name))
    true, own_end = map(np.array, numbers[reference].values())
    # A truncated increment causes an error of its sample that the order of the scheme does not
    # explain.
    counts = zip(results[setting.figure, "fine", "truncated"], at, strict=True)
    truncated = ", ".join(f"{n} {where}" for n, where in counts if n)
    bumps = f"increments that Remark 2.1 truncates, each a bump in the curves: {truncated}"
    exact = Statement(
        f"(ours) The {reference} scheme with step {own_step} serves as the exact solution down to its own step",
        setting.place,
        judge.decide(bool(np.all(own_end > 0.95 * true)), bool(own_end[-1] < 0.05 * true[-1])),
        f"of the true error of the {reference} scheme it sees "
        + ", ".join(f"{part:.0%} {where}" for part, where in zip(own_end / true, at, strict=True)),
        "at least 95 % of the true error, at every step size",
        "the exact solution is the flow at the time t + Σ c_j W_j(t), without a step size. At the steps of "
        f"the paper's plot, well above {own_step}, the bias is small and its slopes stand",
    )  # fmt: skip
    return Panel(
        key=f"{setting.figure}-fine-step-reference",
        title=setting.title,
        source=setting.source,
        series=tuple(curves),
        parameters={"problem": setting.problem, "T": setting.T, "samples": truth.shape[1], "h": h.tolist()},
        chosen=(
            f"{truth.shape[1]} samples; step sizes down to the reference's own, {own_step}, where its bias is largest",
            *([bumps] if truncated else []),
        ),
        slopes=(0.5, 1.0),
        statements=(exact,),
        description="Against the exact solution both schemes go on with slope one; against the fine-step one the curve "
        "of its own scheme bends down and reaches zero at the reference's step.",
        numbers=numbers,
    )  # fmt: skip
