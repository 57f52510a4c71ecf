"""What every command takes: --debug, errors as one message, files to write."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from functools import wraps
from typing import Any

import click

from sepv.errors import SepvError, TargetError, UsageError

EXIT_CODES = """Exit codes: 0 all claimed laws hold; 1 a claimed law is violated, or not shown to hold within the
budget; 2 wrong usage; 3 the scheme crashed, hung, or could not be loaded; 130 interrupted."""

FILE = click.Path(dir_okay=False)


EXEC = click.option(
    "--exec", "programs", multiple=True, metavar="COMMAND",
    help="A program in any language (docs/protocol.md); may be repeated.",
)  # fmt: skip


@contextmanager
def candidates(
    targets: Iterable[str], programs: Iterable[str], problems: Iterable[Any] = ()
) -> Iterator[list[tuple[str, Any]]]:
    """(how a command names it, scheme) of every target and every program; the programs end with the block.

    Raises
    ------
    UsageError
        Where there is neither a target nor a program.
    """
    from sepv.target import load_scheme

    with ExitStack() as stack:
        found = [(target, load_scheme(target, problems=problems)) for target in targets]
        for command in programs:
            from sepv.external import load_program

            found.append((f"--exec {shlex.quote(command)}", stack.enter_context(load_program(command))))
        if not found:
            raise UsageError(
                expected="a scheme, or a program with --exec",
                received="neither",
                remedy="a built-in name, module:attribute, or --exec './program'",
            )
        yield found


def complete_schemes(_context: click.Context, _parameter: click.Parameter, incomplete: str) -> list[str]:
    """Built-in schemes, for shell completion."""
    from sepv import schemes

    return [name for name in schemes.ALL if name.startswith(incomplete)]


def complete_laws(_context: click.Context, _parameter: click.Parameter, incomplete: str) -> list[str]:
    """Laws, for shell completion."""
    from sepv.suite import LAWS

    return [name for name in LAWS if name.startswith(incomplete)]


def friendly(command: Callable[..., Any]) -> Callable[..., Any]:
    """Errors as one message and the documented exit code; the traceback only with --debug."""

    @wraps(command)
    def wrapper(*args: Any, debug: bool, **kwargs: Any) -> Any:
        try:
            return command(*args, debug=debug, **kwargs)
        except SepvError as error:
            if debug:
                raise
            click.echo(f"sepv: {error}", err=True)
            raise SystemExit(
                2 if isinstance(error, UsageError) and not isinstance(error, TargetError) else 3
            ) from None
        except OSError as error:
            if debug:
                raise
            click.echo(f"sepv: {error}", err=True)
            raise SystemExit(2) from None
        except KeyboardInterrupt:
            click.echo("sepv: interrupted", err=True)
            raise SystemExit(130) from None

    return click.option("--debug", is_flag=True, help="Show tracebacks.")(wrapper)
