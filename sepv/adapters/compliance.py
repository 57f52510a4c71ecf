"""The compliance table of other libraries' solvers: ``python -m sepv.adapters.compliance --out docs/compliance.md``.

Every law on every solver of the adapters, as `sepv verify` measures it, with orders and energy defects in numbers.
Scripts in the folder ``peers`` beside the output show, in a library's own terms and without sepv, where it does
not do what its documentation says: each ends with exit code 1 while that is so, and is quoted then.
"""

from __future__ import annotations

import ast
import hashlib
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from importlib import import_module, resources
from importlib.metadata import version
from pathlib import Path
from typing import Any

import click
import numpy as np

from sepv import problems, wiener
from sepv._version import __version__
from sepv.adapters.cells import Cell, measured
from sepv.adapters.multistep import PathSolver
from sepv.convergence import StrongErrors, log_decay, slope
from sepv.engine.ensemble import ensemble
from sepv.errors import SepvError
from sepv.exact import exact_flow
from sepv.law import Effort, Law, Verdict
from sepv.problem import Array, Problem
from sepv.progress import Shown, showing
from sepv.scheme import Scheme
from sepv.schemes import energy_preserving
from sepv.sequential import FALSE_ALARM, FIRST_LOOK, Setup, setups
from sepv.suite import LAWS, load_laws, verify
from sepv.tolerance import energy_ulp

LIBRARIES = ("diffrax", "torchsde", "sdeint")
# Energy defects are those of this many paths, the orders of whole paths of that many.
PATHS = 256
ORDER_PATHS = 1024
ENERGY_STEPS = 64
# Where schemes with untruncated increments are judged, as all of these are.
SETUPS = setups(truncation=None)

_MARKS = {
    Verdict.HOLDS: "holds",
    Verdict.VIOLATED: "–",
    Verdict.INCONCLUSIVE: "?",
    Verdict.NOT_APPLICABLE: "n/a",
    Verdict.ERROR: "error",
    Verdict.NOT_MEASURED: "",
}


@dataclass(frozen=True)
class Row:
    """What one solver was found to do: a line of both tables.

    Attributes
    ----------
    claimed : str
        The mean-square order for (1.1) that the library's documentation, or else theory, states; and the weak one.
    orders, energy : tuple of str
        The measured order with its interval, and the largest energy defect in energy ulps, for each of `SETUPS`.
    verdicts : dict of law name to mark
    notes : tuple of str
        Reasons of the verdict "error", and paths that failed.
    """

    library: str
    release: str
    solver: str
    source: str
    claimed: str
    orders: tuple[str, ...]
    energy: tuple[str, ...]
    verdicts: dict[str, str]
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Deviation:
    """A solver, "library name", that does not do what its documentation says, and the section about it."""

    solver: str
    text: str


# Laws by quadrature over ΔW, which is all of the noise that they know of.
OVER_INCREMENTS = ("local-mean", "local-weak")
_NO_AREAS = "takes means over ΔW, and the solver draws an area besides: not applicable"


def scheme_cells(library: str, scheme: Scheme, effort: Effort) -> Iterator[Cell]:
    """Every law on one scheme, and its energy defects."""
    release = _release(library)
    for law in load_laws():
        if law.name in OVER_INCREMENTS and _draws(library, scheme):
            continue
        yield Cell(
            scheme.name,
            law.name,
            (release, *_suite_key(effort), law.statement, law.source, _text_of(law), *_claimed(scheme)),
            partial(_finding, scheme, law.name, effort),
        )
    for setup in SETUPS:
        problem = problems.by_name(setup.problem)
        yield Cell(
            scheme.name,
            f"energy defect, {setup.problem}",
            (release, *_suite_key(effort), setup.T, PATHS, ENERGY_STEPS),
            partial(_energy_of_scheme, scheme, problem, setup.T),
        )


def scheme_row(library: str, scheme: Scheme, cells: Mapping[tuple[str, str], Any]) -> Row:
    """The line of a scheme whose cells are measured."""
    silent: dict[str, Any] = {
        name: {
            "verdict": Verdict.NOT_APPLICABLE.value,
            "claimed": False,
            "message": _NO_AREAS,
            "measured": (),
        }
        for name in OVER_INCREMENTS
        if _draws(library, scheme)
    }
    findings = {name: silent.get(name) or cells[scheme.name, name] for name in LAWS}
    return Row(
        library=library,
        release=_release(library),
        solver=scheme.name.removeprefix(f"{library} "),
        source=scheme.source,
        claimed=" / ".join(f"{o:g}" for o in (scheme.mean_square_order, scheme.weak_order) if o is not None),
        orders=_orders(findings["mean-square-order"]["measured"]),
        energy=tuple(cells[scheme.name, f"energy defect, {s.problem}"] for s in SETUPS),
        verdicts={
            name: _MARKS[Verdict(f["verdict"])] + (" +" if f["claimed"] else "")
            for name, f in findings.items()
        },
        notes=tuple(_notes(scheme, findings)),
    )


def _notes(scheme: Scheme, findings: Mapping[str, Any]) -> Iterator[str]:
    """Reasons of errors, and what a reader of the marks must know."""
    for name, found in findings.items():
        lines = found["message"].splitlines()
        if Verdict(found["verdict"]) is Verdict.ERROR and lines:
            # Below the case that could not be measured stand three lines of the error.
            yield f"{scheme.name}, {name}: {lines[-3] if lines[0].endswith(':') and len(lines) > 3 else lines[0]}"
        if found["message"] == _NO_AREAS:
            yield f"{scheme.name}, {name}: {_NO_AREAS}"
    limit, order = findings.get("right-limit"), findings.get("mean-square-order")
    if limit is None or order is None or Verdict(limit["verdict"]) is not Verdict.VIOLATED:
        return
    intervals = [m["interval"] for m in order["measured"]]
    if intervals and all(low is not None and low > 0.25 for low, _ in intervals):
        yield (
            f"{scheme.name}, right-limit: the error itself falls with h; the law extrapolates means in whole powers "
            "of h, and a mean that falls like h^½ looks to it like a wrong limit"
        )


def _draws(library: str, scheme: Scheme) -> bool:
    """Whether a step has noise of its own beside ΔW."""
    if library == "sepv":
        return False
    return scheme in getattr(import_module(f"sepv.adapters.{library}"), "DRAWING", ())


def path_cells(library: str, solver: PathSolver, effort: Effort) -> Iterator[Cell]:
    """The error of whole paths and the energy defect of a solver that hands state on, problem by problem."""
    for setup in SETUPS:
        yield Cell(
            solver.name,
            f"whole paths, {setup.problem}",
            (_release(library), *_suite_key(effort), setup.T, setup.steps, ORDER_PATHS, PATHS, ENERGY_STEPS),
            partial(_paths, solver, setup, effort.seed),
        )


def path_row(library: str, solver: PathSolver, cells: Mapping[tuple[str, str], Any]) -> Row:
    """The line of such a solver whose cells are measured: two laws, by the thresholds of the laws of these names."""
    found = [cells[solver.name, f"whole paths, {s.problem}"] for s in SETUPS]
    span = min(s.steps[-1] / s.steps[0] for s in SETUPS)
    limits = (
        ("mean-square-order", "order", solver.mean_square_order - 0.25),
        ("right-limit", "fall", 0.25 * np.log(span)),
    )
    verdicts = {}
    for law, number, limit in limits:
        intervals = [cell[number] for cell in found]
        above = all(low > limit for _, low, _ in intervals)
        below = any(high < limit for _, _, high in intervals)
        verdict = Verdict.HOLDS if above else Verdict.VIOLATED if below else Verdict.INCONCLUSIVE
        verdicts[law] = f"{_MARKS[verdict]} +"
    return Row(
        library=library,
        release=_release(library),
        solver=solver.name.removeprefix(f"{library} "),
        source=solver.source,
        claimed=f"{solver.mean_square_order:g}",
        orders=tuple(_interval(*cell["order"]) for cell in found),
        energy=tuple(cell["energy"] for cell in found),
        verdicts=verdicts,
        notes=tuple(cell["note"] for cell in found if cell["note"]),
    )


def _suite_key(effort: Effort) -> tuple[Any, ...]:
    return (__version__, effort.seed, effort.examples, effort.paths, effort.designs)


def _text_of(law: Law) -> str:
    """A digest of the law's own file, so that a law that measures something else is measured anew."""
    file = resources.files("sepv.properties") / f"test_{law.name.replace('-', '_')}.py"
    return hashlib.sha256(file.read_bytes()).hexdigest()


def _claimed(scheme: Scheme) -> tuple[Any, ...]:
    return (sorted(scheme.claims), scheme.mean_square_order, scheme.weak_order)


def _finding(scheme: Scheme, law: str, effort: Effort) -> dict[str, Any]:
    """What the table needs of one law's finding."""
    with np.errstate(over="ignore", invalid="ignore"):
        report = verify(scheme, laws=[law], effort=effort)
    if report.interrupted:
        raise KeyboardInterrupt
    finding = report.finding(law)
    return {
        "verdict": finding.verdict.value,
        "claimed": finding.claimed,
        "message": finding.message,
        "measured": (finding.witness or {}).get("measured", ()) if law == "mean-square-order" else (),
    }


def _paths(solver: PathSolver, setup: Setup, seed: int) -> dict[str, Any]:
    """Order and fall of the error as (estimate, low, high), the energy defect, and paths that failed."""
    alpha = FALSE_ALARM / len(SETUPS)
    problem, note = problems.by_name(setup.problem), ""
    errors = _path_errors(solver, problem, setup, seed)
    if any(errors.failures):
        counts = ", ".join(str(n) for n in errors.failures)
        note = (
            f"{solver.name}, {setup.problem}: {counts} of {ORDER_PATHS} paths failed with "
            f"{', '.join(str(n) for n in errors.steps)} steps and are left out at every number of steps"
        )
    order, decay = slope(errors, alpha), log_decay(errors, alpha)
    return {
        "order": (order.value, order.low, order.high),
        "fall": (-decay.value, -decay.high, -decay.low),
        "energy": _energy_of_paths(solver, problem, setup.T),
        "note": note,
    }


def _path_errors(solver: PathSolver, problem: Problem, setup: Setup, seed: int) -> StrongErrors:
    """As `sepv.convergence.strong_errors`, with whole paths by the solver's own code."""
    start, steps = np.array(problem.initial, dtype=np.float64), setup.steps
    finest = steps[-1]
    fine = wiener.increments(seed, T=setup.T, steps=finest, noises=problem.noises, paths=ORDER_PATHS)
    exact = exact_flow(problem, problem.random_step(setup.T, fine.sum(axis=0))).y
    ends = [solver.path(problem, start, setup.T / n, wiener.coarsen(fine, finest // n))[-1] for n in steps]
    errors = np.stack([y - exact for y in ends])
    arrived = np.isfinite(errors).all(axis=(0, 1))
    return StrongErrors(
        T=setup.T,
        steps=steps,
        squared=np.sum(errors[:, :, arrived] ** 2, axis=1),
        errors=errors[:, :, arrived],
        failures=tuple(int(np.count_nonzero(~np.isfinite(e).all(axis=0))) for e in errors),
        scale=float(np.max(np.abs(exact))),
    )


def _energy_of_scheme(scheme: Scheme, problem: Problem, T: float) -> str:
    with np.errstate(over="ignore", invalid="ignore"):
        result = ensemble(scheme, problem, h=T / ENERGY_STEPS, T=T, paths=PATHS, engine="numpy")
    failed = int(np.count_nonzero(result.status))
    return f"{failed} paths failed" if failed else _energy(problem, result.energy_defect)


def _energy_of_paths(solver: PathSolver, problem: Problem, T: float) -> str:
    dW = wiener.increments(0, T=T, steps=ENERGY_STEPS, noises=problem.noises, paths=PATHS)
    start = np.array(problem.initial, dtype=np.float64)
    H = problem.hamiltonian(solver.path(problem, start, T / ENERGY_STEPS, dW).swapaxes(0, 1))
    failed = int(np.count_nonzero(~np.isfinite(H).all(axis=0)))
    return f"{failed} paths failed" if failed else _energy(problem, np.abs(H - H[0]))


def _energy(problem: Problem, defects: Array) -> str:
    start = np.array(problem.initial, dtype=np.float64)
    return f"{float(np.max(defects)) / energy_ulp(problem, start, start):.2g}"


def _orders(measured: Sequence[Mapping[str, Any]]) -> tuple[str, ...]:
    """The cells of the measured order, from the law's witness; a dash where it measured none."""
    found = {m["problem"]: m for m in measured}
    cells = []
    for setup in SETUPS:
        m = found.get(setup.problem)
        cells.append("–" if m is None else _interval(m["estimate"], *m["interval"]))
    return tuple(cells)


def _interval(value: float, low: float, high: float) -> str:
    return f"{value:.2f} [{low:.2f}, {high:.2f}]"


def _release(library: str) -> str:
    return __version__ if library == "sepv" else version(library)


def rows(libraries: Sequence[str], effort: Effort, folder: Path | None, shown: Shown) -> list[Row]:
    """The rows of the libraries that are installed, after one of sepv's own for comparison."""
    jobs: list[tuple[str, Any]] = [("sepv", replace(energy_preserving, name="energy-preserving"))]
    for library in libraries:
        try:
            adapter = import_module(f"sepv.adapters.{library}")
        except ModuleNotFoundError as error:
            click.echo(f"{library} left out: no module named {error.name!r}", err=True)
            continue
        jobs += [(library, solver) for solver in (*adapter.SCHEMES, *adapter.PATHS)]
    cells = [
        cell
        for library, solver in jobs
        for cell in (path_cells if isinstance(solver, PathSolver) else scheme_cells)(library, solver, effort)
    ]
    found = measured(cells, folder, shown)
    return [
        (path_row if isinstance(solver, PathSolver) else scheme_row)(library, solver, found)
        for library, solver in jobs
    ]


def document(found: Sequence[Row], deviations: Sequence[Deviation], command: str) -> str:
    """The page, in Markdown."""
    contradicted = {d.solver for d in deviations}
    numbers = ["library", "version", "solver", "claimed order, mean-square / weak"]
    numbers += [f"measured order, {s.problem}" for s in SETUPS] + [
        f"energy defect, {s.problem}" for s in SETUPS
    ]
    first = []
    for r in found:
        mark = " †" if f"{r.library} {r.solver}".split(",")[0] in contradicted else ""
        first.append((r.library, r.release, r.solver, r.claimed + mark, *r.orders, *r.energy))
    second = [(f"{r.library} {r.solver}", *(r.verdicts.get(law, "") for law in LAWS)) for r in found]
    notes = [f"- {note}" for r in found for note in r.notes]
    sources = [f"- {r.library} {r.solver}: {r.source}" for r in found if r.library != "sepv"]
    parts = [
        "# What other libraries' Stratonovich solvers keep, and with which order",
        f"Made by `{command}` with sepv {__version__}; not edited by hand.",
        _introduction(),
        "## Orders and energy",
        _table(numbers, first),
        "† contradicted in the last section, where other problems than these two serve as well."
        if contradicted
        else "",
        "## Laws",
        "holds · – violated · ? inconclusive · n/a not applicable · error: not measured, reason below · + claimed",
        _table(["solver", *LAWS], second),
        "\n".join(notes),
        "## Where the claimed orders come from",
        "\n".join(sources),
        "## Where a library does not do what its documentation says",
        "\n\n".join(d.text for d in deviations)
        or "Nothing found that reproduces in the library's own terms.",
    ]
    return "\n\n".join(p for p in parts if p) + "\n"


def _introduction() -> str:
    steps = ", ".join(str(n) for n in SETUPS[0].steps)
    sentences = (
        "None of these solvers is made to keep energy or Casimirs: a law that is violated without being claimed",
        "is no fault of theirs. Claimed are the contract of a step, and the order that the documentation or, where",
        "it is silent, theory states for noise that commutes: in (1.1) all noises drive one field. Each solver runs",
        "through its own library's code in float64, with the increment given.",
        f"\n\nOrders are slopes of the rms error against the exact flow over [0, {SETUPS[0].T:g}] with",
        f"{steps} steps (sepv's own scheme truncates its increments and begins with {SETUPS[0].steps[0] // 2}), with",
        f"intervals over paths; the false-alarm rate of a whole run is {FALSE_ALARM:g}. Solvers that",
        f"take one state at a time get {FIRST_LOOK} paths, which leaves more verdicts open.",
        f"Energy defects are the largest |H(y_n) − H(y_0)| of {PATHS} paths over [0, 1] with {ENERGY_STEPS}",
        "steps, in energy ulps eps·|∇H|·|y|. A solver that hands state from step to step is measured over whole",
        "paths; its one step, started afresh, stands beside it.",
        "\n\nWhere a solver wants the space-time Lévy area beside the increment, it gets a normal one from a stream",
        "whose key is the increment: a step is a function of its arguments. Other Lévy areas are given as zero:",
        "they act through brackets of the noise fields, which vanish here.",
    )
    return " ".join(sentences).replace(" \n\n", "\n\n")


def _table(heading: Sequence[str], lines: Sequence[Sequence[str]]) -> str:
    rule = ["---"] * len(heading)
    return "\n".join("| " + " | ".join(line) + " |" for line in (heading, rule, *lines))


def deviations_shown_by(folder: Path) -> list[Deviation]:
    """The docstring and the output of every script that still shows its deviation."""
    shown = []
    for script in sorted(folder.glob("*.py")):
        done = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, check=False)
        if done.returncode != 1 or "Traceback" in done.stderr:
            click.echo(f"{script} left out: exit code {done.returncode}\n{done.stderr}", err=True)
            continue
        docstring = ast.get_docstring(ast.parse(script.read_text("utf-8"))) or script.stem
        title, _, rest = docstring.partition("\n")
        body = rest.split("Exit code 1")[0].strip()
        run = f"[`{folder.name}/{script.name}`]({folder.name}/{script.name}) prints"
        text = f"### {title}\n\n{body}\n\n{run}\n\n```\n{done.stdout.strip()}\n```"
        shown.append(Deviation(title.split(":")[0], text))
    return shown


@click.command()
@click.option("--out", type=click.Path(dir_okay=False, path_type=Path), help="Write the page to this file.")
@click.option(
    "--keep",
    type=click.Path(file_okay=False, path_type=Path),
    help="A folder for what is measured: what it holds is not measured again, so that an interrupted run goes on.",
)
@click.option("--library", "libraries", multiple=True, type=click.Choice(LIBRARIES), help="Only this one.")
@click.option(
    "--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Of examples and paths."
)
def main(out: Path | None, keep: Path | None, libraries: tuple[str, ...], seed: int) -> None:
    """Measure every law on every solver that the adapters cover, and write the table as Markdown."""
    # Counterexamples are not shown here, so that little is spent on simplifying them.
    effort = Effort(seed=seed, shrink_checks=50)
    if keep is not None:
        keep.mkdir(parents=True, exist_ok=True)
    try:
        with showing() as line:
            found = rows(libraries or LIBRARIES, effort, keep, line)
            line.update("the scripts that show deviations", 1.0)
            shown = deviations_shown_by(out.parent / "peers") if out else []
    except SepvError as error:
        raise click.ClickException(str(error)) from None
    except KeyboardInterrupt:
        click.echo(f"interrupted: what was measured is in {keep}" if keep else "interrupted", err=True)
        raise SystemExit(130) from None
    chosen = "".join(f" --library {name}" for name in libraries) + (f" --seed {seed}" if seed else "")
    target = f" --out {out}" if out else ""
    page = document(found, shown, f"python -m sepv.adapters.compliance{target}{chosen}")
    if out is None:
        click.echo(page)
    else:
        out.write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main()
