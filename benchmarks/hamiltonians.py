"""Schemes for several Hamiltonians and their papers:
``python -m benchmarks.hamiltonians > docs/class.md``.

The page says what each scheme claims, and which laws hold or fail without a claim. It takes six
minutes of one core.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Sequence

import sepv
from benchmarks import additive_noise, arguments, over, start
from sepv.console import markdown
from sepv.law import Finding, Verdict
from sepv.verification import LAWS, Report

HAMILTONIANS_SCHEMES = (
    "stochastic-midpoint",
    "area-midpoint",
    "stochastic-splitting",
    "isospectral-midpoint",
    "darboux-lie",
    "drift-preserving",
)
HEADS = ("scheme", "source", "claims of the source", "further claims of sepv")
CLAIM_ROWS = (
    (
        "stochastic-midpoint",
        "Milstein, Repin and Tretyakov 2002, for constant B",
        "symplectic; mean-square order ½, 1 for noises that commute",
        "for any B: quadratic Casimirs, weak order 1, but no Poisson map unless B is constant",
    ),
    (
        "area-midpoint",
        "the midpoint rule with the areas of Kloeden and Platen 1992, §10.3",
        "– (no paper)",
        "mean-square order 1 for any noises, quadratic Casimirs, symplectic for constant B",
    ),
    (
        "stochastic-splitting",
        "Bréhier, Cohen and Jahnke 2023, as Lie-Trotter composition",
        "Poisson map, all Casimirs; mean-square order ½, weak order 1",
        "symmetry (as Strang composition); order 1 for noises that commute",
    ),
    (
        "isospectral-midpoint",
        "Ephrati, Jansson, Lang and Luesink, arXiv 2408.16701",
        "Poisson map, Casimirs almost surely; strong order ½, weak order 1",
        "order 1 for noises that commute",
    ),
    (
        "darboux-lie",
        "Hong, Ruan, Sun and Wang 2021; Liu and Wang 2024",
        "Poisson map, Casimirs; mean-square order 1 (for their own integrators, by the abstracts)",
        "positivity; order 1 for noises that commute, ½ otherwise",
    ),
    (
        "drift-preserving",
        "Cohen and Vilmart 2022",
        "E[H] and E[C] of quadratic Casimirs C grow at the exact rate; mean-square order 1, weak order 2",
        "the same if the noise is not in the image of B",
    ),
)
HAMILTONIANS_TITLE = """# Schemes for several Hamiltonians: claims and verdicts

Systems with several Hamiltonians are dy = B(y)(∇H_0 dt + Σ_j c_j ∇H_j ∘dW_j) (`sepv.problem.HamiltoniansProblem`).
Choose a scheme:

- for mean-square order 1 with any noises: *area-midpoint*;
- for a Poisson map: *stochastic-splitting* or *isospectral-midpoint*;
- for positive populations: *darboux-lie*;
- for additive noise: *drift-preserving*.

`python -m benchmarks.hamiltonians` prints this page.
"""
DIFFERENCES_TEXT = """## Verdicts compared with the papers

*darboux-lie* is the midpoint rule for the logarithms of y. It has mean-square order 1 for one noise (`lotka-volterra`),
and order ½ for three noises whose fields do not commute (`random-lotka-volterra`). For such noises no scheme that uses
only increments has a higher order (J. Clark and R. Cameron 1980). Liu and Wang prove order 1 for another
integrator. Only abstract and introduction of their paper were read, so no verdict here is about that integrator.

The statements of the other schemes' papers that are laws of sepv hold in all cases of a default run. Where the exact
E[H] grows at a constant rate, the error of E[H] in a step was O(h³) for *stochastic-midpoint* (on uncoupled oscillators
with additive noise, and on a top whose noise is a Casimir), and O(h²) for *isospectral-midpoint* (on the same top).
"""
ADDITIVE = """## Additive noise

*drift-preserving* is for dy = B(y)∇H dt + Σ c_j g_j dW_j with constant vectors g_j. By the abstract of its paper it
keeps the exact drift of the energy and of quadratic Casimirs. The paper's experiments were not read; the test
problem `pushed-rigid-body` is sepv's own. The table shows the growth of E|y|² and E[H] from t = 0 to T = 1, estimated
from 10,000 pairs of paths with opposite noise; ± precedes standard errors (`python -m benchmarks.additive_noise`):

"""
VERDICTS = """## Verdicts

Each line lists the laws that a scheme obeys or violates without claiming them, in the cases of a default run: *obeys*
means that none of them shows a violation. All claimed laws hold, except those listed after “not shown to hold”.
"""


def table(heading: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table of Markdown."""
    return markdown(heading, rows) + "\n"


def verdicts(reports: dict[str, Report]) -> str:
    """List scheme by scheme the laws that hold without a claim, and those that do not hold."""
    decided = (Verdict.HOLDS, Verdict.VIOLATED, Verdict.NOT_APPLICABLE)
    lines = []
    for name, report in reports.items():
        unclaimed = [f for f in report.findings if not f.claimed]
        held = ", ".join(f.law for f in unclaimed if f.verdict is Verdict.HOLDS)
        violated = ", ".join(f.law for f in unclaimed if f.verdict is Verdict.VIOLATED)
        red = ", ".join(
            f"{f.law} {f.verdict.text}" for f in report.findings if is_red(f) or f.verdict not in decided
        )
        parts = [("obeys ", held), ("violates ", violated), ("not shown to hold: ", red)]
        listed = "; ".join(f"{word}{laws}" for word, laws in parts if laws)
        lines.append(f"- *{name}*: {listed or 'neither obeys nor violates an unclaimed law'}")
    return "\n".join(lines) + "\n"


def is_red(finding: Finding) -> bool:
    """True if a claimed law is violated."""
    return finding.claimed and finding.verdict is Verdict.VIOLATED


def main() -> None:
    """Print the page."""
    chosen = arguments(
        __doc__,
        only={"nargs": "*", "default": list(HAMILTONIANS_SCHEMES), "help": "schemes"},
        laws={"nargs": "*", "default": list(LAWS), "help": "laws"},
    )
    reports = {}
    for name in over(chosen.only):
        reports[name] = sepv.verify(name, laws=chosen.laws)
        print(f"{name}: {reports[name].counts}", file=sys.stderr, flush=True)
    print(HAMILTONIANS_TITLE)
    print(table(HEADS, CLAIM_ROWS))
    print(DIFFERENCES_TEXT)
    print(ADDITIVE + additive_noise.table() + "\n")
    print(VERDICTS)
    print(verdicts(reports))


if __name__ == "__main__":
    start(main)
