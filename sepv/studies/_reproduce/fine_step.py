"""The paper's own kind of reference, a scheme with a fine step, beside the exact one: its bias.

Errors against a fine-step reference are differences of two errors. Where the scheme under test is the
reference's own, or h comes near the reference's step, they are too small and the slope is too steep; at the
reference's step its scheme has no error at all.
"""

from __future__ import annotations

import numpy as np

from sepv.studies._reproduce import runs
from sepv.studies._reproduce.job import Job, Results, Size
from sepv.studies._reproduce.order import ERROR_AXIS, H_AXIS, Setting
from sepv.studies._reproduce.record import Panel, Statement, decide, series
from sepv.verification._orders.convergence import StrongErrors


def jobs(setting: Setting, size: Size) -> list[Job]:
    """The reference's scheme, the first of two, down to its own step, the last of `steps`, and the other scheme."""
    samples = range(size.samples(setting.samples))
    counting = {**setting.given, "samples": len(samples), "seed": size.seed}
    return [
        *(setting.job(("fine", name), name, samples, size, 0.3) for name in setting.schemes),
        Job((setting.figure, "fine", "truncated"), runs.truncated, counting, 1.0),
    ]


def panel(setting: Setting, results: Results, source: str, stated: str) -> Panel:
    """True errors, and errors as the fine-step reference sees them; `stated` is where the paper names it."""
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
        text=f"The {reference} scheme with step {own_step} serves as the exact solution",
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
        x=H_AXIS,
        y=ERROR_AXIS,
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
