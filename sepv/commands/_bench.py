"""``sepv bench``: find regressions in the work, the error and the time of a scheme."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from sepv.commands import _shared as cli
from sepv.console import counted, print_table
from sepv.errors import UsageError

Case = dict[str, Any]
CHANGE_STYLES = {"worse": "bold red", "better": "green", "not settled": "yellow", "same": ""}
BENCH_EXITS = """Exit codes: 0 nothing is worse; 1 a counter, an error or a time is worse; 2 wrong usage; 3 the scheme
crashed, or could not be loaded."""


@click.command(epilog=BENCH_EXITS, short_help="Guard work, error and time against a file or a checkout.")
@click.argument("targets", nargs=-1, metavar="TARGET...")
@cli.EXEC
@click.option(
    "--problem", "-p", "problems", multiple=True, metavar="PROBLEM",
    help="A case of your own: name, file.json or module:attribute.",
)  # fmt: skip
@click.option("--save", type=cli.OUT, help="Write the records to this file.")
@click.option("--against", type=cli.FILE, help="Compare with the records of this file.")
@click.option(
    "--against-ref", type=click.Path(exists=True, file_okay=False), metavar="CHECKOUT",
    help="Compare with another checkout of the same code, time included.",
)  # fmt: skip
@click.option("--case", "names", multiple=True, metavar="NAME", help="Only this case; may be repeated.")
@click.option("--portable", is_flag=True, help="Only cases whose counters are the same on every machine.")
@click.option("--batches", type=click.IntRange(min=4), default=12, help="Most batches of paired times.")
@click.option("-q", "--quiet", is_flag=True, help="Only what differs, and the counts.")
@cli.friendly
def bench(
    targets: cli.Names, programs: cli.Names, problems: cli.Names, save: str | None, against: str | None,
    against_ref: str | None, names: cli.Names, portable: bool, batches: int, quiet: bool,
) -> None:  # fmt: skip
    """Compare work, error and invariant defects of TARGETs on fixed problems with a file or another
    checkout.

    Counters of work are exact integers, and an increase by one is a regression. Errors are compared
    over the same paths, with an interval of their ratio. Time is compared only with another
    checkout, in runs that take turns.

    \b
    sepv bench mymodule:step --save counters.json
    sepv bench mymodule:step --against counters.json
    sepv bench mymodule:step --against-ref ../other-checkout
    sepv bench mymodule:step -p mymodule:problem
    """
    from sepv.console import showing
    from sepv.studies import bench_cases as cases
    from sepv.studies import bench_store as store

    if against and against_ref:
        raise UsageError(
            expected="one of --against and --against-ref", received="both", remedy="run once with each"
        )
    if against_ref and programs:
        raise UsageError(
            expected="TARGETs with --against-ref", received="--exec",
            remedy="a program belongs to no checkout of Python code; save and compare with --against",
        )  # fmt: skip
    chosen = cases.choose(names, portable) if names or not problems else []
    chosen = [*chosen, *(cases.own_case(name) for name in problems)]
    base = {r["target"]: r for r in store.load(against)} if against else {}
    records: list[dict[str, Any]] = []
    checks: list[Any] = []
    with showing(quiet) as line, cli.candidates(targets, programs, line.update) as schemes:
        for target, scheme in schemes:
            line.update(f"{target}: work and errors")
            if against and target not in base:
                raise UsageError(
                    expected=f"a record of {target} in {against}",
                    received=f"records of {', '.join(base) or 'nothing'}",
                    remedy="name the target as it was saved, or save it first",
                )
            if against_ref:
                record, compared = _beside(target, against_ref, chosen, batches, line.update)
            else:
                record, compared = _alone(target, scheme, base.get(target), chosen, names, problems)
            checks += compared
            records.append(record)
    if save:
        cli.save_json(save, "bench", store.document(records))
        click.echo(f"Saved in {save}: hold later runs to it with --against {save}")
    _show([] if quiet else records, checks, saved=bool(save))
    raise SystemExit(1 if any(c.verdict == "worse" for c in checks) else 0)


def _beside(
    target: str, checkout: str, chosen: list[Case], batches: int, say: Callable[[str, float], None]
) -> tuple[dict[str, Any], list[Any]]:
    """Measure a target in this checkout and another; return this one's record,
    and its comparison with the other's.
    """
    from sepv.studies import bench_pairs as pairs
    from sepv.studies import check_bench as check

    where = pairs.head_of(target), Path(checkout).resolve()
    # A tenth of the progress is work and errors, if every batch of times runs.
    ours, theirs = pairs.measured(target, *where, chosen, lambda text, share: say(text, share / 10))
    times = pairs.time_pairs(
        target, *where, chosen, batches=batches, progress=lambda text, share: say(text, 0.1 + 0.9 * share)
    )
    return ours, [*check(ours, theirs), *times]


def _alone(
    target: str,
    scheme: Any,
    before: dict[str, Any] | None,
    chosen: list[Case],
    names: cli.Names,
    problems: cli.Names,
) -> tuple[dict[str, Any], list[Any]]:
    """Measure a target in this checkout alone; return its record, and its comparison with `before`,
    an earlier record.

    If there is an earlier record, its cases are measured instead of `chosen`.
    """
    from sepv.schemes import require_trusted
    from sepv.studies import bench_store as store
    from sepv.studies import check_bench as check

    wanted = [c["case"] for c in before["cases"]] if before else chosen
    wanted = [c for c in wanted if not names or c["name"] in names]
    require_trusted((c["problem"] for c in wanted), problems, target)
    ours = store.record(target, scheme, wanted)
    if before is None:
        return ours, []
    cases = [c for c in before["cases"] if c["case"] in wanted]
    return ours, check(ours, {**before, "cases": cases})


def _show(records: list[dict[str, Any]], checks: list[Any], *, saved: bool) -> None:
    """Print tables of the records, then each difference found by the comparison,
    and the counts of differences.
    """
    from rich.text import Text

    from sepv.console import console
    from sepv.studies import bench_store as store

    out = console()
    for record in records:
        print_table(store.record_table(record), out)
    if not checks:
        if not saved:
            out.print("Nothing to compare with: --save and --against, or --against-ref.")
        return
    for c in checks:
        if c.verdict != "same" or "time" in c.what:
            line = Text(f"{c.target}, {c.case}: {c.what} ")
            out.print(
                line.append(c.verdict, style=CHANGE_STYLES[c.verdict]).append(f"  {c.text}"), soft_wrap=True
            )
    counts = Counter(c.verdict for c in checks)
    verdicts = ", ".join(f"{counts[v]} {v}" for v in CHANGE_STYLES if counts[v])
    out.print(f"{counted(len(checks), 'check')}: {verdicts}.")
    if counts["better"]:
        out.print("Better than the other side: a file that guards the new state is written with --save.")
