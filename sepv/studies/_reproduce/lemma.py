"""Lemma 3.2: the coefficient c(y) of Δ³ in the expansion of (2.1), and the moments (3.2) of what is left, R_n.

The proof ends with "an explicit expression of c(y_n)", which is not printed. With f = B∇H, g = ∇H, y1 = y + δ,
δ = Δf + ½Δ²f′f + O(Δ³), B(y + δ/2) = B + ½B′δ + ⅛B″(δ, δ) + … and ∫g(y + τδ)dτ = g + ½g′δ + ⅙g″(δ, δ) + …, the terms of
Δ³ in their product are

    c = ⅛ B″(f, f)g + ¼ B′(f)g′f + ⅙ B g″(f, f) + ¼ f′f′f.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from sepv import problems, schemes
from sepv.problem import Array, NamedProblem, Problem, vector_field
from sepv.problem._fields import derivative_along, matvec, slope_along
from sepv.schemes._modified_weak_two import structure_curvature, structure_slope
from sepv.studies._picture import Axis
from sepv.studies._reproduce.record import Job, Panel, Results, Size, Statement, decide, series
from sepv.verification._orders.gaussian import rule

NAMES = ("rigid-body", "pendulum", "lotka-volterra")
H_STEPS = tuple(2.0**-n for n in range(4, 12))
# Δ of the differences in extended precision: what they leave is O(Δ²), 1e-12.
SHORT = 2.0**-20
# Relative difference of both values of c(y): differences of B and H″ in binary64 know it to about 1e-12.
AGREES = 1e-10


def coefficient(problem: Problem, y: Array) -> Array:
    """c(y) (d,) by the formula above."""
    at, f = y[:, None], vector_field(problem, y)[:, None]
    g, B = problem.gradient(at), problem.structure(at)
    half = 0.5 * matvec(structure_curvature(problem, at, f), g) * 0.25
    turned = 0.25 * matvec(structure_slope(problem, at, f), _slope(problem, at, f))
    curvature = slope_along(
        lambda y: _slope(problem, y, f), at, f, 2.0**-10
    )  # g″(f, f), by differences of H″f
    bent = matvec(B, curvature) / 6
    inner = derivative_along(problem, at, f)
    return np.asarray((half + turned + bent + 0.25 * derivative_along(problem, at, inner))[:, 0])


def _slope(problem: Problem, y: Array, w: Array) -> Array:
    """g′w."""
    assert problem.hessian is not None
    return matvec(problem.hessian(y), w)


def expanded(data: NamedProblem, y: Array) -> Array:
    """c(y) from steps ±Δ and ±Δ/2 at 60 digits: D(Δ) − 2D(Δ/2) = 3/2 cΔ³ + O(Δ⁵), D(Δ) = y1(Δ) − y1(−Δ)."""
    from sepv.reference.steps import reference_step

    noise = [0.0] * len(dict(data.parameters)["noise"])

    def odd(delta: float) -> list[Any]:
        ahead, behind = (
            reference_step("energy-preserving", data, y.tolist(), s * delta, noise, 60).y1 for s in (1, -1)
        )
        return [a - b for a, b in zip(ahead, behind, strict=True)]

    whole, halves = odd(SHORT), odd(SHORT / 2)
    return np.array([float((a - 2 * b) / (1.5 * SHORT**3)) for a, b in zip(whole, halves, strict=True)])


def measured(problem: str) -> dict[str, Any]:
    """c(y) by both ways at a state of the problem, and the moments of R_n by quadrature over ΔŴ."""
    system = problems.by_name(problem)
    assert isinstance(system.data, NamedProblem)
    y = 1.1 * np.array(system.initial) + 0.05
    c = coefficient(system, y)
    a, b = vector_field(system, y), 0.5 * derivative_along(system, y, vector_field(system, y))
    mean, rms = [], []
    for h in H_STEPS:
        nodes = rule(system.noises, h, 2, 12)
        dW = np.sqrt(h) * nodes.zeta[:, nodes.index]
        start = np.repeat(y[:, None], dW.shape[1], axis=1)
        moved = schemes.energy_preserving.step(system, start, h, dW) - start
        delta = system.random_step(h, dW)
        R = moved - a[:, None] * delta - b[:, None] * delta**2 - c[:, None] * delta**3
        size = np.sqrt(np.sum(R * R, axis=0))
        mean.append(float(size @ nodes.weights))
        rms.append(float(np.sqrt(size**2 @ nodes.weights)))
    return {"formula": c.tolist(), "expansion": expanded(system.data, y).tolist(), "mean": mean, "rms": rms}


def jobs(_size: Size) -> list[Job]:
    """One job a problem; nothing is random."""
    return [Job(("theory", "lemma", name), measured, {"problem": name}, 1.0) for name in NAMES]


def panels(results: Results) -> list[Panel]:
    """E‖R_n‖ and (E‖R_n‖²)^½ against h."""
    found = {name: results["theory", "lemma", name] for name in NAMES}
    statements = []
    for name, one in found.items():
        expansion = np.array(one["expansion"])
        gap = float(np.max(np.abs(one["formula"] - expansion)) / np.max(np.abs(expansion)))
        # The finest pair of steps: the next term of R_n is a factor √h of the first.
        slopes = [float(np.log2(one[kind][-2] / one[kind][-1])) for kind in ("mean", "rms")]
        statements += [
            Statement(
                text=f"c(y_n) in (3.1) depends on y_n only ({name})",
                source="Lemma 3.2",
                verdict=decide(gap < AGREES, gap > 1e3 * AGREES),
                measured="⅛B″(f,f)g + ¼B′(f)g′f + ⅙Bg″(f,f) + ¼f′f′f and the expansion at 60 digits differ by "
                f"{gap:.1e}",
                criterion=f"a relative difference of at most {AGREES:g}: differences of B and H″ in binary64",
            ),
            Statement(
                text=f"E‖R_n‖ = O(h²) and (E‖R_n‖²)^½ = O(h²) ({name})",
                source="(3.2)",
                verdict=decide(min(slopes) > 1.75, min(slopes) < 1.5),
                measured=f"slopes {slopes[0]:.2f} and {slopes[1]:.2f} at h = 2^-10 to 2^-11, by quadrature over ΔŴ",
                criterion="slopes above 7/4, half-way to the next lower half-integer",
            ),
        ]
    return [
        Panel(
            key="theory-lemma-3.2",
            title="What the expansion (3.1) leaves",
            source="Lemma 3.2, (3.2)",
            y=Axis("moments of R_n", log=True),
            series=tuple(
                series(f"{name}, {label}", H_STEPS, one[kind], style="both")
                for name, one in found.items()
                for kind, label in (("mean", "E‖R‖"), ("rms", "(E‖R‖²)^½"))
            ),
            parameters={"k": 2, "h": list(H_STEPS)},
            chosen=("one step from 1.1 y0 + 0.05",),
            slopes=(2.0,),
            statements=tuple(statements),
            description="Both moments fall along slope two.",
            numbers=found,
        )
    ]


PANELS = {"theory": panels}
