"""``sepv peers``: other libraries' solvers that the commands of sepv can name."""

from __future__ import annotations

import click

from sepv.commands._shared import friendly
from sepv.console import Table, columns, print_table


@click.command(short_help="Solvers of other libraries, by name.")
@friendly
def peers() -> None:
    """Show the libraries whose solvers sepv can name, and the solvers' names if the library is
    installed.

    \b
    sepv peers
    sepv verify sdeint-strat-heun
    sepv compare energy-preserving diffrax-heun

    A package adds its own library by an entry point of the group sepv.peers (docs/maintainers.md,
    point 6).
    """
    from sepv.console import console
    from sepv.peers.peer import installed, names

    here = {peer.library: peer for peer in installed()}
    rows = []
    for library in names():
        peer = here.get(library)
        solvers = (
            [f"{library}-{name}" for name in (*peer.schemes, *peer.integrators, *peer.thermostats)]
            if peer
            else []
        )
        drivers = [f"{library}-{name}" for name in peer.drivers()] if peer else []
        state = ", ".join(solvers) if peer else f"not installed: pip install {library}"
        rows.append((library, state, ", ".join(drivers)))
    heads = columns(["library"]) + columns(["verify", "compare"], words=True)
    print_table(Table(heads, rows), console())
