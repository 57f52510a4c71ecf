"""(3.8) and (3.9): the mean and the mean-square difference of one step, by quadrature over the increments.

The paper compares (2.1) with the midpoint scheme; Milstein's Lemma 2.1 of [16] asks the same of a scheme and the exact
solution. Both are integrals over ΔŴ given y_n, and no sampling is needed.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from sepv import problems, schemes
from sepv.record._binary64 import EPS
from sepv.studies._picture import Axis
from sepv.studies._reproduce import record
from sepv.studies._reproduce.record import Job, Panel, Results, Size, Statement, decide, series
from sepv.verification import Run
from sepv.verification._orders.gaussian import rule
from sepv.verification._orders.local_errors import local_errors

PROBLEM = "pendulum"
H_STEPS = tuple(2.0**-n for n in range(5, 16))
# Exponents that the lemma asks for mean-square order p: p1 = p + 1/2 at least and p2 = p + 1/2. The schemes here have
# the p1 = 2 of (3.8); 1/4 is half-way to the next lower half-integer.
MARGIN = 0.25


def difference() -> dict[str, list[float]]:
    """‖E[y1 − ỹ1]‖ and (E‖y1 − ỹ1‖²)^½ of (2.1) and the midpoint scheme from the problem's initial state."""
    system = problems.by_name(PROBLEM)
    y = np.array(system.initial)
    mean, rms = [], []
    for h in H_STEPS:
        nodes = rule(system.noises, h, 2, 10)
        dW = np.sqrt(h) * nodes.zeta[:, nodes.index]
        start = np.repeat(y[:, None], dW.shape[1], axis=1)
        ours, theirs = (s.step(system, start, h, dW) for s in (schemes.energy_preserving, schemes.midpoint))
        gap = ours - theirs
        mean.append(float(np.linalg.norm(gap @ nodes.weights)))
        rms.append(float(np.sqrt(np.sum(gap * gap, axis=0) @ nodes.weights)))
    return {"h": list(H_STEPS), "mean": mean, "rms": rms}


def against_exact(scheme: str) -> dict[str, list[float]]:
    """The same of a scheme and the exact solution: the largest over a few states."""
    found = local_errors(schemes.PAPER[scheme], problems.by_name(PROBLEM), Run())
    return {"h": found.h.tolist(), "mean": found.mean.tolist(), "rms": found.rms.tolist()}


def jobs(_size: Size) -> list[Job]:
    """One job a scheme; nothing is random."""
    found = [Job(("theory", "local", name), against_exact, {"scheme": name}, 0.5) for name in record.STATED]
    return [*found, Job(("theory", "local", ""), difference, {}, 0.2)]


def _slope(h: list[float], errors: list[float]) -> float:
    """Between the two finest steps at which the error is 10⁴ roundings of y, |y| ≈ 1, or more."""
    kept = [n for n, e in enumerate(errors) if e > 1e4 * EPS]
    first, last = kept[-2:]
    return float(np.log(errors[first] / errors[last]) / np.log(h[first] / h[last]))


def _of_the_pair(pair: dict[str, list[float]]) -> Iterator[Statement]:
    """(3.8) and (3.9), of the energy-preserving scheme beside the midpoint scheme."""
    for kind, label, source, asked in (
        ("mean", "E[y_{n+1} − ỹ_{n+1}] = O(h²)", "(3.8)", 2.0),
        ("rms", "(E‖y_{n+1} − ỹ_{n+1}‖²)^½ = O(h^{3/2})", "(3.9)", 1.5),
    ):
        seen = _slope(pair["h"], pair[kind])
        yield Statement(
            text=f"{label} for (2.1) and the midpoint scheme",
            source=source,
            verdict=decide(seen > asked - MARGIN, seen < asked - 2 * MARGIN),
            measured=f"slope {seen:.2f} on the {PROBLEM}, given y_n = y_0",
            criterion=f"above {asked - MARGIN:g}",
        )


def _of_the_moment() -> Statement:
    """(E[(h + cΔŴ)¹²])^¼ with c = 1, which the proof of Theorem 3.3 takes out of (3.6) by Cauchy and Schwarz."""
    moments = []
    for h in H_STEPS:
        nodes = rule(1, h, 2, 12)
        delta = h + np.sqrt(h) * nodes.zeta[0, nodes.index]
        moments.append(float((delta**12 @ nodes.weights) ** 0.25))
    seen = _slope(list(H_STEPS), moments)
    return Statement(
        text="(E[(h + cΔŴ)¹²])^¼ = O(h^{3/2})",
        source="proof of Theorem 3.3",
        verdict=decide(abs(seen - 1.5) < MARGIN / 4, abs(seen - 1.5) > MARGIN),
        measured=f"slope {seen:.3f}, c = 1, k = 2",
        criterion=f"within {MARGIN / 4:g} of 3/2",
    )


def _of_a_scheme(name: str, mean: float, rms: float) -> Statement:
    """Lemma 2.1 of [16]: p2 = p + ½ and p1 ≥ p2 + ½."""
    p = record.STATED[name]
    return Statement(
        text=f"{record.SENTENCE[name]} satisfies the local conditions for mean-square order {p:g}",
        source="Lemma 2.1 of [16], as (3.8) and (3.9)",
        verdict=decide(
            mean > p + 1 - MARGIN and rms > p + 0.5 - MARGIN,
            mean < p + 1 - 2 * MARGIN or rms < p + 0.5 - 2 * MARGIN,
        ),
        measured=f"slopes {mean:.2f} and {rms:.2f} against the exact solution",
        criterion=f"above {p + 1 - MARGIN:g} and {p + 0.5 - MARGIN:g}",
    )


def panels(results: Results) -> list[Panel]:
    """One panel: both errors of every scheme, with their slopes."""
    found = {name: results["theory", "local", name] for name in record.STATED}
    pair = results["theory", "local", ""]
    slopes = {n: (_slope(e["h"], e["mean"]), _slope(e["h"], e["rms"])) for n, e in found.items()}
    statements = [
        *_of_the_pair(pair),
        _of_the_moment(),
        *(_of_a_scheme(name, *both) for name, both in slopes.items()),
    ]
    return [
        Panel(
            key="theory-local-conditions",
            title="One step: (3.8) and (3.9)",
            source="(3.8), (3.9)",
            y=Axis("error of one step", log=True),
            series=tuple(
                series(f"{n}, {label}", e["h"], e[kind], scheme=n, style="both")
                for n, e in found.items()
                for kind, label in (("mean", "mean"), ("rms", "mean-square"))
            ),
            parameters={"problem": PROBLEM, "k": 2},
            slopes=(1.0, 1.5, 2.0),
            statements=tuple(statements),
            description="Mean errors fall along slope two, mean-square errors along 3/2, and along one for "
            "Euler-Maruyama.",
            numbers={n: {**e, "slopes": list(slopes[n])} for n, e in found.items()}
            | {"(2.1) and midpoint": pair},
        )
    ]


PANELS = {"theory": panels}
