"""``sepv completion``: the script that completes commands, options, schemes and laws in a shell."""

from __future__ import annotations

import click
from click.shell_completion import get_completion_class

from sepv.commands._shared import friendly


@click.command(short_help="The completion script for bash, zsh or fish.")
@click.argument("shell", type=click.Choice(["bash", "zsh", "fish"]))
@friendly
def completion(shell: str) -> None:
    """Print the completion script for SHELL: commands, options, schemes and laws.

    \b
    sepv completion bash >> ~/.bashrc
    sepv completion zsh >> ~/.zshrc
    sepv completion fish > ~/.config/fish/completions/sepv.fish
    """
    program = click.get_current_context().find_root().command
    kind = get_completion_class(shell)
    assert kind is not None  # click has all three
    click.echo(kind(program, {}, "sepv", "_SEPV_COMPLETE").source())
