"""``sepv run``: one long path, with progress; Ctrl-C keeps what was done."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import click

from sepv.commands._shared import EXEC, FILE, PROBLEM, candidates, friendly, save_json
from sepv.schemes._point_distributions import NAMES


@click.command(short_help="One path over many steps.")
@click.argument("scheme", required=False)
@PROBLEM
@EXEC
@click.option("--h", "h", type=float, default=0.01, show_default=True, help="The step size.")
@click.option(
    "--steps",
    type=float,
    default=1e6,
    show_default=False,
    help="How many steps, such as 1e8.  [default: 1e6]",
)
@click.option("--seed", type=int, default=0, show_default=True)
@click.option("--every", type=float, help="Keep the state after each so many steps [default: a thousandth].")
@click.option("--compensated", is_flag=True, help="Kahan's summation of the steps.")
@click.option(
    "--increments", type=click.Choice(NAMES), help="Instead of those the scheme is meant for (weak schemes)."
)
@click.option("--engine", type=click.Choice(["auto", "numpy", "compiled"]), default="auto", show_default=True)
@click.option("--json", "json_file", type=FILE, help="Write the kept states and defects.")
@click.option("-q", "--quiet", is_flag=True, help="No progress; print one line, the defects.")
@friendly
def run(
    scheme: str | None, problem: str, programs: tuple[str, ...], h: float, steps: float, seed: int,
    every: float | None, compensated: bool, increments: str | None,
    engine: str, json_file: str | None, quiet: bool,
    debug: bool,  # noqa: ARG001  (every command takes it)
) -> None:  # fmt: skip
    """One path of SCHEME over many steps: its end, its invariants, its price.

    \b
    sepv run energy-preserving --steps 1e8 --compensated
    sepv run mymodule:step -p mymodule:problem --steps 1e5

    Ctrl-C stops it, shows and writes what was done, and exits with 130.
    """
    from sepv.errors import UsageError
    from sepv.files import finite, require_folder
    from sepv.schemes import load_problem
    from sepv.simulate import long_path

    require_folder(json_file)
    count = _whole("steps", steps)
    kept = _whole("every", every) if every is not None else max(1, count // 1000)
    system = load_problem(problem)
    with candidates([scheme] if scheme else [], programs, [system]) as found, _bar(count, quiet) as progress:
        if len(found) > 1:
            raise UsageError(
                expected="one scheme", received=f"{len(found)}", remedy="sepv run, once for each of them"
            )
        scheme, own = found[0]
        said: list[BaseException] = []
        if own.solve is None and not own.step.__module__.startswith("sepv."):
            own = replace(own, step=_remembering(own.step, said))
        path = long_path(
            own, system, h=h, steps=count, seed=seed, every=kept,
            compensated=compensated, increments=increments, engine=engine, progress=progress,
        )  # fmt: skip
    counted = own.solve is not None
    casimirs = bool(system.casimirs or system.linear_casimirs)
    _show(scheme, problem, path, quiet, counted=counted, casimirs=casimirs)
    if json_file:
        record = _record(scheme, problem, h, seed, path)
        if not casimirs:
            record["casimir_defect"] = None
        if not counted:
            record["iterations"] = None
        save_json(json_file, "path", finite(record), indent=None)
    if path.interrupted:
        raise SystemExit(130)
    if path.status:
        raise UsageError(
            expected=f"a path of {count:,} steps",
            received=f"{path.steps:,} steps; the next one, from y = {path.y.tolist()} with h = {h!r}, failed: "
            + (_words(said[-1]) if said else path.status.text if counted else _UNCOUNTED[path.status.name]),
            remedy="a smaller --h",
        )


# What is known of a step that says nothing but its answer.
_UNCOUNTED = {
    "NO_CONVERGENCE": "the scheme refused it",
    "OVERFLOW": "its answer, or B or ∇H there, is not finite",
    "LEFT_DOMAIN": "its answer is outside the problem's domain",
}


def _words(error: BaseException) -> str:
    return f"the scheme raised {type(error).__name__}: {error}".partition("\n")[0]


def _remembering(step: Callable[..., Any], said: list[BaseException]) -> Callable[..., Any]:
    """The step; the last of its own exceptions is kept, which the status of a path does not tell."""

    def asked(problem: Any, y: Any, h: float, dW: Any) -> Any:
        try:
            return step(problem, y, h, dW)
        except Exception as error:
            said[:] = [error]
            raise

    return asked


def _whole(name: str, value: float) -> int:
    from sepv.errors import UsageError

    if not (1 <= value < 2**62) or value != int(value):
        raise UsageError(
            expected=f"--{name}, a whole number ≥ 1", received=f"{value!r}", remedy="such as 1e6"
        )
    return int(value)


@contextmanager
def _bar(total: int, quiet: bool) -> Iterator[Callable[[int, int], None]]:
    from sepv.verification._progress import showing

    with showing(quiet) as shown:
        yield lambda done, _total: shown.update(f"{done:,} of {total:,} steps", done / total)


def _show(scheme: str, problem: str, path: Any, quiet: bool, *, counted: bool, casimirs: bool) -> None:
    from sepv._terminal import Column, Table, print_table
    from sepv.verification._report import console

    unit = 2.0**-52 * max(path.steps, 1) ** 0.5
    if quiet:
        second = f", Casimirs {path.casimir_defect:.3g}" if casimirs else ""
        console().print(
            f"{path.steps:,} step{'s' * (path.steps != 1)}: energy {path.energy_defect:.3g}{second} at most"
        )
        return
    rows = [
        (
            "path",
            f"{scheme} on {problem}, {path.engine} engine" + (f" ({path.reason})" if path.reason else ""),
        ),
        ("steps", f"{path.steps:,} of {path.planned:,}" + (" (interrupted)" if path.interrupted else "")),
        ("time", f"{path.seconds:.3g} s, {path.seconds / max(path.steps, 1) * 1e9:.3g} ns a step"),
        ("end", f"t = {path.t:g}, y = {[float(v) for v in path.y]}"),
        ("energy", f"largest defect {path.energy_defect:.3g} = {path.energy_defect / unit:.3g} eps·√N"),
    ]
    if casimirs:
        rows.append(
            (
                "Casimirs",
                f"largest defect {path.casimir_defect:.3g} = {path.casimir_defect / unit:.3g} eps·√N",
            )
        )
    if counted:
        rows.append(("work", f"{path.iterations / max(path.steps, 1):.3g} iterations a step"))
    print_table(Table((Column("what"), Column("found", words=True)), rows, headed=False), console())


def _record(scheme: str, problem: str, h: float, seed: int, path: Any) -> dict[str, Any]:
    return {
        "scheme": scheme, "problem": problem, "h": h, "seed": seed, "steps": path.steps, "planned": path.planned,
        "interrupted": path.interrupted, "status": path.status.text, "engine": path.engine,
        "y": path.y.tolist(), "W": path.W.tolist(), "times": path.times.tolist(), "states": path.states.T.tolist(),
        "energy_defects": path.energy_defects.tolist(), "energy_defect": path.energy_defect,
        "casimir_defect": path.casimir_defect, "iterations": path.iterations, "seconds": path.seconds,
    }  # fmt: skip
