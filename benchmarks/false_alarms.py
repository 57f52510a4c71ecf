"""How often does the suite accuse a correct scheme? Whole runs with fresh seeds, in pieces that add up.

    python -m benchmarks.false_alarms --runs 20 --log runs.jsonl      go on where the file ends
    python -m benchmarks.false_alarms --runs 0 --log runs.jsonl       only the count

A run is every law that a built-in scheme claims, at the default budget, with a seed that was never used before; the
schemes take turns. A false alarm is a claimed law that ends as anything but `holds` or `not applicable`. With none
in n runs, the probability of one is below 1 − 0.05^(1/n) ≈ 3/n at 95 % confidence (Clopper and Pearson, 1934).
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path
from typing import Any

from scipy.stats import beta

from sepv import schemes
from sepv.engine.workers import run_all
from sepv.law import Effort, Verdict
from sepv.suite import load_laws, verify


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--runs", type=int, default=20, help="runs to add")
    parser.add_argument("--log", type=Path, default=Path("false_alarms.jsonl"))
    parser.add_argument("--workers", default="1", help="processes, or a Dask scheduler's address")
    parser.add_argument("--start", type=int, default=0, help="first seed of an empty file")
    options = parser.parse_args()
    done = [json.loads(line) for line in options.log.read_text().splitlines()] if options.log.exists() else []
    names = list(schemes.ALL)
    first = done[-1]["seed"] + 1 if done else options.start
    early: dict[int, dict[str, Any]] = {}

    def take(number: int, run: dict[str, Any]) -> None:
        """In the order of seeds, so that the file can be gone on with."""
        early[first + number] = run
        while done_to() + 1 in early:
            done.append(early.pop(done_to() + 1))
            with options.log.open("a") as file:
                file.write(json.dumps(done[-1]) + "\n")
            for alarm in done[-1]["alarms"]:
                print(f"{done[-1]['scheme']}, seed {done[-1]['seed']}: {alarm}", flush=True)

    def done_to() -> int:
        return int(done[-1]["seed"]) if done else first - 1

    runs = [(names[seed % len(names)], seed) for seed in range(first, first + options.runs)]
    workers = int(options.workers) if options.workers.isdigit() else options.workers
    run_all(one, runs, workers, threads=False, receive=take)
    if done:
        show(done)


def one(what: tuple[str, int]) -> dict[str, object]:
    """One whole run: its scheme, seed, laws measured, false alarms and time."""
    name, seed = what
    start = time.process_time()
    always = {law.name for law in load_laws() if law.always_claimed}
    report = verify(
        name, laws=schemes.ALL[name].claims | always, effort=Effort(seed=seed, shrink_seconds=2.0)
    )
    alarms = [
        f"{f.law} {f.verdict.text}: {f.message.splitlines()[-1] if f.message else ''}"
        for f in report.findings
        if f.claimed and f.verdict not in (Verdict.HOLDS, Verdict.NOT_APPLICABLE)
    ]
    laws = sum(f.claimed for f in report.findings)
    seconds = round(time.process_time() - start, 2)
    return {"scheme": name, "seed": seed, "claimed": laws, "alarms": alarms, "cpu_seconds": seconds}


def show(done: list[dict[str, object]]) -> None:
    """The count, and what it says about the rate."""
    alarms = sum(bool(run["alarms"]) for run in done)
    bound = float(beta.ppf(0.95, alarms + 1, len(done) - alarms)) if alarms < len(done) else 1.0
    seconds = sum(float(run["cpu_seconds"]) for run in done)  # type: ignore[arg-type]
    print(
        f"{len(done)} runs, {alarms} with a false alarm: below {bound:.2g} a run at 95 % confidence; "
        f"{seconds / len(done):.1f} s of one core a run"
    )


if __name__ == "__main__":
    main()
