"""Do verdicts depend on units? ``python -m benchmarks.units``: right schemes,
problems of every rate, noise and size.

A problem dy = f(y)(dt + Σ c_j∘dW_j) becomes dy = ωλf(y/λ)(dt + Σ γc_j∘dW_j) from λy0. With
γ = ω^{−½} this is the problem in another unit of time, with λ in another unit of length,
and with γ alone it has another noise. Each of ω, γ, λ takes values from 1e-6 to 1e6 alone,
and all take extreme values together. No law may accuse a right scheme or be inconclusive.
The table has a row for each problem and scheme; each law that does not hold has a line with
its reason.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from sepv.properties import five_noises

from benchmarks import arguments, over, start
from sepv import problems, schemes
from sepv.law import Effort, Finding, Verdict
from sepv.problem import Problem
from sepv.problems import started
from sepv.record import poly
from sepv.schemes import Scheme
from sepv.verification import verify


class Scale(NamedTuple):
    """Factors of the rate, of the noise, and of the size of a problem."""

    rate: float = 1.0
    noise: float = 1.0
    size: float = 1.0


SCALE_FACTORS = (1e-6, 1e-3, 1.0, 1e3, 1e6)
UNIT_SCALES = tuple(
    dict.fromkeys(
        [
            Scale(),
            *(Scale(rate=v) for v in SCALE_FACTORS),
            *(Scale(noise=v) for v in SCALE_FACTORS),
            *(Scale(size=v) for v in SCALE_FACTORS),
            *(
                Scale(rate, noise, size)
                for rate in (1e-6, 1e6)
                for noise in (1e-6, 1e6)
                for size in (1e-6, 1e6)
            ),
        ]
    )
)
# The laws that judge a user's problem in steps h that the suite chooses. Other laws take the steps
# of their cases.
UNITS_LAWS = (
    "rounding", "truncation", "local-mean", "local-mean-square", "local-weak", "mean-square-order", "weak-order",
    "right-limit",
)  # fmt: skip


def _canonical(H: Any, initial: tuple[float, ...], c: tuple[float, ...], name: str) -> Callable[[], Problem]:
    """A function that makes the problem of a polynomial H in (q, p) with B = J⁻¹."""

    def make() -> Problem:
        n = len(initial) // 2
        one = poly.polynomial(2 * n, {(0,) * (2 * n): 1.0})
        data = problems.PolynomialSystem(2 * n, H, tuple((i, n + i, one) for i in range(n)), c)
        return started(data, name, initial)

    return make


UNITS_PROBLEMS: dict[str, Callable[[], Problem]] = {
    **problems.PAPER,
    **problems.EXTENSIONS,
    "quartic-top": five_noises,
    "quartic": _canonical(
        poly.polynomial(2, {(0, 2): 0.5, (4, 0): 0.25}), (1.0, 0.0), (0.5,), "quartic"
    ),
    "double-well": _canonical(
        poly.polynomial(2, {(0, 2): 0.5, (2, 0): -0.5, (4, 0): 0.25}), (0.5, 0.25), (0.5, 0.25), "double-well"
    ),
    "henon-heiles": _canonical(
        poly.polynomial(
            4, {(2, 0, 0, 0): 0.5, (0, 2, 0, 0): 0.5, (0, 0, 2, 0): 0.5, (0, 0, 0, 2): 0.5, (2, 1, 0, 0): 1.0,
                (0, 3, 0, 0): -1 / 3},
        ), (0.1, 0.2, 0.3, 0.0), (0.5,), "henon-heiles",
    ),
    "two-rates": _canonical(
        poly.polynomial(4, {(2, 0, 0, 0): 0.5, (0, 2, 0, 0): 8.0, (0, 0, 2, 0): 0.5, (0, 0, 0, 2): 8.0}),
        (1.0, 0.25, 0.0, 0.5), (0.5, 0.25), "two-rates",
    ),
    "sextic": _canonical(
        poly.polynomial(2, {(0, 2): 0.5, (6, 0): 1 / 6, (3, 1): 0.125}), (0.75, -0.5), (1.0,), "sextic"
    ),
    "free": _canonical(poly.polynomial(2, {(0, 2): 0.5}), (1.0, 0.5), (1.0,), "free"),
    "without-noise": _canonical(poly.polynomial(2, {(0, 2): 0.5, (4, 0): 0.25}), (1.0, 0.0), (), "without-noise"),
    "unequal-noises": _canonical(
        poly.polynomial(2, {(0, 2): 0.5, (4, 0): 0.25}), (1.0, 0.0), (1.0, 2.0**-20), "unequal-noises"
    ),
}  # fmt: skip
UNITS_SCHEMES = ("energy-preserving", "midpoint", "euler-heun", "milstein", "collocation-2", "explicit-4")


def scaled(problem: Problem, scale: Scale) -> Problem:
    """The problem with f → ωλf(y/λ), c → γc, y0 → λy0, as functions: H → ωλ²H(y/λ), B → B(y/λ)."""
    rate, noise, size = scale

    def of(function: Any, factor: float) -> Any:
        return None if function is None else lambda *y: factor * function(*(v / size for v in y))

    domain = problem.domain
    return Problem(
        dimension=problem.dimension,
        structure=of(problem.structure, 1.0),
        hamiltonian=of(problem.hamiltonian, rate * size**2),
        gradient=of(problem.gradient, rate * size),
        noise=noise * problem.c,
        casimirs=problem.casimirs,
        linear_casimirs=problem.linear_casimirs,
        hessian=of(problem.hessian, rate),
        structure_derivative=of(problem.structure_derivative, 1 / size),
        mean_gradient=of(problem.mean_gradient, rate * size),
        degree=problem.degree,
        domain=None if domain is None else lambda y: domain(y / size),
        initial=size * np.asarray(problem.initial),
        name=f"{problem.name} ({rate:g}, {noise:g}, {size:g})",
        check=False,  # scaled parts agree with each other as the parts of `problem` do
    )


def findings(
    scheme: Scheme, problem: Problem, effort: Effort, laws: tuple[str, ...] = UNITS_LAWS
) -> tuple[Finding, ...]:
    """The findings of the laws that a scheme claims, if the scheme can take this problem."""
    claimed = [law for law in laws if law in scheme.claims]
    return verify(replace(scheme, problems=(problem,)), laws=claimed, effort=effort).findings


def wrong(found: Finding) -> bool:
    """True if a finding on a right scheme is violated or left open,
    or "not applicable" without a reason.
    """
    if found.verdict is Verdict.NOT_APPLICABLE:
        return not found.message
    return found.verdict is not Verdict.HOLDS


def judged(
    names: list[str], chosen: list[str], scales: tuple[Scale, ...], laws: tuple[str, ...], effort: Effort
) -> Iterator[tuple[str, str, Scale, tuple[Finding, ...]]]:
    """Findings of every scheme on every problem at every scale."""
    for name in over(names):
        problem = UNITS_PROBLEMS[name]()
        for own in chosen:
            for scale in scales:
                yield name, own, scale, findings(schemes.by_name(own), scaled(problem, scale), effort, laws)


def main() -> None:
    """Print the table as Markdown."""
    options = arguments(
        __doc__,
        problem={"action": "append", "choices": list(UNITS_PROBLEMS)},
        scheme={"action": "append", "help": f"by default {', '.join(UNITS_SCHEMES)}"},
        law={"action": "append", "help": f"by default {', '.join(UNITS_LAWS)}"},
        corners={"action": "store_true", "help": "only where rate, noise and size are all extreme"},
        seed=0,
    )
    laws = tuple(options.law or UNITS_LAWS)
    scales = tuple(s for s in UNIT_SCALES if 1.0 not in s) if options.corners else UNIT_SCALES
    print(
        f"{len(scales)} scales: rate, noise and size from {min(SCALE_FACTORS):g} to {max(SCALE_FACTORS):g}\n"
    )
    print(
        "| problem | scheme | verdicts | hold | not applicable | wrong |\n|---|---|--:|--:|--:|--:|",
        flush=True,
    )
    lines, counts = [], Counter[tuple[str, str, str]]()
    shown: tuple[str, str] | None = None

    def row(at: tuple[str, str]) -> None:
        held, outside, bad = (counts[(*at, kind)] for kind in ("holds", "not applicable", "wrong"))
        print(f"| {at[0]} | {at[1]} | {held + outside + bad} | {held} | {outside} | {bad} |", flush=True)

    names, chosen = options.problem or list(UNITS_PROBLEMS), options.scheme or list(UNITS_SCHEMES)
    asked = judged(names, chosen, scales, laws, Effort(seed=options.seed))
    for name, scheme, scale, found in asked:
        if shown not in (None, (name, scheme)):
            row(shown)
        shown = name, scheme
        for finding in found:
            kind = "wrong" if wrong(finding) else finding.verdict.text
            counts[name, scheme, kind] += 1
            if kind != "holds":
                said = finding.message.replace("\n", "; ")[:300]
                lines.append(
                    f"{name}, {scheme}, {tuple(scale)}: {finding.law} {finding.verdict.text}: {said}"
                )
                if kind == "wrong":
                    print(lines[-1], flush=True)
    if shown:
        row(shown)
    total = Counter(kind for (_, _, kind), n in counts.items() for _ in range(n))
    print("\n" + ", ".join(f"{n} {kind}" for kind, n in total.items()))
    reasons = Counter(line.split(": ", 1)[1] for line in lines)
    print(*(f"{n} × {text}" for text, n in reasons.most_common(20)), sep="\n")


if __name__ == "__main__":
    start(main)
