"""What the commands that make a page of other libraries' solvers take, and what they do around it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click

from sepv.console import Shown, showing
from sepv.errors import SepvError

_KEEP = (
    "A folder for what is measured: what it holds is not measured again, so that an interrupted run goes on."
)


def page_options(known: Sequence[str]) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """--out, --keep, --library, one of the known, and --seed."""

    def add(command: Callable[..., Any]) -> Callable[..., Any]:
        for option in (
            click.option(
                "--seed",
                type=click.IntRange(min=0),
                default=0,
                show_default=True,
                help="Of examples and paths.",
            ),
            click.option(
                "--library", "libraries", multiple=True, type=click.Choice(known), help="Only this one."
            ),
            click.option("--keep", type=click.Path(file_okay=False, path_type=Path), help=_KEEP),
            click.option(
                "--out", type=click.Path(dir_okay=False, path_type=Path), help="Write the page to this file."
            ),
        ):
            command = option(command)
        return command

    return add


@contextmanager
def measuring(keep: Path | None) -> Iterator[Shown]:
    """Progress on stderr; an error of sepv is a message, and Ctrl-C says where what was measured is."""
    if keep is not None:
        keep.mkdir(parents=True, exist_ok=True)
    try:
        with showing() as line:
            yield line
    except SepvError as error:
        raise click.ClickException(str(error)) from None
    except KeyboardInterrupt:
        click.echo(f"interrupted: what was measured is in {keep}" if keep else "interrupted", err=True)
        raise SystemExit(130) from None


def put(out: Path | None, page: Callable[[str], str], libraries: Sequence[str], seed: int) -> None:
    """Write the page that is made with these arguments, or print it."""
    chosen = "".join(f" --library {name}" for name in libraries) + (f" --seed {seed}" if seed else "")
    text = page((f" --out {out}" if out else "") + chosen)
    if out is None:
        click.echo(text)
    else:
        out.write_text(text, encoding="utf-8")
