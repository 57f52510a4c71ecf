"""``sepv run``: one long path, with progress; after Ctrl-C the finished part is shown."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import click

from sepv.commands import _shared as cli
from sepv.console import Column, Table, print_table
from sepv.errors import UsageError
from sepv.files import finite
from sepv.schemes import POINT_LAWS


@click.command(short_help="One path over many steps.")
@click.argument("scheme", required=False)
@cli.PROBLEM_OPTION
@cli.EXEC
@click.option("--h", "h", type=float, default=0.01, help="The step size.")
@click.option(
    "--steps",
    type=float,
    default=1e6,
    show_default=False,
    help="How many steps, such as 1e8.  [default: 1e6]",
)
@click.option("--seed", type=int, default=0)
@click.option("--every", type=float, help="Keep the state after each so many steps [default: a thousandth].")
@click.option("--compensated", is_flag=True, help="Kahan's summation of the steps.")
@click.option(
    "--increments",
    type=click.Choice(POINT_LAWS),
    help="Instead of those the scheme is meant for (weak schemes).",
)
@click.option("--engine", type=click.Choice(["auto", "numpy", "compiled"]), default="auto")
@click.option("--json", "json_file", type=cli.OUT, help="Write the kept states and defects.")
@click.option("-q", "--quiet", is_flag=True, help="No progress; print one line, the defects.")
@cli.friendly
def run(
    scheme: str | None, problem: str, programs: cli.Names, h: float, steps: float, seed: int, every: float | None,
    compensated: bool, increments: str | None, engine: str, json_file: str | None, quiet: bool,
) -> None:  # fmt: skip
    """One path of SCHEME over many steps: its end state, the defects of its invariants,
    its time and work.

    \b
    sepv run energy-preserving --steps 1e8 --compensated
    sepv run mymodule:step -p mymodule:problem --steps 1e5

    Ctrl-C stops the path, shows and writes its finished part, and exits with 130.
    """
    from sepv.console import showing
    from sepv.schemes import load_problem
    from sepv.simulate import long_path

    count = _whole("steps", steps)
    stride = _whole("every", every) if every is not None else max(1, count // 1000)
    system = load_problem(problem)
    names = [scheme] if scheme else []
    with showing(quiet) as shown, cli.candidates(names, programs, shown.update, [system]) as chosen:
        if len(chosen) > 1:
            raise UsageError(
                expected="one scheme", received=f"{len(chosen)}", remedy="sepv run, once for each of them"
            )
        scheme, method = chosen[0]
        remarks: list[str] = []
        if method.solve is None and not method.step.__module__.startswith("sepv."):
            method = replace(method, step=_remembering(method.step, remarks))
        path = long_path(
            method, system, h=h, steps=count, seed=seed, every=stride,
            compensated=compensated, increments=increments, engine=engine,
            progress=lambda done, _: shown.update(f"{done:,} of {count:,} steps", done / count),
        )  # fmt: skip
    counted = method.solve is not None
    casimirs = bool(system.casimirs or system.linear_casimirs)
    _show(scheme, problem, path, quiet, counted=counted, casimirs=casimirs)
    if json_file:
        record = {
            "scheme": scheme, "problem": problem, "h": h, "seed": seed, "steps": path.steps, "planned": path.planned,
            "interrupted": path.interrupted, "status": path.status.text, "engine": path.engine,
            "y": path.y.tolist(), "W": path.W.tolist(), "times": path.times.tolist(),
            "states": path.states.T.tolist(), "energy_defects": path.energy_defects.tolist(),
            "energy_defect": path.energy_defect, "casimir_defect": path.casimir_defect if casimirs else None,
            "iterations": path.iterations if counted else None, "seconds": path.seconds,
        }  # fmt: skip
        cli.save_json(json_file, "path", finite(record), indent=None)
    if path.interrupted:
        raise SystemExit(130)
    if path.status:
        raise UsageError(
            expected=f"a path of {count:,} steps",
            received=f"{path.steps:,} steps; the next one, from y = {path.y.tolist()} with h = {h!r}, failed: "
            + (
                remarks[-1]
                if remarks
                else path.status.text
                if counted
                else _WORDS_WITHOUT_SOLVER[path.status.name]
            ),
            remedy="a smaller --h",
        )


# The words for each status of a step of a scheme without a solver of sepv; such a solver would say
# more.
_WORDS_WITHOUT_SOLVER = {
    "NO_CONVERGENCE": "the scheme refused it",
    "OVERFLOW": "its answer, or B or ∇H there, is not finite",
    "LEFT_DOMAIN": "its answer is outside the problem's domain",
}


def _remembering(step: Callable[..., Any], remarks: list[str]) -> Callable[..., Any]:
    """Wrap a step: `remarks` then holds its last exception in words,
    which the status of a path does not contain.
    """

    def remembered(problem: Any, y: Any, h: float, dW: Any) -> Any:
        try:
            return step(problem, y, h, dW)
        except Exception as error:
            remarks[:] = [f"the scheme raised {type(error).__name__}: {error}".partition("\n")[0]]
            raise

    return remembered


def _whole(name: str, value: float) -> int:
    """The value of an option that takes a number such as 1e8, as an int;
    a UsageError if it is no whole number ≥ 1.
    """
    if not (1 <= value < 2**62) or value != int(value):
        raise UsageError(
            expected=f"--{name}, a whole number ≥ 1", received=f"{value!r}", remedy="such as 1e6"
        )
    return int(value)


def _show(scheme: str, problem: str, path: Any, quiet: bool, *, counted: bool, casimirs: bool) -> None:
    """Print the path: its end, its defects, its time, and its iterations if the solver has
    `counted` them.
    """
    from sepv.console import console

    unit = 2.0**-52 * max(path.steps, 1) ** 0.5
    if quiet:
        second = f", Casimirs {path.casimir_defect:.3g}" if casimirs else ""
        steps = f"{path.steps:,} step{'s' * (path.steps != 1)}"
        console().print(f"{steps}: energy {path.energy_defect:.3g}{second} at most")
        return
    why = f" ({path.reason})" if path.reason else ""
    size = "largest defect {0:.3g} = {1:.3g} eps·√N"
    rows = [
        ("path", f"{scheme} on {problem}, {path.engine} engine{why}"),
        ("steps", f"{path.steps:,} of {path.planned:,}" + (" (interrupted)" if path.interrupted else "")),
        ("time", f"{path.seconds:.3g} s, {path.seconds / max(path.steps, 1) * 1e9:.3g} ns a step"),
        ("end", f"t = {path.t:g}, y = {[float(v) for v in path.y]}"),
        ("energy", size.format(path.energy_defect, path.energy_defect / unit)),
    ]
    if casimirs:
        rows.append(("Casimirs", size.format(path.casimir_defect, path.casimir_defect / unit)))
    if counted:
        rows.append(("work", f"{path.iterations / max(path.steps, 1):.3g} iterations a step"))
    print_table(Table((Column("what"), Column("found", words=True)), rows, headed=False), console())
