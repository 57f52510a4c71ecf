"""Lemma 3.2, (3.5) to (3.7): the coefficients of Δ³ of (2.1) and the midpoint scheme,
and moments of the remainder.

The proof ends with "an explicit expression of c(y_n)", which is not printed. With f = B∇H, g = ∇H,
y1 = y + δ, δ = Δf + ½Δ²f′f + O(Δ³), B(y + δ/2) = B + ½B′δ + ⅛B″(δ, δ) + … and ∫g(y + τδ)dτ = g
+ ½g′δ + ⅙g″(δ, δ) + …, the terms of Δ³ in their product are

    c = ⅛ B″(f, f)g + ¼ B′(f)g′f + ⅙ B g″(f, f) + ¼ f′f′f.

The midpoint scheme, δ = Δ f(y + δ/2), has c̃ = ⅛f″(f, f) + ¼f′f′f. As f″(f, f) = B″(f, f)g
+ 2B′(f)g′f + Bg″(f, f),

    c − c̃ = (1/24) B g″(f, f).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from sepv import problems, schemes
from sepv.pictures import Axis
from sepv.problem import Array, NamedProblem, Problem, derivative_along, matvec, slope_along, vector_field
from sepv.properties import gaussian_rule as rule
from sepv.schemes import structure_curvature, structure_slope

from . import judge
from .record import Job, Panel, Results, Size, Statement, points

LEMMA_SCHEMES = ("energy-preserving", "midpoint")
LEMMA_PROBLEMS = ("rigid-body", "pendulum", "lotka-volterra")
LEMMA_STEP_SIZES = tuple(2.0**-n for n in range(4, 12))
# The step Δ of differences in extended precision, whose error is O(Δ²), about 1e-12.
DIFFERENCE_STEP = 2.0**-20
# The relative difference that is allowed for two values of c(y): differences in binary64 give c to
# about 1e-12.
AGREES = 1e-10


def coefficients(problem: Problem, y: Array) -> tuple[Array, Array]:
    """The coefficients of Δ³ in y1, c(y) of (2.1) and c̃(y) of the midpoint scheme,
    by formulas at states y (d, M).
    """
    f = vector_field(problem, y)
    g, B = problem.gradient(y), problem.structure(y)
    half = 0.5 * matvec(structure_curvature(problem, y, f), g) * 0.25
    turned = 0.25 * matvec(structure_slope(problem, y, f), _slope(problem, y, f))
    # g″(f, f), by differences of H″f
    bent = matvec(B, slope_along(lambda y: _slope(problem, y, f), y, f, 2.0**-10))
    inner = derivative_along(problem, y, f)
    c = half + turned + bent / 6 + 0.25 * derivative_along(problem, y, inner)
    return np.asarray(c), np.asarray(c - bent / 24)


def _slope(problem: Problem, y: Array, w: Array) -> Array:
    """The derivative g′(y)w = H″(y)w of the gradient g = ∇H in directions w, at states y (d, M)."""
    assert problem.hessian is not None
    return matvec(problem.hessian(y), w)


def expanded(scheme: str, data: NamedProblem, y: Array) -> Array:
    """The coefficient c of Δ³ in y1(Δ) of a scheme, from steps ±Δ and ±Δ/2 with 60 digits.

    Let D(Δ) = y1(Δ) − y1(−Δ). Then D(Δ) − 2D(Δ/2) = (3/2) cΔ³ + O(Δ⁵).
    """
    from sepv.reference.steps import reference_step

    noise = [0.0] * len(dict(data.parameters)["noise"])

    def odd(delta: float) -> list[Any]:
        ahead, behind = (reference_step(scheme, data, y.tolist(), s * delta, noise, 60).y1 for s in (1, -1))
        return [a - b for a, b in zip(ahead, behind, strict=True)]

    whole, halves = odd(DIFFERENCE_STEP), odd(DIFFERENCE_STEP / 2)
    return np.array(
        [float((a - 2 * b) / (1.5 * DIFFERENCE_STEP**3)) for a, b in zip(whole, halves, strict=True)]
    )


def measured(problem: str) -> dict[str, dict[str, Any]]:
    """The coefficients of Δ³ in y1 at one state, by formula and by small steps,
    and the moments of the remainder.
    """
    system = problems.by_name(problem)
    assert isinstance(system.data, NamedProblem)
    y = (1.1 * np.array(system.initial) + 0.05)[:, None]
    a = vector_field(system, y)
    b = 0.5 * derivative_along(system, y, a)
    moments = {}
    for name, c in zip(LEMMA_SCHEMES, coefficients(system, y), strict=True):
        mean, rms = [], []
        for h in LEMMA_STEP_SIZES:
            nodes = rule(system.noises, h, 2, 12)
            dW = np.sqrt(h) * nodes.zeta[:, nodes.index]
            start = np.repeat(y, dW.shape[1], axis=1)
            delta = system.random_step(h, dW)
            moved = schemes.PAPER[name].step(system, start, h, dW) - start
            size = np.sqrt(np.sum((moved - a * delta - b * delta**2 - c * delta**3) ** 2, axis=0))
            mean.append(float(size @ nodes.weights))
            rms.append(float(np.sqrt(size**2 @ nodes.weights)))
        expansion = expanded(name, system.data, y[:, 0])
        moments[name] = {
            "formula": c[:, 0].tolist(),
            "expansion": expansion.tolist(),
            "mean": mean,
            "rms": rms,
        }
    return moments


def jobs(_size: Size) -> list[Job]:
    """The jobs: one for each problem. No job is random,
    so that none depends on the size of the reproduction.
    """
    return [Job(("theory", "lemma", name), measured, {"problem": name}, 1.0) for name in LEMMA_PROBLEMS]


def panels(results: Results) -> list[Panel]:
    """The panel of moments of R_n and R̃_n, the remainders after Δ³ of (2.1)
    and the midpoint scheme, against h.
    """
    moments = {name: results["theory", "lemma", name] for name in LEMMA_PROBLEMS}
    return [Panel(
        key="theory-lemma-3.2", title="What the expansions (3.1) and (3.5) leave", source="Lemma 3.2, (3.2), (3.5)",
        y=Axis("moments of R_n", log=True),
        series=tuple(
            points(f"{name}, {label}", LEMMA_STEP_SIZES, one[LEMMA_SCHEMES[0]][kind])
            for name, one in moments.items() for kind, label in (("mean", "E‖R‖"), ("rms", "(E‖R‖²)^½"))
        ),
        parameters={"k": 2, "h": list(LEMMA_STEP_SIZES)}, chosen=("one step from 1.1 y0 + 0.05",), slopes=(2.0,),
        statements=tuple(s for name, one in moments.items() for s in _statements(name, one)),
        description="Both moments fall along slope two.", numbers=moments,
    )]  # fmt: skip


def _statements(name: str, moments: dict[str, dict[str, Any]]) -> Iterator[Statement]:
    """Statements on the coefficients of Δ³ in y1, by formula and by small steps,
    and on the remainder's orders.
    """
    values = {kind: [np.array(moments[n][kind]) for n in LEMMA_SCHEMES] for kind in ("formula", "expansion")}
    size = max(np.max(np.abs(one)) for one in values["expansion"])
    ours, theirs = (a - b for a, b in zip(*values.values(), strict=True))
    both = np.subtract(*values["formula"]) - np.subtract(*values["expansion"])
    cases = (
        (
            "c(y_n) in (3.1) depends on y_n only",
            "Lemma 3.2",
            "⅛B″(f,f)g + ¼B′(f)g′f + ⅙Bg″(f,f) + ¼f′f′f",
            ours,
        ),
        ("c̃(y_n) in (3.5) depends on y_n only", "(3.5)", "⅛f″(f,f) + ¼f′f′f", theirs),
        ("(ours) c − c̃ in (3.6) is Bg″(f,f)/24", "(3.6)", "Bg″(f,f)/24", both),
    )
    for text, source, formula, gap in cases:
        apart = float(np.max(np.abs(gap)) / size)
        yield Statement(
            f"{text} ({name})", source, judge.at_most(apart, AGREES, 1e3 * AGREES),
            f"{formula} and the expansion at 60 digits differ by {apart:.1e}",
            f"a difference of at most {AGREES:g} of c: differences of B and H″ in binary64",
        )  # fmt: skip
    for scheme, letter, source in zip(LEMMA_SCHEMES, ("R_n", "R̃_n"), ("(3.2)", "after (3.5)"), strict=True):
        # The finest pair of steps is taken, because the next term of the remainder is smaller by
        # the factor √h only.
        mean, rms = (
            float(np.log2(moments[scheme][kind][-2] / moments[scheme][kind][-1])) for kind in ("mean", "rms")
        )
        yield Statement(
            f"E‖{letter}‖ = O(h²) and (E‖{letter}‖²)^½ = O(h²) ({name})", source,
            judge.every(judge.above(mean, 1.75, 1.5), judge.above(rms, 1.75, 1.5)),
            f"slopes {mean:.2f} and {rms:.2f} at h = 2^-10 to 2^-11, by quadrature over ΔŴ",
            "slopes above 7/4, half-way to the next lower half-integer",
        )  # fmt: skip
