"""Checks of (3.8) and (3.9): mean and rms of the difference of two schemes after one step,
by quadrature over ΔŴ.

The paper compares (2.1) with the midpoint scheme. Milstein's Lemma 2.1 of [16] has the same
conditions for a scheme and the exact solution. Given y_n, both differences are integrals over ΔŴ,
and no sampling is needed.
"""

from __future__ import annotations

import numpy as np

from sepv import problems, schemes
from sepv.law import Run
from sepv.pictures import Axis
from sepv.properties import gaussian_rule as rule
from sepv.properties import local_errors

from . import judge
from .record import SENTENCE, STATED_ORDERS, Job, Panel, Results, Size, Statement, points

LOCAL_PROBLEM = "pendulum"
LOCAL_STEP_SIZES = tuple(2.0**-n for n in range(5, 16))
# For mean-square order p the lemma demands the exponents p1 ≥ p + 1 of the mean and p2 = p + 1/2 of
# the mean square. The schemes here have p1 = 2, as in (3.8). EXPONENT_MARGIN = 1/4 is half-way to
# the next lower half-integer.
EXPONENT_MARGIN = 0.25


def difference() -> dict[str, list[float]]:
    """The sizes ‖E[y1 − ỹ1]‖ and (E‖y1 − ỹ1‖²)^½, for y1 by (2.1)
    and ỹ1 by the midpoint scheme from one state.
    """
    system = problems.by_name(LOCAL_PROBLEM)
    y = np.array(system.initial)
    mean, rms = [], []
    for h in LOCAL_STEP_SIZES:
        nodes = rule(system.noises, h, 2, 10)
        dW = np.sqrt(h) * nodes.zeta[:, nodes.index]
        start = np.repeat(y[:, None], dW.shape[1], axis=1)
        ours, theirs = (s.step(system, start, h, dW) for s in (schemes.energy_preserving, schemes.midpoint))
        gap = ours - theirs
        mean.append(float(np.linalg.norm(gap @ nodes.weights)))
        rms.append(float(np.sqrt(np.sum(gap * gap, axis=0) @ nodes.weights)))
    return {"h": list(LOCAL_STEP_SIZES), "mean": mean, "rms": rms}


def against_exact(scheme: str) -> dict[str, list[float]]:
    """Mean and rms error of one step of a scheme against the exact solution,
    the largest over a few states.
    """
    errors = local_errors(schemes.PAPER[scheme], problems.by_name(LOCAL_PROBLEM), Run())
    return {"h": errors.h.tolist(), "mean": errors.mean.tolist(), "rms": errors.rms.tolist()}


def jobs(_size: Size) -> list[Job]:
    """The jobs: one for each scheme. No job is random,
    so that none depends on the size of the reproduction.
    """
    listed = [Job(("theory", "local", name), against_exact, {"scheme": name}, 0.5) for name in STATED_ORDERS]
    return [*listed, Job(("theory", "local", ""), difference, {}, 0.2)]


def _of_the_paper(pair: dict[str, list[float]]) -> tuple[Statement, ...]:
    """Statements (3.8) and (3.9), on (2.1) against the midpoint scheme,
    and a moment from the proof of Theorem 3.3.
    """
    mean, rms = (judge.finest_slope(pair["h"], pair[kind]) for kind in ("mean", "rms"))
    # (E[(h + cΔŴ)¹²])^¼ with c = 1, which the proof takes out of (3.6) by Cauchy and Schwarz.
    moments = []
    for h in LOCAL_STEP_SIZES:
        nodes = rule(1, h, 2, 12)
        delta = h + np.sqrt(h) * nodes.zeta[0, nodes.index]
        moments.append(float((delta**12 @ nodes.weights) ** 0.25))
    moment, given = judge.finest_slope(LOCAL_STEP_SIZES, moments), f"on the {LOCAL_PROBLEM}, given y_n = y_0"
    return (
        Statement("E[y_{n+1} − ỹ_{n+1}] = O(h²) for (2.1) and the midpoint scheme", "(3.8)",
                  judge.above(mean, 2 - EXPONENT_MARGIN, 2 - 2 * EXPONENT_MARGIN),
                  f"slope {mean:.2f} {given}", f"above {2 - EXPONENT_MARGIN:g}"),
        Statement("(E‖y_{n+1} − ỹ_{n+1}‖²)^½ = O(h^{3/2}) for (2.1) and the midpoint scheme", "(3.9)",
                  judge.above(rms, 1.5 - EXPONENT_MARGIN, 1.5 - 2 * EXPONENT_MARGIN),
                  f"slope {rms:.2f} {given}", f"above {1.5 - EXPONENT_MARGIN:g}"),
        Statement("(E[(h + cΔŴ)¹²])^¼ = O(h^{3/2})", "proof of Theorem 3.3",
                  judge.near(moment, 1.5, EXPONENT_MARGIN / 4, EXPONENT_MARGIN),
                  f"slope {moment:.3f}, c = 1, k = 2", f"within {EXPONENT_MARGIN / 4:g} of 3/2"),
    )  # fmt: skip


def _of_a_scheme(name: str, mean: float, rms: float) -> Statement:
    """The statement that a scheme of order p meets Lemma 2.1 of [16]: mean error O(h^(p+1)),
    rms error O(h^(p+½)).
    """
    p = STATED_ORDERS[name]
    p1, p2 = p + 1 - EXPONENT_MARGIN, p + 0.5 - EXPONENT_MARGIN
    return Statement(
        f"{SENTENCE[name]} satisfies the local conditions for mean-square order {p:g}",
        "Lemma 2.1 of [16], as (3.8) and (3.9)",
        judge.every(judge.above(mean, p1, p1 - EXPONENT_MARGIN), judge.above(rms, p2, p2 - EXPONENT_MARGIN)),
        f"slopes {mean:.2f} and {rms:.2f} against the exact solution", f"above {p1:g} and {p2:g}",
    )  # fmt: skip


def panels(results: Results) -> list[Panel]:
    """The panel of the mean and rms error of one step of every scheme, with their slopes
    against h.
    """
    errors = {name: results["theory", "local", name] for name in STATED_ORDERS}
    pair = results["theory", "local", ""]
    slopes = {n: [judge.finest_slope(e["h"], e[kind]) for kind in ("mean", "rms")] for n, e in errors.items()}
    return [Panel(
        key="theory-local-conditions", title="One step: (3.8) and (3.9)", source="(3.8), (3.9)",
        y=Axis("error of one step", log=True),
        series=tuple(
            points(f"{n}, {label}", e["h"], e[kind], n)
            for n, e in errors.items() for kind, label in (("mean", "mean"), ("rms", "mean-square"))
        ),
        parameters={"problem": LOCAL_PROBLEM, "k": 2}, slopes=(1.0, 1.5, 2.0),
        statements=(*_of_the_paper(pair), *(_of_a_scheme(name, *both) for name, both in slopes.items())),
        description="Mean errors fall along slope two, mean-square errors along 3/2, and along one for Euler-Maruyama.",
        numbers={n: {**e, "slopes": slopes[n]} for n, e in errors.items()} | {"(2.1) and midpoint": pair},
    )]  # fmt: skip
