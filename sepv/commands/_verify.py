"""``sepv verify``: measure every law on a target."""

from __future__ import annotations

import os
import shlex
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

import click

from sepv._arguments import MAX_SECONDS
from sepv.children import attempted, cores, start_ahead
from sepv.commands import _shared as cli
from sepv.commands._watch import followed
from sepv.console import counted, print_table
from sepv.errors import UsageError
from sepv.files import made, write_atomically

# The beginning of a target that is a program: exec:COMMAND.
PROGRAM_PREFIX = "exec:"


@click.command(epilog=cli.EXIT_CODES, short_help="Measure every law on a scheme.")
@click.argument("targets", nargs=-1, metavar="TARGET...", shell_complete=cli.complete_schemes)
@click.option(
    "--law", "laws", multiple=True, metavar="NAME,…", help="Only these laws; may be repeated.", callback=cli.listed,
    shell_complete=cli.complete_laws,
)  # fmt: skip
@click.option(
    "--problem", "-p", "problems", multiple=True, metavar="PROBLEM",
    help="What it is for: name, family, file.json or module:attribute; may be repeated.",
)  # fmt: skip
@click.option(
    "--require", multiple=True, metavar="PROFILE,…", callback=cli.listed,
    help="Profiles that must be found, such as energy,order-1; only their laws are measured.",
)  # fmt: skip
@cli.CLAIM_OPTION
@click.option(
    "--agrees-with", metavar="TARGET",
    help="A second program that should make the same steps (law agreement): a TARGET, or 'exec:COMMAND'.",
)  # fmt: skip
@click.option("--bits", is_flag=True, help="With --agrees-with: the steps of both have the same bits.")
@click.option("--json", type=cli.OUT, help="Write the report to this file.")
@click.option("--html", type=cli.OUT, help="Write the report as a page, with pictures, to this file.")
@click.option("--junit", type=cli.OUT, help="Write JUnit XML to this file.")
@click.option("--badge", type=cli.OUT, help="Write JSON for a badge to this file.")
@click.option("--expected", type=cli.FILE, help="A file of --pin or --write-expected; strict both ways.")
@click.option("--pin", type=cli.OUT, help="Write what holds and what is violated today, for --expected.")
@click.option(
    "--write-expected", type=cli.OUT, help="Write today's violations of claimed laws, for --expected."
)
@click.option(
    "--against", type=cli.FILE, help="Replay a report's counterexamples; measure --law, or a quarter, again."
)
@click.option("--replay", "token", metavar="TOKEN", help="Measure one witness; needs one --law.")
@click.option("--seed", type=cli.NATURAL, default=0, help="Of examples and paths.")
@click.option("--examples", type=cli.COUNT, help="Random examples for each law. [default: 8]")
@click.option("--paths", type=click.IntRange(min=64), help="Most paths for a law. [default: 8192]")
@click.option(
    "--shrink-checks", type=cli.NATURAL,
    help="Checks to simplify a counterexample with; 0 leaves it as found. [default: 500]",
)  # fmt: skip
@click.option("--deep", is_flag=True, help="The nightly effort: 1000 examples, 20 designs, 16384 paths.")
@click.option("--no-corpus", is_flag=True, help="Leave out the known witnesses, which are asked first.")
@click.option("--timeout", type=cli.Finite(0.1, MAX_SECONDS), default=600.0, help="Seconds a law.")
@click.option(
    "--exec", "program", metavar="COMMAND", help="Verify a program in any language (docs/protocol.md)."
)
@click.option(
    "--check-protocol", is_flag=True, help="With --exec: say line by line what the program does wrong."
)
@click.option("--call-timeout", type=cli.Finite(0.01, MAX_SECONDS), default=10.0, help="With --exec.")
@click.option(
    "-j", "--jobs", type=cli.COUNT,
    help="Processes for the laws. [default: 1; for all laws of a built-in scheme one per core, up to 4]",
)  # fmt: skip
@click.option(
    "--workers", type=cli.Workers(), help="A Dask scheduler's address, for the laws (docs/clusters.md)."
)
@click.option(
    "--coverage", is_flag=True, help="Show which strata the laws' cases cover, and measure nothing."
)
@click.option("-q", "--quiet", is_flag=True, help="Only the last line.")
@cli.friendly
def verify(targets: cli.Names, laws: cli.Names, **options: Any) -> None:
    """Measure every law on TARGET: a built-in name, module:attribute or 'exec:COMMAND'.

    The attribute is a sepv.Scheme, or a function step(problem, y, h, dW) -> y_next. Laws that a
    scheme does not claim are measured and printed too. For several targets a matrix of all verdicts
    is printed last.

    \b
    sepv verify energy-preserving
    sepv verify energy-preserving midpoint euler-heun
    sepv verify mymodule:step --claim energy,casimir --json report.json
    sepv verify mymodule:step -p canonical-separable -p mymodule:problem
    sepv verify mymodule:step --agrees-with 'exec:./original' --law agreement
    """
    if len(targets) == 1 and targets[0].startswith(PROGRAM_PREFIX) and not options["program"]:
        options["program"], targets = targets[0].removeprefix(PROGRAM_PREFIX), ()
    if bool(targets) == bool(options["program"]):
        raise UsageError(
            expected="a TARGET, or a program with --exec",
            received=counted(len(targets), "target") + (" and --exec" if options["program"] else ""),
            remedy="sepv verify energy-preserving, or sepv verify --exec './program'",
        )
    if options["coverage"] and targets:
        raise SystemExit(_coverage(targets, laws, options["problems"], options["timeout"]))
    command, seconds = options["program"], options["call_timeout"]
    if options["check_protocol"] and command:
        from sepv.external import check_protocol, describe
        from sepv.verification import LAWS

        checks = check_protocol(command, call_timeout=seconds, laws=LAWS)
        click.echo(describe(checks))
        raise SystemExit(0 if all(c.ok for c in checks) else 3)
    with ExitStack() as programs:
        options["twin"] = _twin(options, programs)
        if not command:
            code = _verify(targets, laws, options)
        else:
            from sepv.external import load_program

            scheme = programs.enter_context(load_program(command, call_timeout=seconds))
            code = _verify((scheme,), laws, options, f"--exec {shlex.quote(command)}")
    raise SystemExit(code)


def _twin(options: dict[str, Any], programs: ExitStack) -> Any:
    """The `sepv.schemes.Twin` of --agrees-with and --bits;
    a program runs until `programs` is closed.
    """
    from sepv.schemes import Twin, as_twin

    words = options["agrees_with"]
    if words is None or not words.startswith(PROGRAM_PREFIX):
        return as_twin(words, options["bits"])
    from sepv.external import load_program

    command = words.removeprefix(PROGRAM_PREFIX)
    scheme = programs.enter_context(load_program(command, call_timeout=options["call_timeout"]))
    return Twin(scheme, options["bits"], shlex.quote(words))


def _coverage(targets: cli.Names, laws: cli.Names, problems: cli.Names, seconds: float) -> int:
    """Run ``--coverage``: print how the laws choose their cases,
    for the class or the problems of each target.
    """
    from sepv.console import console
    from sepv.verification import load_in_time, load_laws
    from sepv.verification import show_coverage as show

    for target in targets:
        show(load_laws(laws or None), load_in_time(target, (), seconds, problems or None), console())
    return 0


def _arguments(laws: cli.Names, options: dict[str, Any]) -> dict[str, Any]:
    """The arguments of `sepv.verification.verify` from the options of the command line.

    Raises UsageError for a claim that is not among the laws to measure.
    """
    from sepv.schemes import law_named
    from sepv.verification import ALL_LAWS, load_laws

    names = [law.name for law in _laws_of_run(laws, options)]
    claims = [law_named(claim) for claim in options["claims"]]
    left_out = [law.name for law in load_laws(ALL_LAWS) if law.name in claims and law.name not in names]
    if left_out:
        raise UsageError(
            expected="a claim to be among the laws that are measured",
            received=f"--claim {','.join(left_out)}, and {', '.join(names)} to measure",
            remedy=f"add --law {','.join(left_out)}, or leave it out of --claim",
        )
    as_given = {key: options[key] for key in ("timeout", "expected", "jobs", "workers", "require")}
    listed = {"laws": laws or None, "claims": claims, "problems": options["problems"] or None}
    return as_given | listed | {"effort": _effort(**options), "agrees_with": options["twin"]}


def _laws_of_run(laws: cli.Names, options: dict[str, Any]) -> list[Any]:
    """The laws to measure: those that --law names, those that the profiles of --require need,
    or by default all.
    """
    from sepv.verification import laws_of, requirements

    required = requirements(options["require"]) if options["require"] else ()
    return laws_of(laws or None, required, twin=options["twin"] is not None)


def _effort(**options: Any) -> Any:
    """The `Effort` of the options --deep, --examples, --paths, --shrink-checks,
    --seed and --no-corpus.
    """
    from sepv.law import Effort

    effort = Effort().deeper() if options["deep"] else Effort()
    given = {key: options[key] for key in ("examples", "paths", "shrink_checks") if options[key] is not None}
    return replace(effort, seed=options["seed"], corpus=not options["no_corpus"], **given)


def _verify(targets: tuple[Any, ...], laws: cli.Names, options: dict[str, Any], shown: str = "") -> int:
    """Measure the laws on each target, print and write the reports, and return the exit code.

    `shown` is the name that the output gives to a program (--exec), which has no name of its own.
    """
    options["jobs"] = _jobs(targets, options, not laws)
    from sepv.console import console, print_sentence
    from sepv.verification import report as page
    from sepv.verification import verify as run
    from sepv.verification import watching

    quiet, debug = options["quiet"], click.get_current_context().params["debug"]
    if options["token"] is not None:
        _replay(targets, laws, options, debug)
    if options["against"] is not None:
        return _against(targets, laws, options)
    files = {kind: options[kind] for kind in ("json", "html", "junit", "badge", "write_expected", "pin")}
    if any(files.values()) or options["expected"]:
        _one_target(targets, "files")
    arguments = _arguments(laws, options)
    out, reports = console(), []
    for target in targets:
        shown_as = shown or shlex.quote(target)
        with watching(quiet, _laws_of_run(laws, options), shown_as) as progress:
            report = run(target, progress=progress, **arguments)
        named = report.target
        if shown:
            with_problems = "".join(f" -p {shlex.quote(p)}" for p in report.problems)
            named = shown + with_problems + (options["twin"].options if options["twin"] else "")
        report = replace(report, target=named, pins=bool(files["pin"]))
        reports.append(report)

        def show(report: Any = report, named: str = named) -> None:
            if quiet:
                # A single target needs no name.
                which = f"{named}: " if len(targets) > 1 else ""
                print_sentence(out, page.summary(report, which))
            else:
                page.show(report, out, debug=debug)
            out.file.flush()

        attempted(f"what is shown of {named}", show)  # shown once, even if a later law crashes the process
        only = f" --law {shlex.quote(','.join(laws))}" if laws else ""
        _write(report, files, named + only)
        _tell_github(report)
        if report.interrupted:
            break
    if len(reports) > 1 and not quiet:
        print_table(page.matrix(reports), out)
    return max(reports, key=lambda r: r.exit_code).exit_code


def _jobs(targets: tuple[Any, ...], options: dict[str, Any], all_laws: bool) -> int:
    """The number of processes for the laws. For all laws, the processes start here,
    before most imports.
    """
    if any(options[key] for key in ("require", "workers", "token", "against")) or not all_laws:
        return options["jobs"] or 1
    from sepv.schemes import built_in

    jobs: int = options["jobs"] or (cores() if all(map(built_in, targets)) and not followed() else 1)
    if jobs > 1:
        start_ahead("sepv.verification._worker", jobs)
    return jobs


def _against(targets: tuple[Any, ...], laws: cli.Names, options: dict[str, Any]) -> int:
    """Run ``--against``: measure a report's results again;
    exit code 0 if all agree with the report, else 1.
    """
    from rich.text import Text

    from sepv.console import console, print_sentence, showing
    from sepv.verification import against, load_in_time, load_laws, read_report

    _one_target(targets, "--against")
    report, seconds, out = read_report(options["against"]), options["timeout"], console()
    names = [law.name for law in load_laws(laws)] if laws else []
    scheme = load_in_time(targets[0], (), seconds, options["problems"] or None, twin=options["twin"])
    wrong = []
    with showing(options["quiet"]) as shown:
        for again in against(report, scheme, _effort(**options), seconds, names):
            shown.update(f"after {again.what}")
            wrong += [again.what] if again.differs else []
            if not options["quiet"]:
                wrongly = f". NOT AS REPORTED: {again.differs}" if again.differs else ""
                print_sentence(out, Text(f"{again.what}: {again.came}").append(wrongly, style="bold red"))
    last = f"Not as reported: {', '.join(wrong)}." if wrong else "All as reported."
    print_sentence(out, Text(last, style="bold red" if wrong else "green"))
    return 1 if wrong else 0


def _one_target(targets: tuple[Any, ...], option: str) -> None:
    """Raise a UsageError if several targets are given with `option`, which takes one target."""
    if len(targets) > 1:
        raise UsageError(
            expected=f"one TARGET with {option}",
            received=f"{len(targets)} targets",
            remedy="run once for each",
        )


def _write(report: Any, files: dict[str, str | None], named: str) -> None:
    """Write the files of a report. An interrupted run writes no file with which later runs would be
    compared.

    `named` is the text after ``sepv verify`` that repeats the run.
    """
    from sepv.verification import badge_json, junit_xml, pin, to_toml

    stopped: list[KeyboardInterrupt] = []
    if files["json"] or files["html"]:
        from sepv.verification import with_courses

        try:
            data = with_courses(report)
        except KeyboardInterrupt as error:  # what was measured is written, without pictures
            data, stopped = report.to_json(), [error]
        cli.save_json(files["json"], "report", data)
    texts: dict[str, Any] = {
        "html": lambda _: _page(data),
        "junit": junit_xml,
        "badge": badge_json,
        "write_expected": lambda r: to_toml(r.scheme.name, r.findings),
        "pin": lambda r: pin(r.scheme.name, r.findings, r.problems),
    }
    for kind, path in files.items():
        if path and report.interrupted and kind in ("write_expected", "pin"):
            cli.say(f"sepv: {path} is not written: the run was interrupted")
        elif path and kind in texts:
            lost = _no_longer_guarded(path, report) if kind == "pin" else []
            write_atomically(path, texts[kind](report))
            if kind == "pin":
                guard = f"sepv verify {named} --expected {shlex.quote(path)}"
                before = f" The pin before guarded {', '.join(lost)} too." if lost else ""
                cli.say(f"Pinned in {path}.{before} From now on: {guard}")
    if stopped:
        raise stopped[0]


def _tell_github(report: Any) -> None:
    """Write a summary and annotations of violations, if the command runs in GitHub Actions."""
    if not (path := os.environ.get("GITHUB_STEP_SUMMARY")) and os.environ.get("GITHUB_ACTIONS") != "true":
        return
    from sepv.verification import github

    if path:
        try:
            with open(path, "a", encoding="utf-8", errors="replace") as file:
                file.write(github.step_summary(report))
        except OSError as error:  # a file that cannot be written does not change the verdicts
            cli.say(f"sepv: no summary for GitHub: {error}")
    if os.environ.get("GITHUB_ACTIONS") == "true":
        for line in github.error_lines(report):
            cli.say(line)


def _page(data: dict[str, Any]) -> str:
    """The HTML page of a report's JSON data, the same as `sepv report` makes of its file."""
    from sepv.page import Sources, render

    return render(Sources(verify=[{"made": made("report", cli.typed())} | data]))


def _no_longer_guarded(path: str, report: Any) -> list[str]:
    """The laws that an old file of ``--pin`` claims and that no longer hold in the report;
    empty without a file.
    """
    from sepv.law import Verdict
    from sepv.verification import ALL_LAWS
    from sepv.verification import load_expectations as load

    if not Path(path).exists():
        return []
    try:
        claims = load(path, ALL_LAWS).claims or frozenset()
    except UsageError:
        return []
    return sorted(claims - {f.law for f in report.findings if f.verdict is Verdict.HOLDS})


def _replay(targets: tuple[Any, ...], laws: cli.Names, options: dict[str, Any], debug: bool) -> None:
    """Run ``--replay``: measure one law on the input that a token encodes,
    and exit with the code of its verdict.
    """
    from sepv.console import console
    from sepv.law import Verdict
    from sepv.law.cases import case
    from sepv.verification import replay, report

    if len(targets) != 1 or len(laws) != 1:
        raise UsageError(
            expected="one TARGET and one --law with --replay",
            received=f"TARGET: {len(targets)}, --law: {len(laws)}",
            remedy="copy the whole command from the report",
        )
    witness = case.witness_of(options["token"])
    finding = replay(targets[0], laws[0], witness, options["problems"] or None, options["twin"])
    report.show_finding(finding, console(), debug=debug)
    raise SystemExit({Verdict.HOLDS: 0, Verdict.ERROR: 3}.get(finding.verdict, 1))
