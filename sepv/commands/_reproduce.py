"""``sepv reproduce``: the paper's figures, and a verdict on each statement made about them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from sepv.commands import _shared as cli
from sepv.errors import UsageError
from sepv.files import json_text, write_atomically

QUICK_SHARE = 1 / 32


@click.command(short_help="The paper's figures again, with verdicts.")
@click.argument("figures", nargs=-1, metavar="[FIGURE]...")
@click.option("-o", "--out", type=cli.FOLDER, help="Folder for JSON, CSV, SVG, PNG and PDF.")
@click.option("--json", "json_file", type=cli.OUT, help="Write the whole record to this file.")
@click.option("--errata", is_flag=True, help="Only what does not hold as printed, with its evidence.")
@click.option("--no-figures", is_flag=True, help="With --out: numbers only, matplotlib is not needed.")
@click.option(
    "--quick",
    is_flag=True,
    help=f"A share of {QUICK_SHARE:g} of the samples and steps; verdicts may stay open.",
)
@click.option("--seed", type=cli.NATURAL, default=0, help="Of all Wiener paths.")
@click.option("--workers", type=cli.Workers(), default=2, help="Processes, or a Dask scheduler's address.")
@click.option(
    "--engine", type=click.Choice(["auto", "numpy"]), default="auto",
    help="auto: compiled where the extra fast has code for the scheme.",
)  # fmt: skip
@click.option("-q", "--quiet", is_flag=True, help="Only the last line.")
@cli.friendly
def reproduce(figures: cli.Names, out: str | None, json_file: str | None, **options: Any) -> None:
    """The paper's Figures 4.1 to 4.6, computed again, with a verdict on each statement about them.

    FIGURE is one of 4.1 to 4.6, "theory" for the statements of §2, §3 and the remarks, or "text"
    for formulas and arguments that do not hold as printed. Errors are measured against exact
    solutions. A statement that fails is a finding about the paper, so it does not change the exit
    code.

    \b
    sepv reproduce                      everything, about four minutes
    sepv reproduce 4.3                  one figure
    sepv reproduce 4.4 -o figures       with its numbers and pictures
    sepv reproduce --json paper.json    for sepv report
    sepv reproduce --errata             what does not hold as printed

    Exit code 0, or 2 for wrong usage.
    """  # fmt: skip
    from sepv.console import console, print_sentence
    from sepv.paper.errata import page
    from sepv.paper.on_terminal import show, summary, watching
    from sepv.paper.record import Size
    from sepv.paper.suite import reproduce as run

    if options["errata"]:
        click.echo(page(), nl=False)
        return
    folder = _folder(out, draws=not options["no_figures"])
    size = Size(
        share=QUICK_SHARE if options["quick"] else 1.0, seed=options["seed"], engine=options["engine"]
    )
    with watching(options["quiet"]) as progress:
        reproduction = run(figures, size=size, workers=options["workers"], progress=progress)
    cli.save_json(json_file, "reproduction", reproduction.to_json(), indent=None)
    if folder is not None:
        _write(reproduction, folder, draws=not options["no_figures"])
    screen = console()
    if not options["quiet"]:
        show(reproduction, screen)
    print_sentence(screen, summary(reproduction))


def _folder(out: str | None, *, draws: bool) -> Path | None:
    """Make the folder for the output before anything is computed; None if the option is left out.

    Raises a UsageError if the folder cannot be made, or if pictures are to be drawn and matplotlib
    is missing.
    """
    if out is None:
        return None
    if draws:
        from sepv.pictures import require_matplotlib

        require_matplotlib("or --no-figures: numbers and verdicts need none")
    folder = Path(out)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(
            expected="a folder that exists or can be made",
            received=f"{out} ({error.strerror})",
            remedy="name another",
        ) from None
    return folder


def _write(reproduction: Any, folder: Path, *, draws: bool) -> None:
    """Write the whole record, and the numbers and pictures of each panel, to a folder."""
    cli.save_json(str(folder / "reproduction.json"), "reproduction", reproduction.to_json(), indent=None)
    for panel in reproduction.panels:
        write_atomically(str(folder / f"{panel.key}.json"), json_text(panel.to_json(), indent=None))
        write_atomically(str(folder / f"{panel.key}.csv"), panel.to_csv())
        if draws:
            from sepv.paper.record import draw

            draw(panel, folder)
