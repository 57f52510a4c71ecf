"""``sepv submit``: verify a scheme, and write what was found as a bundle that others can check."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

import click

from sepv.commands import _shared as cli
from sepv.errors import UsageError
from sepv.files import write_atomically


@click.command(epilog=cli.EXIT_CODES, short_help="Verify a scheme, and write a bundle for others to check.")
@click.argument("target", required=False, shell_complete=cli.complete_schemes)
@click.option("--exec", "program", metavar="COMMAND", help="A program in any language (docs/protocol.md).")
@click.option("--out", type=cli.OUT, required=True, help="The bundle, a .zip.")
@click.option("--problem", "-p", "problems", multiple=True, metavar="PROBLEM", help="What it is for.")
@cli.CLAIM
@click.option("--waivers", type=cli.FILE, help="Expected failures with their reasons (docs/ci.md).")
@click.option("--seed", type=cli.NATURAL, default=0, help="Of examples and paths.")
@click.option("--deep", is_flag=True, help="The nightly effort.")
@click.option("-j", "--jobs", type=cli.COUNT, default=1, help="Processes.")
@click.option("-q", "--quiet", is_flag=True, help="Only the last lines.")
@cli.friendly
def submit(target: str | None, program: str | None, out: str, quiet: bool, **options: Any) -> None:
    """Measure every law on TARGET, and write report, versions, seeds, counterexamples and hashes as one file.

    Whether the laws hold or not: the exit code is that of `sepv verify`.

    \b
    sepv submit mypackage.mymodule:scheme --out scheme.zip
    sepv check scheme.zip
    """
    from sepv.external import load_program
    from sepv.verification import Effort, bundle, load_laws, verify
    from sepv.verification import _report as page
    from sepv.verification._progress import watching
    from sepv.verification._submission import Asked, source

    if bool(target) == bool(program):
        raise UsageError(
            expected="a TARGET, or a program with --exec",
            received="both" if target else "neither",
            remedy="sepv submit mypackage.mymodule:scheme --out scheme.zip",
        )
    claims = tuple(sorted({*options["claims"]}))
    asked = Asked(target or "", program or "", options["problems"], claims)
    source(asked)  # refused before the work, not after
    effort = Effort().deeper() if options["deep"] else Effort()
    waivers = None if options["waivers"] is None else _text(options["waivers"])
    with ExitStack() as stack:
        scheme = stack.enter_context(load_program(program)) if program else asked.target
        progress = stack.enter_context(watching(quiet, load_laws(), asked.words))
        found = verify(
            scheme, claims=claims, effort=replace(effort, seed=options["seed"]), expected=options["waivers"],
            jobs=options["jobs"], problems=asked.problems or None, progress=progress,
        )  # fmt: skip
    report, screen = replace(found, target=asked.words), page.console()
    if quiet:
        page.line(screen, page.summary(report))
    else:
        page.show(report, screen)
    if report.interrupted:
        click.echo(f"sepv: {out} is not written: the run was interrupted", err=True)
    else:
        write_atomically(out, bundle(report, asked, waivers))
        click.echo(f"Written to {out}. Anybody who has the scheme can check it: sepv check {out}", err=True)
    raise SystemExit(report.exit_code)


def _text(path: str) -> str:
    try:
        return Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise UsageError(
            expected="a file of expected failures", received=f"{path}: {error}", remedy="see docs/ci.md"
        ) from error
