"""Parts that every command uses: --debug, errors as one message, files to write."""

from __future__ import annotations

import errno
import math
import os
import shlex
import sys
import traceback
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from functools import wraps
from typing import Any

import click

from sepv._arguments import hex_float
from sepv.children import interruption_answered
from sepv.commands._watch import EXIT_DEFECT, defect
from sepv.console import printable
from sepv.errors import SepvError, TargetError, UsageError
from sepv.files import require_folder

EXIT_CODES = """Exit codes: 0 all claimed laws hold; 1 a claimed law is violated, or not shown to hold within the
budget; 2 wrong usage; 3 the scheme crashed, hung, or could not be loaded; 70 sepv itself failed; 130 interrupted."""
# The key of the typed command line in click's context.
WORDS_KEY = "sepv.words"
# Errors of the system that no other arguments mend: a full or broken device, no more descriptors,
# memory or processes.
_SYSTEM_LACKS = {
    errno.ENOSPC,
    errno.EDQUOT,
    errno.EIO,
    errno.EBADF,
    errno.EMFILE,
    errno.ENFILE,
    errno.ENOMEM,
    errno.EAGAIN,
}


class _Folder(click.Path):
    """The type of an option that takes a folder; help says FOLDER."""

    def __init__(self) -> None:
        super().__init__(file_okay=False)
        self.name = "folder"


# Types of options for files and folders, FILE and FOLDER in help. `friendly` checks that an OUT can
# be written.
FILE, OUT, FOLDER = click.Path(dir_okay=False), click.Path(dir_okay=False), _Folder()


class Finite(click.FloatRange):
    """A finite number within bounds; click itself accepts NaN within any bounds."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Convert as click does, and refuse numbers that are not finite."""
        number = super().convert(value, param, ctx)
        if not math.isfinite(number):
            self.fail(f"{value!r} is not a finite number", param, ctx)
        return number


NATURAL, COUNT, POSITIVE = click.IntRange(min=0), click.IntRange(min=1), Finite(min=0, min_open=True)
Names = tuple[str, ...]


def say(text: str) -> None:
    """Print a line on stderr. Control characters are escaped,
    because files of other people may contain them.
    """
    click.echo(printable(text), err=True)


def save_json(path: str | None, name: str, data: dict[str, Any], *, indent: int | None = 1) -> None:
    """Write a command's result, one of `sepv.files.RESULTS`, to a JSON file;
    do nothing if the path is None.
    """
    if path is not None:
        from sepv.files import write_json

        write_json(path, name, data, command=typed(), indent=indent)


def typed() -> str:
    """The command line as it was typed; empty outside a command."""
    context = click.get_current_context(silent=True)
    return str(context.meta.get(WORDS_KEY, "")) if context else ""


def listed(_context: click.Context, _parameter: click.Parameter, values: Names) -> Names:
    """The names given to an option that takes several names,
    separated by commas or by repeating the option.
    """
    names = tuple(name.strip() for value in values for name in value.split(",") if name.strip())
    if values and not names:
        raise click.BadParameter("expected a name, received none: name one, or leave the option out")
    return names


class NumberList(click.ParamType):  # type: ignore[type-arg]  # generic in the newest click alone
    """The type of an option that takes several numbers separated by commas, decimal or hexadecimal,
    and returns them as a tuple.
    """

    name = "N,N,…"

    def __init__(self, kind: type) -> None:
        self.kind = kind

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Convert a text to a tuple of numbers."""
        if not isinstance(value, str):
            return value
        try:
            numbers = tuple(hex_float(p) if "x" in p.lower() else self.kind(p) for p in value.split(","))
            if all(map(math.isfinite, numbers)):
                return numbers
        except ValueError:
            pass
        self.fail(f"{value!r}: finite numbers separated by commas, such as 0.5,0x1p-3", param, ctx)


PROBLEM_OPTION = click.option(
    "--problem", "-p", default="rigid-body", metavar="PROBLEM", help="By name, file.json or module:attribute."
)
CLAIM_OPTION = click.option(
    "--claim", "claims", multiple=True, metavar="LAW,…", help="Hold the scheme to these laws too.", callback=listed
)  # fmt: skip
EXEC = click.option(
    "--exec", "programs", multiple=True, metavar="COMMAND",
    help="A program in any language (docs/protocol.md); may be repeated.",
)  # fmt: skip

INITIAL = click.option(
    "--y", "initial", type=NumberList(float), help="Initial state. [default: the problem's own]"
)


@contextmanager
def candidates(
    targets: Sequence[str], programs: Sequence[str], say: Callable[[str], None], problems: Iterable[Any] = (),
    usual: Iterable[str] = (),
) -> Iterator[list[tuple[str, Any]]]:  # fmt: skip
    """A context with the schemes of a command's targets and programs,
    as pairs (name in output, scheme).

    If no target and no program is given, the targets are `usual`. The programs are stopped when the
    block ends. Loading a scheme makes one step, which may compile it, so `say` is first called with
    a line about the target.
    """
    from sepv.schemes import load_scheme

    with ExitStack() as stack:
        loaded = []
        for target in targets or (() if programs else usual):
            say(f"waiting for the first step of {target}")
            loaded.append((target, load_scheme(target, problems=problems)))
        for command in programs:
            from sepv.external import load_program

            say(f"waiting for the first answer of {command}")
            loaded.append((f"--exec {shlex.quote(command)}", stack.enter_context(load_program(command))))
        if not loaded:
            raise UsageError(
                expected="a scheme, or a program with --exec",
                received="neither",
                remedy="a built-in name, module:attribute, or --exec './program'",
            )
        yield loaded


class Workers(click.ParamType):  # type: ignore[type-arg]  # generic in the newest click alone
    """The type of the option --workers: a number of workers, or the address of a Dask scheduler."""

    name = "N or ADDRESS"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Convert a text to an int ≥ 1; an address with "://" stays text."""
        if isinstance(value, int) or "://" in value:
            return value
        if not value.isdecimal() or int(value) < 1:
            self.fail(
                f"{value!r} is neither a number ≥ 1 nor an address such as tcp://127.0.0.1:8786", param, ctx
            )
        return int(value)


def complete_schemes(_context: click.Context, _parameter: click.Parameter, incomplete: str) -> list[str]:
    """The built-in schemes that begin with a text, for shell completion."""
    from sepv import schemes

    return [name for name in schemes.PAPER if name.startswith(incomplete)]


def complete_laws(_context: click.Context, _parameter: click.Parameter, incomplete: str) -> list[str]:
    """The laws that begin with a text, for shell completion."""
    from sepv.verification import ALL_LAWS

    return [name for name in ALL_LAWS if name.startswith(incomplete)]


def friendly(command: Callable[..., Any]) -> Callable[..., Any]:
    """Decorate a command so that any error ends it with one message and a documented exit code,
    which is never 1.

    Tracebacks are shown with --debug only. A file that cannot be written is an error before the
    command does any work.
    """

    @wraps(command)
    def wrapper(*args: Any, debug: bool, **kwargs: Any) -> Any:
        try:
            context = click.get_current_context()
            for option in context.command.params:
                if option.type is OUT and option.name:
                    require_folder(context.params[option.name])
            return command(*args, **kwargs)
        except (SystemExit, click.exceptions.Exit, click.ClickException):
            raise
        except BaseException as error:
            raise SystemExit(_ended_by(error, debug)) from None

    return click.option("--debug", is_flag=True, help="Show tracebacks.")(wrapper)


@contextmanager
def interruptible() -> Iterator[None]:
    """A context in which Ctrl-C prints one line and ends the command with exit code 130 (click
    itself exits with 1).
    """
    try:
        yield
    except KeyboardInterrupt as error:
        raise SystemExit(_ended_by(error, debug=False)) from None


def _ended_by(error: BaseException, debug: bool) -> int:
    """Print the message of an error that ends a command, and return the exit code."""
    if isinstance(error, BrokenPipeError):
        # The reader, such as ``| head``, has ended. Further output, also at exit, is dropped; 141
        # as for SIGPIPE.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 141
    code = _code_of(error)
    if debug and not isinstance(error, KeyboardInterrupt):
        say("".join(traceback.format_exception(error)).rstrip())
    elif isinstance(error, KeyboardInterrupt):
        interruption_answered()
        say("sepv: interrupted")
    elif code == EXIT_DEFECT:
        say(defect(error))
    else:
        say(f"sepv: {error}")
    return code


def _code_of(error: BaseException) -> int:
    """The exit code for an error that ends a command."""
    if isinstance(error, KeyboardInterrupt):
        return 130
    if isinstance(error, SepvError):
        return 2 if isinstance(error, UsageError) and not isinstance(error, TargetError) else 3
    return 2 if isinstance(error, OSError) and error.errno not in _SYSTEM_LACKS else EXIT_DEFECT
