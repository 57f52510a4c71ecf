"""The command line. Each command is a file of `sepv.commands`, loaded when it is called."""

from __future__ import annotations

import os
import shlex
import sys
from importlib import import_module
from typing import Any

import click

from sepv._arguments import did_you_mean
from sepv._version import __version__
from sepv.children import collect_seldom
from sepv.commands._shared import EXIT_CODES, WORDS_KEY, interruptible
from sepv.console import cannot_show, never_fail
from sepv.files import cache_folder

# The commands by heading, in the order of --help: each name is that of its module in
# `sepv.commands`.
COMMAND_GROUPS = {
    "Commands": (
        "verify",
        "compare",
        "bench",
        "run",
        "reproduce",
        "report",
        "trajectory",
        "list",
        "completion",
    ),
    "Other libraries": ("peers",),
    "For specialists": ("exact", "step", "hard", "growth", "solvability", "teeth"),
}
COMMANDS = tuple(name for names in COMMAND_GROUPS.values() for name in names)
_SETTINGS = {"help_option_names": ["-h", "--help"], "show_default": True}


class _Commands(click.Group):
    """The group of all commands, which imports a command's module when the command is called."""

    def make_context(self, info_name: str | None, args: list[str], *more: Any, **extra: Any) -> click.Context:
        """Make click's context, with the command line in it for result files."""
        words = shlex.join(["sepv", *args])  # also for `python -m sepv`
        for stream in (sys.stdout, sys.stderr):  # before click prints --help or an error
            if cannot_show(stream):
                never_fail(stream)
        with interruptible():
            context = super().make_context(info_name, args, *more, **extra)
        context.meta[WORDS_KEY] = words
        return context

    def invoke(self, ctx: click.Context) -> Any:
        """Invoke as click does; Ctrl-C has the same effect while a command is imported as while it
        works.
        """
        with interruptible():
            return super().invoke(ctx)

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002  (click's signature)
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:  # noqa: ARG002
        if cmd_name not in COMMANDS:
            return None
        module = import_module(f"sepv.commands._{cmd_name}")
        command: click.Command = module.list_ if cmd_name == "list" else getattr(module, cmd_name)
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the commands under their headings, in one column."""
        width = max(map(len, COMMANDS))
        limit = formatter.width - 6 - width
        for heading, names in COMMAND_GROUPS.items():
            with formatter.section(heading):
                entries = ((name, self.get_command(ctx, name)) for name in names)
                formatter.write_dl([(n.ljust(width), c.get_short_help_str(limit)) for n, c in entries if c])

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Resolve as click does; the error for an unknown name suggests the nearest command."""
        try:
            return super().resolve_command(ctx, args)
        except click.UsageError as error:
            word = did_you_mean(args[0], COMMANDS)
            text = f"No such command {word}. There are: {', '.join(COMMANDS)}."
            raise click.UsageError(text, ctx) from error


@click.group(cls=_Commands, context_settings=_SETTINGS, epilog=EXIT_CODES)
@click.version_option(__version__, prog_name="sepv")
def main() -> None:
    """Test which structural properties an integrator for dy = B(y)∇H(y)(dt + Σ c_j∘dW_j)
    really has.

    \b
    sepv verify energy-preserving            a built-in scheme
    sepv verify mypackage.mymodule:step      your own
    sepv compare energy-preserving midpoint  error, defects, time and work
    sepv reproduce 4.4                       a figure of the paper
    sepv list                                schemes, problems, laws
    sepv completion bash                     completion for your shell
    """
    collect_seldom()
    # Hypothesis stores a small cache in a directory, which by default is in the user's current
    # folder.
    if "HYPOTHESIS_STORAGE_DIRECTORY" not in os.environ:
        os.environ["HYPOTHESIS_STORAGE_DIRECTORY"] = str(cache_folder("hypothesis"))


if __name__ == "__main__":
    sys.exit(main())
