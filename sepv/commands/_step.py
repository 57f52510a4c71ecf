"""``sepv step``: one step of a scheme to any number of digits, beside float64."""

from __future__ import annotations

from typing import Any

import click

from sepv.commands import _shared as cli
from sepv.errors import SepvError

Row = tuple[float, ...]


@click.command(short_help="One step to any number of digits, beside float64.")
@click.argument("scheme")
@click.argument("problem")
@click.option(
    "--y",
    "state",
    type=cli.NumberList(float),
    metavar="Y1,Y2,…",
    help="The state. [default: the problem's initial state]",
)
@click.option(
    "--h", required=True, type=cli.NumberList(float), metavar="FLOAT", help="The step size, of either sign."
)
@click.option(
    "--dW", "noise", type=cli.NumberList(float), metavar="W1,W2,…", help="The Wiener increments. [default: 0]"
)
@click.option("--digits", type=int, default=50, help="Significant digits.")
@click.option("--certify", is_flag=True, help="Prove it by ball arithmetic (needs python-flint).")
@cli.friendly
def step(
    scheme: str, problem: str, state: Row | None, h: Row, noise: Row | None, digits: int, certify: bool
) -> None:
    """One step of SCHEME on PROBLEM in extended precision,
    beside the float64 result and its error in ulp.

    SCHEME is one of the paper's schemes, averaged-vector-field, collocation-s or gauss-s (s = 1 …
    6), or your own scheme as module:attribute, which is compared with scheme (2.1). PROBLEM is a
    name, a .json file of polynomial data, or module:attribute.

    \b
    sepv step energy-preserving rigid-body --h 0.1 --dW 0.05
    sepv step collocation-3 lotka-volterra --h 0.01 --dW=-0.2 --digits 100
    """
    from sepv.commands._reference import description, numbers, row
    from sepv.console import console
    from sepv.reference.balls import require_flint
    from sepv.reference.steps import find_equation, reference_step, require_digits
    from sepv.schemes import load_problem

    require_digits(digits)
    if certify:
        require_flint()
    equation = find_equation("energy-preserving" if ":" in scheme else scheme)
    chosen = load_problem(problem)
    data = description(chosen)
    y0 = numbers(state, "--y", chosen.dimension, chosen.initial)
    size, dW = numbers(h, "--h", 1)[0], numbers(noise, "--dW", chosen.noises, [0.0] * chosen.noises)
    exact_step = reference_step(equation, data, y0, size, dW, digits)
    out = console()
    out.print(f"{equation.name} · {equation.source} · {chosen.name}")
    out.print(f"y = {row(y0)}, h = {size!r}, dW = {row(dW)}\n")
    _show(out, scheme, chosen, y0, size, dW, exact_step, digits)
    if certify:
        from sepv.reference.certify import certify as proved

        out.print()
        out.print(proved(data, y0, size, dW, exact_step).describe(), soft_wrap=True)


def _show(
    out: Any, scheme: str, problem: Any, y0: Any, h: float, dW: Any, exact_step: Any, digits: int
) -> None:
    import numpy as np

    from sepv.commands._reference import decimal
    from sepv.law import state_ulp
    from sepv.reference.problem import exact_problem
    from sepv.schemes import ask, load_scheme

    y1, missing = None, ""
    try:
        y1 = ask(load_scheme(scheme), problem, np.array(y0), h, np.array(dW, dtype=np.float64))
    except SepvError as error:
        missing = str(error).splitlines()[0]
    unit = state_ulp(np.array(y0), *([] if y1 is None else [y1]))
    out.print(f"{digits} digits, and float64 with its error in ulp of the largest component:")
    for k, v in enumerate(exact_step.y1):
        out.print(f"y{k + 1} = {decimal(v, digits)}", soft_wrap=True)
        if y1 is not None:
            out.print(
                f"     {float(y1[k])!r} in float64, off by {abs(float(v - float(y1[k]))) / unit:.3f} ulp"
            )
    exact = exact_problem(problem.data, digits + 15)
    before, after = exact.state(y0), exact_step.y1
    defect = exact.hamiltonian(after) - exact.hamiltonian(before)
    text = f"\nH(y1) − H(y0) = {float(defect):.2e}"
    if y1 is not None:
        off = exact.hamiltonian(exact.state(y1)) - exact.hamiltonian(before)
        text += f", of the float64 result {float(off):.2e}"
    out.print(text)
    out.print(f"condition number of the solve {max(map(sum, exact_step.condition)):.3g}")
    if missing:
        out.print(f"no float64 result: {missing}")
