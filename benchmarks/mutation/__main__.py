"""``python -m benchmarks.mutation``: run the mutants and print what became of them."""

from __future__ import annotations

import argparse
import json
import math
import os
import random
import sys
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console
from rich.table import Table

from benchmarks.mutation.harness import Harness, Outcome
from benchmarks.mutation.mutants import Mutant, mutants
from benchmarks.mutation.targets import TARGETS

REASONS = Path(__file__).with_name("survivors.json")
ROOT = Path(__file__).resolve().parents[2]
BAR = 0.9


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the mutants and print what became of them; 1 below the bar, or where a survivor has no reason."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.mutation", description=__doc__)
    parser.add_argument(
        "modules",
        nargs="*",
        metavar="MODULE",
        help=f"of {', '.join(TARGETS)}; default all",
    )
    parser.add_argument("--sample", type=int, metavar="N", help="N mutants drawn at random from all of them")
    parser.add_argument("--seed", type=int, default=0, help="of the sample (default 0)")
    parser.add_argument("--jobs", type=int, default=1, help="mutants at a time (default 1)")
    parser.add_argument("--only", default="", metavar="TEXT", help="only mutants whose name contains TEXT")
    parser.add_argument("--tests", action="append", metavar="ID", help="ask these tests instead; repeatable")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write every mutant's fate, one a line")
    parser.add_argument(
        "--again", type=Path, metavar="FILE", help="only those that FILE does not say are killed"
    )
    parser.add_argument("--list", action="store_true", help="print the mutants and stop")
    asked = parser.parse_args(arguments)
    unknown = set(asked.modules) - set(TARGETS)
    if unknown:
        parser.error(f"unknown modules {', '.join(sorted(unknown))}; known are {', '.join(TARGETS)}")
    chosen = [m for name in asked.modules or TARGETS for m in mutants(name) if asked.only in m.name]
    if asked.again:
        rows = map(json.loads, asked.again.read_text(encoding="utf-8").splitlines())
        killed = {row["mutant"] for row in rows if row["status"] == "killed"}
        chosen = [m for m in chosen if m.name not in killed]
    total = len(chosen)
    if asked.sample is not None and asked.sample < total:
        kept = set(random.Random(asked.seed).sample(range(total), asked.sample))
        chosen = [m for i, m in enumerate(chosen) if i in kept]
    if asked.list or not chosen:
        print("\n".join(m.name for m in chosen))
        return 0
    outcomes = run(chosen, asked.jobs, asked.json, tuple(asked.tests or ()))
    return report(outcomes, total)


def run(chosen: list[Mutant], jobs: int, to: Path | None, tests: tuple[str, ...] = ()) -> list[Outcome]:
    """Collect the tests once, then run the mutants."""
    if to:
        to.write_text("", encoding="utf-8")
    modules = dict.fromkeys(m.module for m in chosen)
    asked = {module: tests or TARGETS[module] for module in modules}
    files = dict.fromkeys(name for names in asked.values() for name in names)
    outcomes: list[Outcome] = []
    screen = Console(file=os.fdopen(os.dup(2), "w"), highlight=False)

    def work(harness: Harness) -> None:
        seconds = sum(known.seconds for known in harness.known)
        screen.print(f"{len(chosen)} mutants; {len(harness.known)} tests, {seconds:.1f} s traced")
        start = time.perf_counter()
        for outcome in harness.outcomes(((m, asked[m.module]) for m in chosen), jobs):
            outcomes.append(outcome)
            if to:
                with to.open("a", encoding="utf-8") as stream:
                    print(json.dumps(_line(outcome), ensure_ascii=False), file=stream)
            if len(outcomes) % 25 == 0:
                counts = Counter(o.status for o in outcomes)
                screen.print(
                    f"{len(outcomes)} {dict(counts)} {time.perf_counter() - start:.0f} s", soft_wrap=True
                )

    to = to and to.absolute()
    os.chdir(ROOT)
    code = pytest.main(
        # Hypothesis is loaded before pytest could rewrite its assertions, which changes nothing here.
        [
            *(*files, "--hypothesis-profile", "mutation", "-q", "--no-header", "-p", "no:cacheprovider"),
            *("-W", "ignore:Module already imported:pytest.PytestAssertRewriteWarning"),
        ],
        plugins=[Harness(modules, work)],
    )
    if len(outcomes) != len(chosen):
        raise SystemExit(f"pytest ended with {code} after {len(outcomes)} of {len(chosen)} mutants")
    return outcomes


def _line(outcome: Outcome) -> dict[str, Any]:
    name, seconds = outcome.mutant.name, round(outcome.seconds, 2)
    return {"mutant": name, "status": outcome.status, "by": outcome.by, "seconds": seconds}


def wilson(successes: int, trials: int, z: float = 1.959964) -> tuple[float, float]:
    """The 95 % interval of E. B. Wilson (1927) for a share."""
    if not trials:
        return 0.0, 1.0
    p, n = successes / trials, trials
    centre, spread = p + z * z / (2 * n), z * math.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    return (centre - spread) / (1 + z * z / n), (centre + spread) / (1 + z * z / n)


def report(outcomes: list[Outcome], total: int) -> int:
    """Tables of the score, the survivors with their reasons, and the time-outs."""
    screen = Console(width=None if sys.stdout.isatty() else 160, highlight=False)
    reasons: dict[str, str] = json.loads(REASONS.read_text(encoding="utf-8")) if REASONS.exists() else {}
    table = Table("module", "mutants", "killed", "survived", "time-outs", "score", "processor s")
    for module in [*dict.fromkeys(o.mutant.module for o in outcomes), None]:
        rows = [o for o in outcomes if module in (None, o.mutant.module)]
        table.add_row(module or "all", *_row(rows))
    screen.print(table)
    survived = [o for o in outcomes if o.status == "survived"]
    for outcome in survived:
        screen.print(f"survived: {outcome.mutant.name}", soft_wrap=True, markup=False)
        screen.print(
            f"    {reasons.get(outcome.mutant.name, 'NO REASON STATED')}; {outcome.tests} tests ran",
            soft_wrap=True,
            markup=False,
        )
    for outcome in outcomes:
        if outcome.status == "time-out":
            screen.print(f"time-out: {outcome.mutant.name}  ({outcome.by})", soft_wrap=True, markup=False)
    killed = sum(o.status == "killed" for o in outcomes)
    low, high = wilson(killed, killed + len(survived))
    score = killed / max(1, killed + len(survived))
    what = f"{len(outcomes)} of {total} mutants" if len(outcomes) < total else f"all {total} mutants"
    interval = f", 95 % interval {100 * low:.1f} to {100 * high:.1f} %" if len(outcomes) < total else ""
    screen.print(f"{what}: score {100 * score:.1f} %{interval}")
    unexplained = sum(o.mutant.name not in reasons for o in survived)
    if unexplained:
        screen.print(f"{unexplained} survivors without a reason in {REASONS.name}")
    return int(score < BAR or unexplained > 0)


def _row(rows: list[Outcome]) -> list[Any]:
    counts = Counter(o.status for o in rows)
    judged = counts["killed"] + counts["survived"]
    score = f"{100 * counts['killed'] / judged:.1f} %" if judged else "-"
    numbers = [len(rows), counts["killed"], counts["survived"], counts["time-out"]]
    return [*map(str, numbers), score, f"{sum(o.seconds for o in rows):.0f}"]


if __name__ == "__main__":
    sys.exit(main())
