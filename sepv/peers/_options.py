"""What the commands that make a page of other libraries' solvers take."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from sepv.peers._compliance_measurements import LIBRARIES

_KEEP = (
    "A folder for what is measured: what it holds is not measured again, so that an interrupted run goes on."
)


def page_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """--out, --keep, --library and --seed."""
    for option in (
        click.option(
            "--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Of examples and paths."
        ),
        click.option(
            "--library", "libraries", multiple=True, type=click.Choice(LIBRARIES), help="Only this one."
        ),
        click.option("--keep", type=click.Path(file_okay=False, path_type=Path), help=_KEEP),
        click.option(
            "--out", type=click.Path(dir_okay=False, path_type=Path), help="Write the page to this file."
        ),
    ):
        command = option(command)
    return command
