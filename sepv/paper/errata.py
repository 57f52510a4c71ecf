"""Sentences of the paper that do not hold as printed, as data: the passage, the right statement,
and evidence.

An entry quotes its sentence together with its neighbours, since a sentence may be completed by the
next one. Formulas are between backticks and omissions are marked by "…"; the rest is the paper's
text, word by word. An entry is shown as an erratum only if its evidence, a computation, refutes the
sentence. `page` is docs/errata.md: ``sepv reproduce --errata > docs/errata.md``.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from sepv import problems, schemes
from sepv.problem import Problem
from sepv.problems import structure
from sepv.record import EPS
from sepv.reference.increments import lost_variance
from sepv.simulate import ensemble
from sepv.simulate import truncation as bounded

from .judge import decide
from .record import Statement


class Evidence(NamedTuple):
    """The result of a check of a printed statement: two flags, that it holds or is refuted,
    and numbers in words.
    """

    holds: bool
    refuted: bool
    measured: str


@dataclass(frozen=True)
class Erratum:
    """A sentence of the paper and the computation that decides on it.

    place : the place of the sentence in the paper
    quote : the sentence with its neighbours
    printed : the part of the sentence that the evidence decides on
    criterion : the condition under which the printed part holds
    hypotheses : why the evidence satisfies what the passage assumes
    right : what holds instead, and what becomes of the paper's conclusion
    evidence : the function that computes the verdict
    command : the command that prints the verdict again
    """

    place: str
    quote: str
    printed: str
    criterion: str
    hypotheses: str
    right: str
    evidence: Callable[[], Evidence]
    command: str = "sepv reproduce text"

    def statement(self) -> Statement:
        """The printed part as a `Statement`, with a verdict from the evidence."""
        evidence = self.evidence()
        return Statement(
            text=self.printed,
            source=self.place,
            verdict=decide(evidence.holds, evidence.refuted),
            measured=evidence.measured,
            criterion=self.criterion,
            correction=self.right,
        )


def statements() -> list[Statement]:
    """The statements of all entries, each with a verdict by its evidence."""
    return [entry.statement() for entry in ENTRIES]


def errata() -> list[tuple[Erratum, str]]:
    """The entries whose printed statement is refuted, in the order of the paper,
    each with what was measured.
    """
    decided = zip(ENTRIES, statements(), strict=True)
    return [(entry, evidence.measured) for entry, evidence in decided if evidence.verdict == "fails"]


def page() -> str:
    """The errata with their evidence, in Markdown. A sentence that was quoted before is "[…]"."""
    lines = [
        "# Sentences of the paper that do not hold as printed",
        "",
        "This page quotes [Cohen and Dujardin](paper.md); […] replaces text quoted above. Each verdict rests on",
        "computed evidence; brackets say how the evidence satisfies the passage's assumptions.",
        "`sepv reproduce --errata` prints this page.",
    ]
    quoted: set[str] = set()
    for entry, measured in errata():
        sentences = re.split(r"(?<=[a-z]\.) (?=[A-Z])|(?<=…) (?=[A-Z])", entry.quote)
        quote = " ".join("[…]" if sentence in quoted else sentence for sentence in sentences)
        quoted |= {*sentences}
        command = "" if entry.command == Erratum.command else f" (`{entry.command}`)"
        lines += ["", f"## {entry.place}", "", f"> {quote.replace('[…] […]', '[…]')}", ""]
        lines += [
            f"- printed: {entry.printed}",
            f"- correct: {entry.right}",
            f"- evidence ({entry.hypotheses}): {measured}{command}",
        ]
    return "\n".join(lines) + "\n"


def _moments() -> Evidence:
    bounds = {e: bounded.truncation_bound(2.0**-e, 2) for e in (2, 6, 10)}
    rows = [(e, float(lost_variance(2.0**-e, 2)), (1 + 2 * A) * 2.0 ** (-2 * e)) for e, A in bounds.items()]
    return Evidence(
        all(abs(left - right) <= 1e-12 * right for _, left, right in rows),
        all(0 < left < right / 2 for _, left, right in rows),
        "; ".join(f"h = 2^-{e}: left {left:.2g}, right {right:.2g}" for e, left, right in rows),
    )


def _product() -> Evidence:
    """Check the shapes of a printed product: B times a row is undefined,
    and B times the column D(·) + e is meant.
    """
    B = np.array([[0.0, -1.0], [1.0, 0.0]])
    D, e, y0, y1 = np.diag([1.0, 2.0]), np.array([0.5, -0.25]), np.array([1.0, 0.5]), np.array([0.75, 1.0])
    row = 0.5 * (y0 + y1)[None] @ D + e[None]
    try:
        conforms = (B @ row).shape == (2, 1)
    except ValueError:
        conforms = False
    mean = 0.5 * (D @ y0 + e) + 0.5 * (D @ y1 + e)
    gap = float(np.max(np.abs(B @ mean - B @ (D @ (0.5 * (y0 + y1)) + e))))
    measured = (
        f"B and the integral have shapes {B.shape} and {row.shape}; with the column D(·) + e, (2.1) and the "
        f"midpoint rule differ by {gap:.1g}"
    )
    return Evidence(conforms, not conforms and gap < 8 * EPS, measured)


def _third_moment() -> Evidence:
    h, c = 2.0**-4, 1.0
    gap = float(lost_variance(h, 2))
    printed, true = h**3 + 3 * c**2 * h**2, h**3 + 3 * c**2 * h**2 * (1 - gap)
    measured = f"h = 2^-4: left {true:.10g}, right {printed:.10g}, because E[ΔŴ²] = h (1 − {gap:.2g})"
    # Equal to rounding, or apart by more than a thousand roundings.
    return Evidence(abs(printed - true) <= 8 * EPS, printed - true > 1e3 * EPS, measured)


def _ball() -> Evidence:
    x, p = np.array(problems.harmonic_oscillator().initial).tolist()
    radius, distance = (x * x + p * p) / 2, math.hypot(x, p)
    measured = f"the printed radius is {radius:.4g}, the start's distance from the origin {distance:.4g}"
    return Evidence(radius >= distance, radius < distance, measured)


def _level() -> Evidence:
    """Check f on the level H = H(y0) of Lotka-Volterra: y1 grows, y3 is fixed,
    and y2 + ln y2 = s gives y2 = W(e^s).
    """
    from scipy.special import lambertw

    system = problems.lotka_volterra()
    start = np.array(system.initial)
    H0 = float(system.hamiltonian(start))
    states = [start]
    for y1 in (10.0, 50.0, 250.0):
        s = H0 - (2 * y1 + 2 * start[2] - 2 * math.log(start[2]))
        states.append(np.array([y1, float(lambertw(math.exp(s)).real), start[2]]))
    fields = [float(np.linalg.norm(system.structure(y) @ system.gradient(y))) for y in states]
    # The bound allows a rounding of each term of H, of which 2 y1 is the largest, and one of W.
    same = all(abs(system.hamiltonian(y) - H0) <= 16 * EPS * (1 + 2 * y[0]) for y in states)
    shown = (
        f"y = ({y[0]:g}, {y[1]:.2g}, {y[2]:g}): |f| = {f:.3g}" for y, f in zip(states, fields, strict=True)
    )
    # For y3 = ½ the component f1 = −y1 (1 + y2/2) exceeds every bound.
    growing = all(f >= y[0] for y, f in zip(states, fields, strict=True))
    return Evidence(not same, same and growing, f"with H(y) = H(y0) = {H0:.6g}, " + "; ".join(shown))


def _comparison() -> Evidence:
    """Compare H along (2.1) and the midpoint scheme for H = ½p² + ¼q⁴, whose levels are bounded,
    but not ∇H on ℝ².
    """
    system = Problem(
        dimension=2, structure=structure, hamiltonian=lambda y: 0.5 * y[0] ** 2 + 0.25 * y[1] ** 4, noise=(1.0,),
        initial=(0.5, 1.0), degree=4,
    )  # fmt: skip
    start, h = float(system.hamiltonian(np.array(system.initial))), 2.0**-4
    times, reach = h * np.arange(1, 17), {}
    for scheme in (schemes.energy_preserving, schemes.midpoint):
        sample = ensemble(scheme, system, h=h, T=1.0, paths=256, times=times, engine="numpy")
        reach[scheme.name] = float(np.max(sample.energy())) / start
    ours, theirs = reach.values()
    bounded = ours <= 1 + 1e-12
    measured = (
        f"H = ½p² + ¼q⁴, y0 = (0.5, 1), h = 2^-4, t ≤ 1, 256 paths: the largest H is {ours:.6g} H(y0) along (2.1), and "
        f"{theirs:.4g} H(y0) along the midpoint scheme (3.4)"
    )
    return Evidence(bounded and theirs <= 1 + 1e-12, bounded and theirs > 1 + 1e-6, measured)


SETS_OF_REMARK = (
    "Since the method (2.1) exactly preserves the energy by Proposition 3.1, one can find, for problems such as those "
    "presented in Section 4, for all initial datum `y0`, a convex subset of the phase space containing almost surely "
    "the numerical trajectories starting from `y0` on which the vector field `f` and the function `B` as well as their "
    "derivatives up to order 3 are bounded. Hence, the estimates in the proofs above extend to these cases "
    "straightforwardly. For example, … "
)
ENTRIES = (
    Erratum(
        place="Remark 2.1",
        quote="one defines the truncated random variable [17] `ζ_h = …` Moreover, one has the following approximation "
        "property, see Lemma 2.1 from [17], `0 ≤ E[ξ² − ζ_h²] = (1 + 2√(2k|ln(h)|)) h^k`. This is what we do in the "
        "present paper using the notation `ΔŴ_n := √h ζ_h` for the truncated random Wiener processes and taking `k=2` "
        "in the definition of `A_h`.",
        printed="0 ≤ E[ξ² − ζ_h²] = (1 + 2√(2k|ln h|)) h^k",
        criterion="both sides are equal; the left side is 2[(1 − A²)Q(A) + Aφ(A)], A = √(2k|ln h|)",
        hypotheses="ξ is standard normal, ζ_h is ξ clipped at ±√(2k|ln h|), k = 2 as in the paper, and h < 1",
        right="“≤”; no later argument uses the equality",
        evidence=_moments,
    ),
    Erratum(
        place="§3.3",
        quote="let us consider the following Hamiltonian function `H(y) = ½ yᵀDy + eᵀy` with a constant symmetric "
        "matrix `D` and a constant vector `e`. In this case, the numerical method (2.1) reads "
        "`y_{n+1} = y_n + B(ȳ) ∫₀¹ ((y_n + τ(y_{n+1} − y_n))ᵀD + eᵀ) dτ (h + cΔŴ_n) = …` which is the stochastic "
        "midpoint rule applied to problem (1.1) with the above quadratic Hamiltonian function.",
        printed="B(ȳ) ∫₀¹ ((y_n + τ(y_{n+1} − y_n))ᵀD + eᵀ) dτ",
        criterion="the product of B and the row is defined, and a column",
        hypotheses="D is symmetric, B skew-symmetric and constant, d = 2",
        right="the integrand is the column D(y_n + τ(y_{n+1} − y_n)) + e; (2.1) is then the midpoint rule, as stated",
        evidence=_product,
    ),
    Erratum(
        place="proof of Theorem 3.3",
        quote="Moreover using the independence of the truncated Wiener increment `ΔŴ` with `y_n`, we have "
        "`E[(c(y_n) − c̃(y_n))(h + cΔŴ_n)³] = E[c(y_n) − c̃(y_n)] E[(h + cΔŴ_n)³] = O(h²)`, since "
        "`E[(h + cΔŴ_n)³] = h³ + 3c²h²`. We infer, that `E[y_{n+1} − ỹ_{n+1}] = O(h²)`.",
        printed="E[(h + cΔŴ_n)³] = h³ + 3c²h²",
        criterion="both sides are equal",
        hypotheses="k = 2, c = 1, h < 1",
        right="“≤”, because the truncated increment has E[ΔŴ²] < h. The conclusion O(h²) is right",
        evidence=_third_moment,
    ),
    Erratum(
        place="Remark 3.5, and with it Theorem 3.4",
        quote=SETS_OF_REMARK.removesuffix("For example, … ") + "For example,",
        printed="the estimates in the proofs above extend straightforwardly, by preservation of the energy",
        criterion="the midpoint scheme, with which these proofs compare and whose order they take from a context of "
        "global bounds, stays in the smallest convex set that contains the energy level, as (2.1) does",
        hypotheses="as in Theorem 3.4, H and B are smooth, and each level set of H lies in the compact convex set that "
        "it bounds",
        right="a step of the proof is missing. If the convex set is compact, change H and B outside a neighbourhood of "
        "it, so that they and their derivatives are bounded. The exact solution, and steps of (2.1) with h so small "
        "that the changed step has one solution near y0, do not change. So Theorem 3.3 applies for these h, and the "
        "conclusion is right. §4.1 to §4.3 do not need this step. On the oscillator and the rigid body the midpoint "
        "scheme (3.4) equals (2.1), so the difference that the proof bounds is zero. The pendulum's f has bounded "
        "derivatives on ℝ² (Remark 3.4)",
        evidence=_comparison,
    ),
    Erratum(
        place="Remark 3.5, oscillator",
        quote=SETS_OF_REMARK
        + "for the harmonic oscillator starting at `y0 = (x0, p0) ∈ ℝ²` (see Section 4.1), such a convex "
        "set is the ball centered at the origin of the phase space with radius `(y0² + p0²)/2`. Since `f` is smooth on "
        "this compact set, it is bounded on it and so are its derivatives up to order 3.",
        printed="the ball centred at the origin with radius (y0² + p0²)/2 contains the numerical trajectories of the "
        "oscillator",
        criterion="the ball contains the start (x0, p0)",
        hypotheses="(x0, p0) = (0.1, 0.2), as in §4.1; y0 is read as x0",
        right="the radius is √(x0² + p0²); the argument is then right",
        evidence=_ball,
    ),
    Erratum(
        place="Remark 3.5, Lotka-Volterra",
        quote=SETS_OF_REMARK
        + "for the Lotka-Volterra system (see Section 4.4), any numerical solution can be included in a "
        "rectangle which is the product of two compact intervals. Hence the functions `B` and `f` as well as their "
        "derivatives up to order 3 are bounded on such a compact (and convex) set.",
        printed="preservation of the energy keeps the numerical trajectories of Lotka-Volterra in a compact rectangle, "
        "on which f is bounded",
        criterion="the energy level H(y) = H(y0) is bounded: energy is what the argument rests on",
        hypotheses="parameters and y0 of §4.4; the states satisfy y > 0 and H(y) = H(y0) to rounding",
        right="the level set of H is unbounded, and f is unbounded on it. So neither this argument nor the assumption "
        "of Theorem 3.4 covers §4.4. The exact solution stays in a compact set, because it keeps the Casimir y1² y2 y3 "
        "= K: then H is 2y1 − 2 ln y1 + 2y3 − 3 ln y3 + y2 + ln K. (2.1) does not keep that Casimir. Order 1 is "
        "observed all the same (`sepv reproduce 4.6`; long paths: `sepv reproduce theory`)",
        evidence=_level,
    ),
)  # fmt: skip
