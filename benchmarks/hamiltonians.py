"""Schemes for several Hamiltonians and their papers: ``python -m benchmarks.hamiltonians > docs/class.md``.

Three tables: each law's verdict on each scheme, with what the scheme claims; the slopes that were measured, by
quadrature and on paths, with their intervals; and the saboteurs of the class, by the law that states their fault, with
ten seeds. Some six minutes of one core.
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
SLOPES = ("local-mean", "local-mean-square", "local-weak", "mean-square-order", "weak-order")
# What a saboteur is asked besides the law that states its fault: it should lose nothing else.
KEPT = (
    "identity", "energy", "energy-drift", "casimir", "casimir-drift", "any-casimir", "poisson-map", "symplecticity",
    "positivity", "symmetry", "local-mean", "local-mean-square", "local-weak",
)  # fmt: skip
SEEDS = tuple(range(10))
# Random examples of a law beyond its design: the default budget.
EXAMPLES = 12
# Those of this class, and those that break structures or domains of one Hamiltonian.
FAMILIES = ("hamiltonians", "structure")
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

dy = B(y)(∇H_0 dt + Σ_j c_j ∇H_j ∘dW_j) with {H_0, H_j} ≠ 0: see `sepv.problem.HamiltoniansProblem`. This page is what
`python -m benchmarks.hamiltonians` prints.
"""
DIFFERENCES = """## How the verdicts stand to the papers

*darboux-lie* is the midpoint rule in logarithms. It has mean-square order 1 for one noise (`lotka-volterra`), and order
½ for three independent noises whose fields do not commute: the local slope on `random-lotka-volterra` is 1.0, where
order 1 needs 1.5. No scheme that sees increments alone can do better (J. Clark and R. Cameron 1980). Liu and Wang prove
order 1 of an integrator of their own. Of their paper only the abstract and the introduction were read: nothing here is
a verdict about it. Over paths the noise of that problem is so small that the order of the drift's error shows.

The statements of the other papers hold where they were measured. Both midpoint rules violate *poisson-map*, and with
*isospectral-midpoint* they violate *energy-drift*; none claims it. E[H] is right up to h³ a step for the midpoint
rules, and up to h² for *isospectral-midpoint*. Laws about H speak of *darboux-lie* on `lotka-volterra`, which is (1.1).
"""
ADDITIVE = """## Additive noise

*drift-preserving* is judged on dy = B(y)∇H dt + Σ c_j g_j dW_j with any constant vectors g_j. The abstract of its paper
states the exact drift of the energy and of quadratic Casimirs. Abstract and introduction were read, not the
experiments: `pushed-rigid-body` is a problem of our own. Growth of its means per unit of time, to T = 1, by 10,000
pairs of paths, with standard errors (`python -m benchmarks.additive_noise`):

"""
AFTER = """
In one step Euler-Maruyama has h²|f(y0)|² too much of E|y|², and the implicit scheme h²E|f(y1)|² too little;
*drift-preserving* errs by rounding alone (law *casimir-drift*).
"""


def table(heading: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table of Markdown."""
    return markdown(heading, rows) + "\n"


def verdicts(reports: dict[str, Report]) -> str:
    """Scheme by scheme: the laws that hold, claimed or not, and those that do not."""

    def listed(report: Report, verdict: Verdict, claimed: bool) -> str:
        return ", ".join(f.law for f in report.findings if f.verdict is verdict and f.claimed is claimed)

    decided = (Verdict.HOLDS, Verdict.VIOLATED, Verdict.NOT_APPLICABLE)
    rows = [
        [
            name,
            listed(report, Verdict.HOLDS, True),
            listed(report, Verdict.HOLDS, False),
            listed(report, Verdict.VIOLATED, False),
            ", ".join(
                f"{f.law} {f.verdict.text}" for f in report.findings if is_red(f) or f.verdict not in decided
            ),
        ]
        for name, report in reports.items()
    ]
    return table(["scheme", "claimed, holds", "holds besides", "violated, not claimed", "red or open"], rows)


def is_red(finding: Finding) -> bool:
    """True if a claimed law is violated."""
    return finding.claimed and finding.verdict is Verdict.VIOLATED


def slopes(reports: dict[str, Report]) -> str:
    """Problem by problem: slopes of one step and orders of paths, the latter with the interval that judged them."""
    rows = []
    for name, report in reports.items():
        seen: dict[str, dict[str, str]] = {}
        for law in SLOPES:
            for m in (report.finding(law).witness or {}).get("measured", ()):
                row = seen.setdefault(m["problem"], {})
                if "slope" in m:
                    short = m["slope"] is not None and m["slope"] < m["needed"]
                    row[law] = ("rounding" if m["slope"] is None else f"{m['slope']:.2f}") + " !" * short
                else:
                    low, high = m["interval"]
                    row[law] = f"{m['estimate']:.2f} [{low:.2f}, {high:.2f}], {m['paths']}"
        for problem, row in seen.items():
            kind = column(problems.by_name(problem))
            rows.append([name, problem, kind, *(row.get(law, "") for law in SLOPES)])
    return table(["scheme", "problem", "noises", *SLOPES], rows)


def detection_tables(names: Sequence[str], seeds: Sequence[int]) -> str:
    """Each saboteur with the law that states its fault, how often that kills it, and what else is lost."""
    rows = []
    for name in names:
        saboteur = SABOTEURS[name]
        first = saboteur.caught_by[0]
        killed = sum(b.kills for seed in seeds for b in fault_detection.detect(name, seed, [first], EXAMPLES))
        claimed = [law for law in KEPT if law in saboteur.scheme.claims and law != first]
        others = {b.law: b.verdict for b in fault_detection.detect(name, 0, claimed, EXAMPLES)}
        kept = (Verdict.HOLDS, Verdict.NOT_APPLICABLE)
        lost = ", ".join(
            law + "?" * (v is not Verdict.VIOLATED) for law, v in others.items() if v not in kept
        )
        rows.append([name, saboteur.broken, first, f"{killed}/{len(seeds)}", lost])
    return table(["saboteur", "broken", "law", "killed", "loses too"], rows).rstrip("\n")


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
    print(ADDITIVE + additive_noise.table() + "\n" + AFTER)
    print("## Verdicts\n\nLaws that a line does not name do not speak of the scheme.\n")
    print(verdicts(reports))
    if set(SLOPES) <= set(chosen.laws):
        print("## Slopes\n")
        print(
            "Of one step by quadrature; an exclamation mark says that it is less than the claim needs. Of paths with\n"
            "the interval that judged it, and the number of paths. *local-mean-square* is the distance from the\n"
            "log-ODE of step two where fields do not commute: it shows no more than order 1.\n"
        )
        print(slopes(reports))
    print("## Saboteurs\n")
    print(
        "Each imitates a scheme and claims what that claims. Killed: by the law that states its fault, of so many\n"
        "seeds. Of the other laws about structure and steps, with one seed, the last column has those that it loses\n"
        "(?: a step was not finite). The last four are for one Hamiltonian: they break a structure, or a domain.\n"
    )
    print(
        detection_tables(
            [n for f in FAMILIES for n, s in SABOTEURS.items() if s.family == f], range(chosen.seeds)
        )
    )


if __name__ == "__main__":
    start(main)
