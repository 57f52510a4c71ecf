"""How often does the suite accuse a correct scheme? Whole runs with fresh seeds;
later calls add runs to the file.

    python -m benchmarks.false_alarms --runs 20 --log runs.jsonl -j 2     go on where the file ends
    python -m benchmarks.false_alarms --runs 0 --log runs.jsonl           only the count
    python -m benchmarks.false_alarms --runs 40 --only built-in           or --only unusual

In a run every law that a scheme claims judges it, at the default budget, with a seed that was never
used before. The built-in schemes and the correct schemes that look unusual
(`benchmarks.right_schemes`) take turns. A false alarm is a claimed law whose verdict is `violated`
or `error`. A law with the verdict `inconclusive` accuses no scheme, and is counted separately. If n
runs have no false alarm, the probability of a false alarm in a run is below 1 − 0.05^(1/n) ≈ 3/n at
95 % confidence (Clopper and Pearson 1934).
"""

from __future__ import annotations

import argparse
import json
import time
from collections import defaultdict
from pathlib import Path
from typing import Any

from scipy.stats import beta

from benchmarks import start, tell
from benchmarks.right_schemes import RIGHT_SCHEMES
from sepv import schemes
from sepv.law import Effort, Verdict
from sepv.schemes import Scheme
from sepv.verification import load_laws, verify
from sepv.workers import run_all

SCHEME_GROUPS: dict[str, dict[str, Scheme]] = {
    "built-in": {**schemes.PAPER, **schemes.EXTENSIONS, "collocation-2": schemes.collocation(2)},
    "unusual": RIGHT_SCHEMES,
}


def main() -> None:
    """Add runs to the file, and print the count."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n\n")[0])
    parser.add_argument("--runs", type=int, default=20, help="runs to add")
    parser.add_argument("--log", type=Path, default=Path("false_alarms.jsonl"))
    parser.add_argument("-j", "--workers", default="1", help="processes, or a Dask scheduler's address")
    parser.add_argument("--start", type=int, default=0, help="first seed of an empty file")
    parser.add_argument("--only", choices=list(SCHEME_GROUPS), help="schemes of one group")
    options = parser.parse_args()
    done = [json.loads(line) for line in options.log.read_text().splitlines()] if options.log.exists() else []
    listed = [(g, n) for g in SCHEME_GROUPS if options.only in (None, g) for n in SCHEME_GROUPS[g]]
    first = done[-1]["seed"] + 1 if done else options.start
    early: dict[int, dict[str, Any]] = {}
    taken = 0

    def take(number: int, run: dict[str, Any]) -> None:
        """Write a finished run to the file, in the order of seeds,
        so that a later call can continue.
        """
        nonlocal taken
        taken += 1
        tell(f"{taken} of {options.runs} runs", taken / options.runs)
        early[first + number] = run
        while done_to() + 1 in early:
            done.append(early.pop(done_to() + 1))
            with options.log.open("a") as file:
                file.write(json.dumps(done[-1]) + "\n")
            for line in (*done[-1]["alarms"], *done[-1]["open"]):
                print(f"{done[-1]['scheme']}, seed {done[-1]['seed']}: {line}", flush=True)

    def done_to() -> int:
        return int(done[-1]["seed"]) if done else first - 1

    runs = [(*listed[seed % len(listed)], seed) for seed in range(first, first + options.runs)]
    workers = int(options.workers) if options.workers.isdigit() else options.workers
    run_all(one, runs, workers, threads=False, receive=take)
    if done:
        show(done)


def one(what: tuple[str, str, int]) -> dict[str, Any]:
    """Make one whole run; return its scheme, seed, number of laws, false alarms,
    inconclusive verdicts and time.
    """
    group, name, seed = what
    start, scheme = time.process_time(), SCHEME_GROUPS[group][name]
    always = {law.name for law in load_laws() if law.always_claimed}
    report = verify(
        scheme, laws=frozenset(scheme.claims) | always, effort=Effort(seed=seed, shrink_checks=50)
    )
    if report.interrupted:
        raise KeyboardInterrupt  # part of a run is not counted

    def lines(*verdicts: Verdict) -> list[str]:
        return [
            f"{f.law} {f.verdict.text}: {f.message.splitlines()[-1] if f.message else ''}"
            for f in report.findings
            if f.claimed and f.verdict in verdicts
        ]

    return {
        "group": group,
        "scheme": name,
        "seed": seed,
        "claimed": sum(f.claimed for f in report.findings),
        "alarms": lines(Verdict.VIOLATED, Verdict.ERROR),
        "open": lines(Verdict.INCONCLUSIVE),
        "cpu_seconds": round(time.process_time() - start, 2),
    }


def show(done: list[dict[str, Any]]) -> None:
    """Print the number of false alarms with a bound of their rate,
    and times and inconclusive verdicts by scheme.
    """
    alarms = sum(bool(run["alarms"]) for run in done)
    bound = float(beta.ppf(0.95, alarms + 1, len(done) - alarms)) if alarms < len(done) else 1.0
    seconds = sum(float(run["cpu_seconds"]) for run in done)
    by_scheme: dict[str, list[dict[str, Any]]] = defaultdict(list)
    for run in done:
        by_scheme[run["scheme"]].append(run)
    for name, runs in by_scheme.items():
        mean = sum(float(run["cpu_seconds"]) for run in runs) / len(runs)
        print(
            f"{name}: {len(runs)} runs, {sum(bool(run['alarms']) for run in runs)} with a false alarm, "
            f"{sum(bool(run.get('open')) for run in runs)} with an open verdict, {mean:.1f} s"
        )
    print(
        f"{len(done)} runs, {alarms} with a false alarm: below {bound:.2g} a run at 95 % confidence; "
        f"{seconds / len(done):.1f} s of one core a run"
    )


if __name__ == "__main__":
    start(main)
