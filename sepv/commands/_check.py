"""``sepv check``: whether a bundle of ``sepv submit`` is whole, and what it says is seen again."""

from __future__ import annotations

from contextlib import ExitStack

import click
from rich.text import Text

from sepv.commands._shared import NATURAL, friendly

_EXIT_CODES = """Exit codes: 0 all is as stated; 1 something is not; 2 no bundle, or wrong usage; 3 the scheme cannot be
loaded here, so that nothing was measured again; 130 interrupted."""


@click.command(epilog=_EXIT_CODES, short_help="Check a bundle, and measure a part of it again.")
@click.argument("path", metavar="BUNDLE", type=click.Path())
@click.option(
    "--share", type=click.FloatRange(0, 1, min_open=True), default=0.25,
    help="Of the laws that are measured again.",
)  # fmt: skip
@click.option("--seed", type=NATURAL, help="Of the choice. [default: another one each time]")
@click.option("--no-run", is_flag=True, help="Schema, hashes and counts alone; no code of the scheme is run.")
@friendly
def check(path: str, share: float, seed: int | None, no_run: bool) -> None:
    """Check schema, hashes, counts and level of BUNDLE; then measure counterexamples and a random share of laws again.

    \b
    sepv check scheme.zip
    sepv check scheme.zip --share 1

    The scheme is loaded as it was named when the bundle was made, and its code runs: start this where it can be found.
    """
    from sepv.errors import TargetError
    from sepv.external import load_program
    from sepv.verification import _report as page
    from sepv.verification import consistent
    from sepv.verification._progress import showing
    from sepv.verification._submission import Outcome, again, read
    from sepv.verification._verify import load_candidate

    found, out = read(path), page.console()
    asked = found.asked
    page.line(out, Text(f"{asked.words}: schema and hashes are right"))
    outcomes: list[Outcome] = []

    def tell(outcome: Outcome) -> None:
        outcomes.append(outcome)
        word, style = ("as stated", "green") if outcome.right else ("NOT AS STATED", "bold red")
        page.line(out, Text(f"{outcome.what}: ").append(word, style=style).append(f" ({outcome.text})"))

    for outcome in consistent(found):
        tell(outcome)
    if not no_run:
        with ExitStack() as stack:
            try:
                own = stack.enter_context(load_program(asked.program)) if asked.program else asked.target
                scheme = load_candidate(own, asked.claims, asked.problems or None)
            except TargetError as error:
                click.echo(f"sepv: {error}\nNothing was measured again.", err=True)
                raise SystemExit(3) from None
            shown = stack.enter_context(showing(False))
            for outcome in again(found, scheme, share=share, seed=seed):
                shown.update(f"after {outcome.what}")
                tell(outcome)
    wrong = [o.what for o in outcomes if not o.right]
    last = f"Not as stated: {', '.join(wrong)}." if wrong else "All as stated."
    page.line(out, Text(last, style="bold red" if wrong else "green"))
    raise SystemExit(1 if wrong else 0)
