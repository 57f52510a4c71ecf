"""Questions that §1 and §5 leave open: Lévy areas for noises that do not commute, several stages,
weak order.
"""

from __future__ import annotations

import numpy as np

from sepv import problems, schemes
from sepv.law import Run
from sepv.pictures import Axis
from sepv.problem import Array, Problem, combined, each_noise, matvec
from sepv.properties import local_errors
from sepv.record import EPS
from sepv.schemes import weakly
from sepv.simulate import wiener

from . import judge
from .record import Job, Panel, Results, Size, Statement, points
from .several_stages import step_with_stages
from .several_with_areas import step_with_areas

TOPS_PROBLEM, TOPS_T, TOPS_STEPS, TOPS_FINE_STEPS, TOPS_SAMPLES = (
    "noncommuting-tops",
    0.5,
    (4, 8, 16, 32, 64),
    4096,
    400,
)
STAGE_COUNTS, STAGE_STEPS, STAGE_SAMPLES = (1, 2, 3), (2, 4, 8, 16), 48
WEAK = ("energy-preserving", "midpoint", "modified-weak-2")
# Pairs of a scheme and increments of two or three points, with the weak order of the pair.
POINT_PAIRS = (
    ("energy-preserving", "two-point", 1.0),
    ("modified-weak-2", "two-point", 1.0),
    ("modified-weak-2", "three-point", 2.0),
)


def areas(fine: Array, steps: int) -> Array:
    """Lévy areas ½∫(W_i dW_j − W_j dW_i), (N, m, m, M), over N = `steps` steps,
    for W linear between fine steps.
    """
    parts = fine.reshape(steps, -1, *fine.shape[1:])
    before = np.cumsum(parts, axis=1) - parts
    product = np.einsum("nkim,nkjm->nijm", before, parts)
    return np.asarray(0.5 * (product - np.swapaxes(product, 1, 2)))


def heun(problem: Problem, y0: Array, T: float, dW: Array) -> Array:
    """Solve the Stratonovich equation by Heun's method with increments dW (N, m, M),
    and return y(T) (d, M).

    A step is y ← y + ½(F(y) + F(ŷ)) with ŷ = y + F(y) and F = [h B + Σ c_j ΔW_j G_j]∇H.
    """

    def field(y: Array, parts: Array) -> Array:
        return matvec(combined(problem, y, parts), problem.gradient(y))

    y = np.repeat(y0[:, None], dW.shape[2], axis=1)
    for increment in dW:
        parts = each_noise(problem, T / len(dW), increment)
        slope = field(y, parts)
        y = y + 0.5 * (slope + field(y + slope, parts))
    return y


def errors(samples: int, seed: int) -> dict[str, list[float]]:
    """Rms errors at T without and with Lévy areas, against Heun's method with fine steps,
    and energy errors.
    """
    problem = problems.by_name(TOPS_PROBLEM)
    start = np.array(problem.initial)
    fine = wiener.increments(
        seed, T=TOPS_T, steps=TOPS_FINE_STEPS, noises=problem.noises, paths=range(samples)
    )
    exact = heun(problem, start, TOPS_T, fine)
    errors: dict[str, list[float]] = {"without": [], "with": [], "energy": []}
    for steps in TOPS_STEPS:
        dW, A = wiener.coarsen(fine, TOPS_FINE_STEPS // steps), areas(fine, steps)
        plain = corrected = np.repeat(start[:, None], samples, axis=1)
        for n in range(steps):
            plain = schemes.several_structures.step(problem, plain, TOPS_T / steps, dW[n])
            corrected = step_with_areas(problem, corrected, TOPS_T / steps, dW[n], A[n])
        for key, y in (("without", plain), ("with", corrected)):
            errors[key].append(float(np.sqrt(np.mean(np.sum((y - exact) ** 2, axis=0)))))
        energy = problem.hamiltonian(corrected) - problem.hamiltonian(start)
        errors["energy"].append(float(np.max(np.abs(energy))))
    return errors


def staged(stages: int, samples: int, seed: int) -> list[float]:
    """Rms errors at T of the s-stage collocation method for noises whose flows commute,
    against the closed form.
    """
    problem = problems.commuting_rotations()
    start = np.array(problem.initial)
    fine = wiener.increments(
        seed, T=TOPS_T, steps=STAGE_STEPS[-1], noises=problem.noises, paths=range(samples)
    )
    assert problem.closed_form is not None
    exact, errors = problem.closed_form(start, TOPS_T, fine.sum(axis=0)), []
    for steps in STAGE_STEPS:
        y = np.repeat(start[:, None], samples, axis=1)
        for dW in wiener.coarsen(fine, STAGE_STEPS[-1] // steps):
            y = step_with_stages(problem, stages, y, TOPS_T / steps, dW)
        errors.append(float(np.sqrt(np.mean(np.sum((y - exact) ** 2, axis=0)))))
    return errors


def weak(scheme: str, increments: str | None = None) -> dict[str, list[float]]:
    """The largest error of E g(y1) over polynomials g and states,
    for one step of the pendulum with each h.
    """
    method = weakly(schemes.by_name(scheme), increments)
    local = local_errors(method, problems.by_name("pendulum"), Run())
    return {"h": local.h.tolist(), "weak": local.weak.tolist()}


def jobs(size: Size) -> list[Job]:
    """The jobs: errors at T with and without Lévy areas, errors at T for several stages,
    weak errors of one step.
    """
    arguments, few = {"samples": size.samples(TOPS_SAMPLES), "seed": size.seed}, {"samples": STAGE_SAMPLES}
    return [
        Job(("theory", "areas"), errors, arguments, 6.0),
        *(
            Job(("theory", "stages", str(s)), staged, {"stages": s, **arguments, **few}, 5.0)
            for s in STAGE_COUNTS
        ),
        *(Job(("theory", "weak", name), weak, {"scheme": name}, 0.5) for name in WEAK),
        *(
            Job(("theory", "weak", f"{name}, {law}"), weak, {"scheme": name, "increments": law}, 0.5)
            for name, law, _ in POINT_PAIRS
        ),
    ]


def panels(results: Results) -> list[Panel]:
    """The panels on Lévy areas, on several stages, and on the weak order."""
    return [
        _areas(results["theory", "areas"]),
        _staged({s: results["theory", "stages", str(s)] for s in STAGE_COUNTS}),
        _weak(
            {n: results["theory", "weak", n] for n in (*WEAK, *(f"{n}, {law}" for n, law, _ in POINT_PAIRS))}
        ),
    ]


def _areas(errors: dict[str, list[float]]) -> Panel:
    h = TOPS_T / np.array(TOPS_STEPS)
    slopes = {key: judge.slope(h, errors[key]) for key in ("without", "with")}
    energy, limit = max(errors["energy"]), 64 * EPS
    without = judge.near(slopes["without"], 0.5, 0.25, np.inf)
    statement = Statement(
        "(ours) With Lévy areas the energy-preserving scheme for several structures has mean-square order 1 "
        "where the noises do not commute, and ½ without; H is kept",
        "§1: energy-preserving schemes for several structures",
        judge.every(judge.near(slopes["with"], 1, 0.25, 0.5), without, judge.at_most(energy, limit, 1e3 * limit)),
        f"slopes {slopes['with']:.2f} and {slopes['without']:.2f}, largest energy defect {energy:.1e}",
        f"slopes within ¼ of 1 and ½; energy within {limit:.0e}, a rounding for each of 64 steps",
    )  # fmt: skip
    return Panel(
        key="theory-areas", title="Noises that do not commute, with and without areas", source="§1",
        series=(points("increments only", h, errors["without"]), points("increments and areas", h, errors["with"])),
        parameters={"problem": TOPS_PROBLEM, "T": TOPS_T, "N": list(TOPS_STEPS)}, slopes=(0.5, 1.0),
        chosen=(f"areas of the polygon with {TOPS_FINE_STEPS} steps, on which Heun's method serves as the reference",),
        statements=(statement,), numbers={**errors, "slopes": slopes},
        description="Without areas the errors fall along slope one half, with areas along slope one.",
    )  # fmt: skip


def _staged(errors_by_stages: dict[int, list[float]]) -> Panel:
    h = TOPS_T / np.array(STAGE_STEPS)
    slopes = {s: judge.slope(h, e) for s, e in errors_by_stages.items()}
    statement = Statement(
        "(ours) The order can be raised with several structures too, where all flows commute: s stages, order s",
        "§5; §1: energy-preserving schemes for several structures",
        judge.decide(all(abs(v - s) < 0.35 for s, v in slopes.items()), any(v < s - 0.5 for s, v in slopes.items())),
        ", ".join(f"s = {s}: slope {v:.2f}" for s, v in slopes.items()),
        f"within 0.35 of s: {STAGE_SAMPLES} samples give a slope over a factor of 8 in h to about 0.2",
    )  # fmt: skip
    return Panel(
        key="theory-several-stages", title="Several structures, commuting flows, s stages", source="§1, §5",
        series=tuple(points(f"s = {s}", h, e) for s, e in errors_by_stages.items()),
        parameters={"problem": "commuting-rotations", "T": TOPS_T, "N": list(STAGE_STEPS)}, slopes=(1.0, 2.0, 3.0),
        chosen=("increments are not truncated",), statements=(statement,),
        description="Errors fall with a slope that is the number of stages.",
        numbers={f"s = {s}": {"errors": e, "slope": slopes[s]} for s, e in errors_by_stages.items()},
    )  # fmt: skip


def _weak(errors: dict[str, dict[str, list[float]]]) -> Panel:
    slopes = {name: judge.finest_slope(e["h"], e["weak"]) for name, e in errors.items()}
    ours, theirs, modified = (slopes[name] for name in WEAK)
    few = {(name, law): slopes[f"{name}, {law}"] for name, law, _ in POINT_PAIRS}
    enough = (judge.above(v, q + 0.75, q + 0.5) for v, (*_, q) in zip(few.values(), POINT_PAIRS, strict=True))
    too_few = judge.decide(few["modified-weak-2", "two-point"] < 2.25, False)
    statements = (
        Statement("The weak order of the scheme is the same as that of the midpoint method", "§5",
                  judge.near(ours, theirs, 0.25, 0.5),
                  f"errors of E g after one step fall with slopes {ours:.2f} and {theirs:.2f}: weak order 1 for both",
                  "slopes that differ by less than ¼, by quadrature over ΔŴ"),
        Statement("The techniques of [1] may be used to construct high weak order based on the scheme (2.1)", "§5",
                  judge.above(modified, 2.75, 2.5),
                  "(2.1) with a modified structure matrix, which keeps H and quadratic Casimirs: slope "
                  f"{modified:.2f}, weak order 2", "above 2¾"),
        Statement("(ours) Two-point increments do for weak order 1, three-point ones for weak order 2, for which two "
                  "points are too few", "§5; [1]", judge.every(*enough, too_few),
                  ", ".join(f"{n} with {law} increments: slope {v:.2f}" for (n, law), v in few.items()),
                  "above q + ¾, and below 2¼ where two points are too few; sums over the points, exact"),
    )  # fmt: skip
    return Panel(
        key="theory-weak-order", title="One step: errors of expectations", source="§5",
        y=Axis("largest error of E g after one step", log=True),
        series=tuple(points(n, errors[n]["h"], errors[n]["weak"], n) for n in WEAK),
        parameters={"problem": "pendulum", "k": 2}, slopes=(2.0, 3.0), statements=statements,
        chosen=("g: all monomials up to degree 3, powers of linear forms up to twice the weak order plus one",),
        description="Energy-preserving and midpoint scheme fall along slope two, the modified one along slope three.",
        numbers={n: {**e, "slope": slopes[n]} for n, e in errors.items()},
    )  # fmt: skip
