"""The table of other libraries' solvers by kind of noise:
``python -m benchmarks.peers.solvers --out docs/solvers.md``.

A row is for a solver and a column for a kind of noise. A cell has the measured orders beside the
documented ones.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click

from benchmarks.peers.compliance_measurements import LIBRARIES, release
from benchmarks.peers.deviations import Deviation, deviations_shown_by
from benchmarks.peers.kept_measurements import measured
from benchmarks.peers.options import measuring, page_options, put
from benchmarks.peers.solver import NOISE_KINDS, problem_of
from benchmarks.peers.solver_measurements import (
    KEPT_LAWS,
    PATHS_ORDER_ALPHA,
    SOLVER_STEPS,
    SOLVER_T,
    cells,
    limit_of,
    orders,
)
from sepv import __version__
from sepv.console import ShownProgress, markdown
from sepv.errors import TargetError
from sepv.law import Effort, Verdict
from sepv.peers.peer import Solver, load

SOLVERS_COMMAND = "python -m benchmarks.peers.solvers"
# Half-way to the next lower order, as in the laws about orders.
SOLVER_ORDER_MARGIN = 0.25
# Words of a shortcoming in the order of one step, which the table shows beside the documented
# order.
IN_THE_TABLE = "of one step"
WORD_OF_VERDICT = {
    Verdict.HOLDS.value: "kept",
    Verdict.VIOLATED.value: "no",
    Verdict.NOT_APPLICABLE.value: "–",
}


@dataclass(frozen=True)
class Line:
    """A solver with one kind of noise: the texts of its cells,
    and where it falls short of the documentation.
    """

    cells: tuple[str, ...]
    short: tuple[str, ...]
    source: str


def line(solver: Solver, kind: str, found: Mapping[tuple[str, str], Any]) -> Line:
    """The line of one solver and one kind of noise."""
    local, limit = found[solver.name, f"{kind}, one step"], found[solver.name, f"{kind}, limit"]
    paths = found.get((solver.name, f"{kind}, paths"))
    strong, weak = solver.documented[kind]
    found_strong, found_weak = orders(solver, kind, local)
    documented, converges = "Itô" if solver.ito else "Stratonovich", limit_of(limit)
    # A solver with a state of its own is judged by its paths, because its single step is another
    # method.
    short = [] if solver.path else [
        f"{word} order {_number(order)} {IN_THE_TABLE} (documented: {claim:g})"
        for word, order, claim in (("strong", found_strong, strong), ("weak", found_weak, weak))
        if claim is not None and order < claim - SOLVER_ORDER_MARGIN
    ]  # fmt: skip
    if paths is not None and strong is not None and paths["order"][2] < strong - SOLVER_ORDER_MARGIN:
        short.append(f"strong order {_interval(paths)} over paths (documented: {strong:g})")
    if converges not in (documented, "both"):
        neither = "neither Itô's nor Stratonovich's solution"
        short.append(f"the limit is {neither if converges == 'neither' else converges}")
    return Line(
        (
            solver.name,
            kind,
            _claim(strong),
            _number(found_strong) + (" §" if solver.path else ""),
            "–" if paths is None else _interval(paths),
            _claim(weak),
            _number(found_weak) + (" §" if solver.path else ""),
            documented,
            converges,
            *(WORD_OF_VERDICT.get(found[solver.name, f"{kind}, {law}"], "?") for law in KEPT_LAWS),
        ),
        tuple(short),
        solver.source,
    )


def _claim(order: float | None) -> str:
    return "–" if order is None else f"{order:g}"


def _number(order: float) -> str:
    return "?" if math.isnan(order) else "∞" if math.isinf(order) else f"{order:.2f}"


def _interval(paths: Mapping[str, Any]) -> str:
    value, low, high = paths["order"]
    return f"{value:.2f} [{low:.2f}, {high:.2f}]" + (f", {paths['failed']} failed" if paths["failed"] else "")


def lines(
    libraries: Sequence[str], effort: Effort, folder: Path | None, shown: ShownProgress
) -> dict[str, list[Line]]:
    """The lines of the libraries that are installed."""
    chosen: dict[str, tuple[Solver, ...]] = {}
    for library in libraries:
        try:
            chosen[library] = load(library).solvers
        except TargetError as error:
            click.echo(f"{library} left out: {error.received}", err=True)
    found = measured(
        [c for library, own in chosen.items() for s in own for c in cells(library, s, effort)], folder, shown
    )
    return {
        library: [line(s, kind, found) for s in own for kind in s.documented]
        for library, own in chosen.items()
    }


def document(found: Mapping[str, Sequence[Line]], deviations: Sequence[Deviation], command: str) -> str:
    """The page, in Markdown."""
    parts = [
        "# Orders of other libraries' solvers, by kind of noise",
        f"Made by `{command}` with sepv {__version__}.",
        _introduction(),
    ]
    for library, own in found.items():
        parts += [f"## {library} {release(library)}", table(library, own)]
        parts.append(_sources(library, own))
    lines = [each for own in found.values() for each in own]
    short = [f"{each.cells[0]}, {each.cells[1]}" for each in lines if each.short]
    besides = {
        f"{each.cells[0]}, {each.cells[1]}": [text for text in each.short if IN_THE_TABLE not in text]
        for each in lines
    }
    parts += [
        f"{_kept(lines)}.",
        "## Less than documented (†)",
        "Each line adds what the tables do not show (*one*: a single noise):\n"
        + "\n".join(f"- {name}: {'; '.join(texts)}" for name, texts in besides.items() if texts),
        "[Scripts without sepv](deviations.md) show the same."
        * any(_is_about(d.solver, entry) for d in deviations for entry in short),
    ]
    return "\n\n".join(p for p in parts if p) + "\n"


def table(library: str, own: Sequence[Line]) -> str:
    """The table of orders in Markdown: a row for solvers with the same orders,
    a column for each kind of noise.
    """
    rows: dict[str, dict[str, str]] = {}
    for each in own:
        name, kind, strong, step, paths, weak, weak_step, limit, *_ = each.cells
        row = rows.setdefault(name.removeprefix(f"{library} "), {"limit": limit})
        # For a solver with a state of its own the order of its paths is shown.
        own = f"{paths.partition(' [')[0]} §" if "§" in step else step
        orders = [beside(own, strong), beside(weak_step.removesuffix(" §"), weak)]
        row[kind] = "; ".join(orders[: 1 if orders[1] == "1.00" else 2]) + " †" * bool(each.short)
    groups: dict[tuple[str, ...], list[str]] = {}
    for name, row in rows.items():
        groups.setdefault(tuple(row.get(key, "") for key in ("limit", *NOISE_KINDS)), []).append(name)
    lines = markdown(
        ("solvers", *NOISE_KINDS), [("; ".join(names), *cells) for (_, *cells), names in groups.items()]
    )
    itos = [name for name, row in rows.items() if row["limit"] == "Itô"]
    return f"{lines}\n\nThese solve Itô's equation: {'; '.join(itos)}." if itos else lines


def _sources(library: str, own: Sequence[Line]) -> str:
    """The places of a library's documented orders; if there are several, each with its solvers."""
    names: dict[str, list[str]] = {}
    for each in own:
        names.setdefault(each.source, []).append(each.cells[0].removeprefix(f"{library} "))
    if len(names) == 1:
        return f"Documented orders: {own[0].source}."
    return "Documented orders:\n" + "\n".join(
        f"- {'; '.join(dict.fromkeys(solvers))}: {source}" for source, solvers in names.items()
    )


def beside(measured: str, documented: str) -> str:
    """A measured order, with the documented one in brackets if they differ by more than 0.1."""
    try:
        same = documented == "–" or abs(float(measured.removesuffix(" §")) - float(documented)) <= 0.1
    except ValueError:  # none was measured
        same = False
    return measured if same else f"{measured} ({documented})"


def _kept(lines: Sequence[Line]) -> str:
    """The solvers that keep Casimirs or are Poisson maps, and those that were not judged, as
    text.
    """
    kept = [
        f"{each.cells[0]}, {each.cells[1]}: {', '.join(each.cells[-2:])}"
        for each in lines
        if {*each.cells[-2:]}
        - {WORD_OF_VERDICT[Verdict.VIOLATED.value], WORD_OF_VERDICT[Verdict.NOT_APPLICABLE.value]}
    ]
    if kept:
        return f"Casimirs (*casimir*) and structure (*poisson-map*) on these problems: {'; '.join(kept)}"
    return "No solver keeps Casimirs (*casimir*) or structure (*poisson-map*) of these problems, and none claims it"


def _is_about(script: str, entry: str) -> bool:
    """True if the text `entry` names the solver of a script, "library method option"."""
    named = entry.partition(":")[0].replace(",", " ").split()
    return set(script.replace(",", " ").split()) <= set(named)


def _introduction() -> str:
    problems = "\n".join(
        f"- {kind}: {text} (`{problem_of(kind).name}`)" for kind, text in NOISE_KINDS.items()
    )
    return f"""\
Each solver ran on dy = B(y)(∇H_0 dt + Σ_j c_j ∇H_j ∘dW_j) with c_j = ½, by its library's code in float64, with given
increments. Noise is *commutative* if the Lie brackets of its fields vanish, *additive* if its fields are constant:

{problems}

A cell has the measured *strong order; weak order*, and in brackets the documented order if it differs by more than
0.1. A weak order of 1.00 is left out if the documentation states no other. A cell is empty if the solver does not
support the kind of noise. † marks an order more than 0.25 below the documented one (for paths, the whole confidence
interval), or another limit than the documented one. The mean of a short step shows whether the solver converges to
Itô's or to Stratonovich's solution. Solvers of Itô equations got Itô's form.

- **Orders** follow from errors of one step, computed by quadrature as in the laws *local-mean*, *local-mean-square* and
  *local-weak*. The reference solution shows strong orders up to 1, or up to 1.5 for solvers that use
  space-time areas of commutative noise.
- **Paths**: rms errors at T = {SOLVER_T:g} with {", ".join(map(str, SOLVER_STEPS))} steps give a second strong order.
  The last section has its confidence intervals, each of which misses the true order with nominal
  probability {PATHS_ORDER_ALPHA:g}.
- **§** marks a solver that passes an internal state from step to step; its strong order is measured over paths.
- **Lévy areas** A_ij of the reference's path are given to the solver. By default torchsde and sdeint approximate A_ij
  by random numbers of fixed accuracy, so the order falls to ½ for small steps (P. Kloeden and E. Platen 1992, §5.8)."""


@click.command()
@page_options(LIBRARIES)
def main(out: Path | None, keep: Path | None, libraries: tuple[str, ...], seed: int) -> None:
    """Measure the orders of other libraries' solvers by kind of noise,
    and write the table as Markdown.
    """
    with measuring(keep) as bar:
        found = lines(libraries or LIBRARIES, Effort(seed=seed, shrink_checks=50), keep, bar)
        bar.update("the scripts that show deviations", 1.0)
        shown = deviations_shown_by(out.parent / "peers", LIBRARIES) if out else []
    put(out, lambda arguments: document(found, shown, f"{SOLVERS_COMMAND}{arguments}"), libraries, seed)


if __name__ == "__main__":
    main()
