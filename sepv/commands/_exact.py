"""``sepv exact``: the exact flow to any number of digits."""

from __future__ import annotations

import click

from sepv.commands import _shared as cli

Row = tuple[float, ...]


@click.command(short_help="The exact solution at a random time, to any digits.")
@click.argument("problem")
@click.option(
    "--theta",
    required=True,
    type=cli.NumberList(float),
    metavar="θ",
    help="The random time t + Σ c_j W_j(t), of either sign.",
)
@click.option(
    "--y",
    "state",
    type=cli.NumberList(float),
    metavar="Y1,Y2,…",
    help="Where it starts. [default: the problem's initial state]",
)
@click.option("--digits", type=int, default=50, help="Significant digits.")
@click.option("--certify", is_flag=True, help="Enclose the result in balls (needs python-flint).")
@cli.friendly
def exact(problem: str, theta: Row, state: Row | None, digits: int, certify: bool) -> None:
    """The exact solution of PROBLEM (a name, a .json file of polynomial data, or module:attribute)
    at random time θ.

    It is computed by Taylor series in extended precision, and shown beside the closed form, if
    there is one, and beside the float64 result with its error. For a problem of Python functions,
    which have no digits beyond float64, the float64 result is shown with a bound of its error.
    Numbers of the command are rounded to binary64.

    \b
    sepv exact rigid-body --theta 8 --digits 50
    sepv exact pendulum --theta=-3 --y 0,3.1 --certify
    """
    from sepv.commands._reference import decimal, description, numbers, row
    from sepv.console import console
    from sepv.exact import exact_flow
    from sepv.reference.balls import require_flint
    from sepv.reference.elliptic import closed_form, has_closed_form
    from sepv.reference.flow import enclosed, taylor
    from sepv.reference.steps import require_digits
    from sepv.schemes import load_problem

    require_digits(digits)
    if certify:
        require_flint()
    chosen = load_problem(problem)
    time = numbers(theta, "--theta", 1)[0]
    y0 = numbers(state, "--y", chosen.dimension, chosen.initial)
    out = console()
    if chosen.data is None and not certify:
        fast = exact_flow(chosen, time, y0)
        out.print(f"{chosen.name}, y(0) = {row(y0)}, θ = {time!r}\n")
        out.print(
            f"float64 by {fast.method}, because Python functions have no further digits:", soft_wrap=True
        )
        for k, w in enumerate(fast.y, 1):
            out.print(f"y{k} = {float(w)!r}", soft_wrap=True)
        out.print(f"\nits error is at most {fast.error:.1e}, as it states itself")
        return
    data = description(chosen)
    value = taylor(data, y0, time, digits)
    fast = exact_flow(chosen, time, y0)
    out.print(f"{chosen.name}, y(0) = {row(y0)}, θ = {time!r}\n")
    out.print(f"{digits} digits by Taylor series, float64 by {fast.method}:", soft_wrap=True)
    for k, (v, w) in enumerate(zip(value, fast.y, strict=True)):
        out.print(f"y{k + 1} = {decimal(v, digits)}", soft_wrap=True)
        out.print(f"     {float(w)!r} in float64, off by {float(w - v):.1e}")
    out.print(f"\nfloat64 states an error of at most {fast.error:.1e}")
    if has_closed_form(data):
        form = closed_form(data, y0, time, digits)
        off = max(abs(float(a - b)) for a, b in zip(form, value, strict=True))
        out.print(f"the closed form, which shares no formula with the series, is {off:.1e} away")
    if certify:
        balls = enclosed(data, y0, time, digits)
        out.print("enclosed by balls (Taylor polynomials with Lagrange's remainder, step by step):")
        for k, ball in enumerate(balls):
            out.print(f"  y{k + 1} in {ball.str(digits)}", soft_wrap=True)
