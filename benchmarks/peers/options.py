"""Options and error handling that the commands for pages about other libraries' solvers share."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click

from sepv.console import ShownProgress, showing
from sepv.errors import SepvError
from sepv.peers.peer import installed, load
from sepv.schemes import Scheme

_KEEP_HELP = (
    "A folder for what is measured: what it holds is not measured again, so that an interrupted run goes on."
)


def page_options(known: Sequence[str]) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Add to a command the options --out, --keep, --seed, and --library,
    whose value is one of `known`.
    """

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
            click.option("--keep", type=click.Path(file_okay=False, path_type=Path), help=_KEEP_HELP),
            click.option(
                "--out", type=click.Path(dir_okay=False, path_type=Path), help="Write the page to this file."
            ),
        ):
            command = option(command)
        return command

    return add


def jobs_of(kind: str, libraries: Sequence[str]) -> list[tuple[str, Scheme]]:
    """The "integrators" or "thermostats" of the named libraries, or of all installed ones if none
    is named, each behind the name of its library.
    """
    listed = [load(name) for name in libraries] if libraries else installed()
    return [(peer.library, scheme) for peer in listed for scheme in getattr(peer, kind).values()]


@contextmanager
def measuring(keep: Path | None) -> Iterator[ShownProgress]:
    """Show progress on stderr. Errors of sepv become messages,
    and Ctrl-C says where the finished cells are stored.
    """
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
    """Write the page to the file `out`, or print it. `page` makes the text from the arguments of
    the command.
    """
    chosen = "".join(f" --library {name}" for name in libraries) + (f" --seed {seed}" if seed else "")
    text = page((f" --out {out}" if out else "") + chosen)
    if out is None:
        click.echo(text)
    else:
        out.write_text(text, encoding="utf-8")
