"""Schemes for several Hamiltonians and their papers: ``python -m benchmarks.hamiltonians > docs/class.md``.

Its tables: what each scheme claims; the laws that hold without a claim, and those that do not; slopes of one step by
quadrature; and the saboteurs of the class, by the law that states their fault, with ten seeds. Some six minutes of one
core.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable, Sequence

from sepv.reference.faults import detection as fault_detection
from sepv.reference.faults.saboteurs import SABOTEURS

import sepv
from benchmarks import additive_noise, over, start
from sepv import problems
from sepv.console import markdown
from sepv.problem import column
from sepv.verification import LAWS, Finding, Report, Verdict

SCHEMES = (
    "stochastic-midpoint",
    "area-midpoint",
    "stochastic-splitting",
    "isospectral-midpoint",
    "darboux-lie",
    "drift-preserving",
)
SLOPES = ("local-mean-square", "local-weak")
KINDS = ("general", "commutative", "one", "additive")  # of noise
SEEDS = tuple(range(10))
# Random examples of a law beyond its design: the default budget.
EXAMPLES = 12
# (scheme, where it comes from, what is claimed there, what is claimed here beyond that)
CLAIMS = (
    (
        "stochastic-midpoint",
        "Milstein, Repin and Tretyakov 2002, constant B",
        "symplectic; mean-square order ½, 1 for noises that commute",
        "for any B: quadratic Casimirs, weak order 1; no Poisson map where B is not constant",
    ),
    (
        "area-midpoint",
        "the midpoint rule with the areas of Kloeden and Platen 1992, §10.3",
        "– (no paper)",
        "mean-square order 1 for any noises, quadratic Casimirs, symplectic for constant B",
    ),
    (
        "stochastic-splitting",
        "Bréhier, Cohen and Jahnke 2023, composed as Lie's and Trotter's",
        "Poisson map, all Casimirs; mean-square order ½, weak order 1",
        "symmetry (composed as Strang's); order 1 for noises that commute",
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
        "Poisson map, Casimirs; mean-square order 1 (of their own integrators, by their abstracts)",
        "positivity; order 1 for noises that commute, ½ otherwise",
    ),
    (
        "drift-preserving",
        "Cohen and Vilmart 2022",
        "E[H] grows at the exact rate, quadratic Casimirs too; mean-square order 1, weak order 2",
        "that, for additive noise in the image of B or not",
    ),
)
TITLE = """# Several Hamiltonians: what schemes claim, and what was found

This page lets you choose a scheme for dy = B(y)(∇H_0 dt + Σ_j c_j ∇H_j ∘dW_j) with {H_0, H_j} ≠ 0
(`sepv.problem.HamiltoniansProblem`). It is what `python -m benchmarks.hamiltonians` prints.
"""
DIFFERENCES = """## How the verdicts stand to the papers

*darboux-lie* is the midpoint rule in logarithms. It has mean-square order 1 for one noise (`lotka-volterra`), and order
½ for three independent noises whose fields do not commute (`random-lotka-volterra`). No scheme that sees increments
alone can do better (J. Clark and R. Cameron 1980). Liu and Wang prove order 1 of an integrator of their own. Of their
paper only the abstract and the introduction were read: nothing here is a verdict about it.

The statements of the other papers hold where they were measured. Both midpoint rules violate *poisson-map* and
*energy-drift*; neither claims these. E[H] is right up to h³ a step for the midpoint rules, and up to h² for
*isospectral-midpoint*. Laws about H speak of *darboux-lie* on `lotka-volterra`, which is (1.1).
"""
ADDITIVE = """## Additive noise

*drift-preserving* is judged on dy = B(y)∇H dt + Σ c_j g_j dW_j with any constant vectors g_j. The abstract of its paper
states the exact drift of the energy and of quadratic Casimirs. Abstract and introduction were read, not the
experiments: `pushed-rigid-body` is a problem of our own. Growth of its means per unit of time, to T = 1, by 10,000
pairs of paths, with standard errors (`python -m benchmarks.additive_noise`):

"""


def table(heading: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table of Markdown."""
    return markdown(heading, rows) + "\n"


def verdicts(reports: dict[str, Report]) -> str:
    """Scheme by scheme: the laws that hold without a claim, and those that do not hold."""

    def listed(report: Report, verdict: Verdict) -> str:
        return ", ".join(f.law for f in report.findings if f.verdict is verdict and not f.claimed)

    decided = (Verdict.HOLDS, Verdict.VIOLATED, Verdict.NOT_APPLICABLE)
    rows = [
        [
            name,
            listed(report, Verdict.HOLDS),
            listed(report, Verdict.VIOLATED),
            ", ".join(
                f"{f.law} {f.verdict.text}" for f in report.findings if is_red(f) or f.verdict not in decided
            ),
        ]
        for name, report in reports.items()
    ]
    return table(["scheme", "holds besides", "violated, not claimed", "red or open"], rows)


def is_red(finding: Finding) -> bool:
    """True if a claimed law is violated."""
    return finding.claimed and finding.verdict is Verdict.VIOLATED


def slopes(reports: dict[str, Report]) -> str:
    """The least slopes of one step by quadrature, a column for each kind of noise."""
    rows = []
    for name, report in reports.items():
        least: dict[str, dict[str, float]] = {law: {} for law in SLOPES}
        for law, own in least.items():
            for m in (report.finding(law).witness or {}).get("measured", ()):
                kind, slope = column(problems.by_name(m["problem"])), m["slope"]
                if slope is not None:
                    own[kind] = min(slope, own.get(kind, slope))
        rows.append(
            [
                name,
                *("; ".join(f"{own[kind]:.2f}" for own in least.values() if kind in own) for kind in KINDS),
            ]
        )
    return table(["scheme", *KINDS], rows)


def detections(names: Sequence[str], seeds: Sequence[int]) -> str:
    """The saboteurs with the law that states their fault, under how often that law kills them."""
    rows, killed = [], []
    for name in names:
        saboteur = SABOTEURS[name]
        law = saboteur.caught_by[0]
        rows.append([name, saboteur.broken, law])
        found = [fault_detection.detect(name, seed, [law], EXAMPLES) for seed in seeds]
        killed.append(sum(b.kills for each in found for b in each))
    heading = "Each imitates a scheme and claims what that claims. "
    heading += f"The law kills it with {min(killed)} of {len(seeds)} seeds:\n\n"
    return heading + table(["saboteur", "broken", "law"], rows).rstrip("\n")


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", nargs="*", default=list(SCHEMES), help="schemes")
    parser.add_argument("--laws", nargs="*", default=list(LAWS), help="laws")
    parser.add_argument("--seeds", type=int, default=len(SEEDS), help="of the saboteurs")
    chosen = parser.parse_args(arguments)
    reports = {}
    for name in over(chosen.only):
        reports[name] = sepv.verify(name, laws=chosen.laws)
        print(f"{name}: {reports[name].counts}", file=sys.stderr, flush=True)
    print(TITLE)
    print(table(["scheme", "source", "claimed there", "claimed here besides"], CLAIMS))
    print(DIFFERENCES)
    print(ADDITIVE + additive_noise.table() + "\n")
    print("## Verdicts\n\nEvery claimed law holds but for those in the last column.\n")
    print(verdicts(reports))
    if set(SLOPES) <= set(chosen.laws):
        print("## Slopes\n")
        print(
            "Of *local-mean-square*; *local-weak*, by quadrature, for each kind of noise: an order p needs p + ½ and\n"
            "p + 1. Where noises do not commute, the first is the distance from the log-ODE of step two, which shows\n"
            "no more than order 1.\n"
        )
        print(slopes(reports))
    print("## Saboteurs\n")
    print(detections([n for n, s in SABOTEURS.items() if s.family == "hamiltonians"], range(chosen.seeds)))


if __name__ == "__main__":
    start(main)
