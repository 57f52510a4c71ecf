"""The paper's own kind of reference, a scheme with a fine step, beside the exact one: its bias.

Errors against a fine-step reference are differences of two errors. Where the scheme under test is the
reference's own, or h comes near the reference's step, they are too small and the slope is too steep; at the
reference's step its scheme has no error at all.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sepv.studies._reproduce import runs
from sepv.studies._reproduce.job import Job, Results, Size
from sepv.studies._reproduce.order import COST, ERROR_AXIS, H_AXIS
from sepv.studies._reproduce.record import Panel, Statement, decide, series
from sepv.verification._orders.convergence import StrongErrors


@dataclass(frozen=True)
class Setting:
    """The last of `steps` is the reference's own."""

    figure: str
    problem: str
    T: float
    steps: tuple[int, ...]
    reference: str
    samples: int
    scheme: str = "milstein"
    stated: str = "§4.3"


def jobs(setting: Setting, size: Size) -> list[Job]:
    """The reference's scheme down to its own step, and another scheme."""
    count = size.samples(setting.samples)
    found = []
    for name in (setting.reference, setting.scheme):
        arguments = {
            "scheme": name,
            "problem": setting.problem,
            "T": setting.T,
            "steps": setting.steps,
            "samples": count,
            "first": 0,
            "seed": size.seed,
            "engine": size.engine,
        }
        seconds = count * sum(setting.steps) * COST.get(name, 0.3) * 1e-6
        found.append(Job((setting.figure, "fine", name), runs.errors, arguments, seconds))
    counting = {
        "problem": setting.problem,
        "T": setting.T,
        "steps": setting.steps,
        "samples": count,
        "seed": size.seed,
    }
    found.append(Job((setting.figure, "fine", "truncated"), runs.truncated, counting, 1.0))
    return found


def _truncation(setting: Setting, counts: list[int]) -> list[str]:
    """One truncated increment is an error of that sample that no step size explains: a bump in the curve."""
    h = [f"2^{np.log2(setting.T / n):.0f}" for n in setting.steps]
    found = [f"{n} at h = {at}" for n, at in zip(counts, h, strict=True) if n]
    return (
        [f"increments that Remark 2.1 truncates, each a bump in the curves: {', '.join(found)}"]
        if found
        else []
    )


def panel(setting: Setting, results: Results, source: str) -> Panel:
    """True errors, and errors as the fine-step reference sees them."""
    found: dict[str, StrongErrors] = {
        n: results[setting.figure, "fine", n] for n in (setting.reference, setting.scheme)
    }
    h = setting.T / np.array(setting.steps)
    truth = found[setting.reference].errors[-1]
    curves, seen = [], {}
    for name, e in found.items():
        against = np.sqrt(np.mean(np.sum((e.errors - truth) ** 2, axis=1), axis=1))
        seen[name] = against
        curves.append(series(f"{name}, exact reference", h, e.rms(), scheme=name, style="both"))
        # The reference's own scheme has error zero at its own step, which a logarithmic axis cannot show.
        kept = against > 0
        curves.append(series(f"{name}, fine-step reference", h[kept], against[kept], style="both"))
    own, true = seen[setting.reference], found[setting.reference].rms()
    share = ", ".join(
        f"{o / t:.0%} at h = 2^{np.log2(step):.0f}" for step, o, t in zip(h, own, true, strict=True)
    )
    own_step = f"2^{np.log2(h[-1]):.0f}"
    exact = Statement(
        text=f"The {setting.reference} scheme with step {own_step} serves as the exact solution",
        source=setting.stated,
        verdict=decide(bool(np.all(own > 0.95 * true)), bool(own[-1] < 0.05 * true[-1])),
        measured=f"of the true error of the {setting.reference} scheme it sees {share}",
        criterion="at least 95 % of the true error, at every step size",
        correction="the exact solution is the flow at the time t + Σ c_j W_j(t), without a step size. At the steps of "
        f"the paper's plot, well above {own_step}, the bias is small and its slopes stand",
    )
    return Panel(
        key=f"{setting.figure}-fine-step-reference",
        figure=setting.figure,
        title="What a fine-step reference hides",
        source=source,
        x=H_AXIS,
        y=ERROR_AXIS,
        series=tuple(curves),
        parameters={"problem": setting.problem, "T": setting.T, "samples": truth.shape[1], "h": h.tolist()},
        chosen=(
            f"{truth.shape[1]} samples; step sizes down to the reference's own, {own_step}, where its bias is largest",
            *_truncation(setting, results[setting.figure, "fine", "truncated"]),
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
