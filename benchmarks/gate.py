"""Does the gate of `sepv bench` report planted regressions,
and pass equal code? ``python -m benchmarks.gate``.

Two folders stand for two checkouts of a third party's scheme. One of them has a planted regression:
one Newton iteration more, one evaluation more in all, an error 5 % larger, or a slowdown of 10 %.
Then equal code is compared twenty times, and counters, errors and paired times must all pass. The
run takes some ten minutes.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

from rich.console import Console

from benchmarks import over, start
from sepv.studies import bench_cases as cases
from sepv.studies import bench_pairs as pairs
from sepv.studies import check_bench as check
from sepv.studies._bench.gate import Change

PLAIN = """
from dataclasses import replace
from sepv.schemes import energy_preserving

scheme = replace(energy_preserving, name="ours")
"""
PLANTED = {
    "one Newton iteration more": """
def solve(problem, y, h, dW, plain=scheme.solve):
    solution = plain(problem, y, h, dW)
    iterations = solution.iterations.copy()
    iterations[0] += 1
    return replace(solution, iterations=iterations)
scheme = replace(scheme, solve=solve)
""",
    "one evaluation of ∇H more in all": """
def solve(problem, y, h, dW, plain=scheme.solve):
    if (y == y[:, :1]).all():  # the first step
        problem.gradient(y[:, 0])
    return plain(problem, y, h, dW)
scheme = replace(scheme, solve=solve)
""",
    "an error 5 % larger": """
def step(problem, y, h, dW, plain=scheme.step):
    whole = plain(problem, y, h, dW)
    halves = plain(problem, plain(problem, y, h / 2, dW / 2), h / 2, dW / 2)
    return whole + 0.05 * (whole - halves) / 0.75
scheme = replace(scheme, step=step, solve=None)
""",
    "a slowdown of 10 %": """
from time import process_time
def solve(problem, y, h, dW, plain=scheme.solve):
    begin = process_time()
    solution = plain(problem, y, h, dW)
    end = process_time() + 0.1 * (process_time() - begin)
    while process_time() < end:
        pass
    return solution
scheme = replace(scheme, solve=solve)
""",
}
# The quantity that the gate must report as worse. Others may be worse too, because more work takes
# more time.
EXPECTED = {
    "one Newton iteration more": "iterations",
    "one evaluation of ∇H more in all": "gradient",
    "an error 5 % larger": "error",
    "a slowdown of 10 %": "processor time",
}
CASES = cases.choose(("rigid-body", "pendulum"), portable=False)


def run(head: Path, base: Path, *, timed: bool) -> list[Change]:
    """The changes that the gate of `sepv bench` reports between two checkouts,
    with or without times.
    """
    checks = check(*pairs.measured("ours:scheme", head, base, CASES))
    return checks + (pairs.time_pairs("ours:scheme", head, base, CASES) if timed else [])


def main() -> None:
    """Print which planted regressions the gate reports,
    and how many comparisons of equal code pass.
    """
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=20, help="of the same code on both sides")
    runs = parser.parse_args().runs
    out = Console(width=110, highlight=False)
    missed = 0
    with tempfile.TemporaryDirectory() as folder:
        head, base = Path(folder) / "head", Path(folder) / "base"
        for side in (head, base):
            side.mkdir()
            (side / "ours.py").write_text(PLAIN)
        for name, code in over(PLANTED.items(), lambda item: item[0]):
            (head / "ours.py").write_text(PLAIN + code)
            wanted = EXPECTED[name]
            found = [c for c in run(head, base, timed="time" in wanted) if c.what == wanted]
            seen = [c for c in found if c.verdict == "worse"]
            missed += len(seen) < len(found)
            out.print(f"{name}: {'seen' if seen else 'MISSED'} in {len(seen)} of {len(found)} cases")
            for c in found:
                out.print(f"  {c.case}: {c.what} {c.verdict}  {c.text}")
        (head / "ours.py").write_text(PLAIN)
        alarms = 0
        for number in over(range(runs), lambda n: f"the same code, run {n + 1} of {runs}"):
            checks = run(head, base, timed=True)
            worse = [f"{c.case}: {c.what} {c.text}" for c in checks if c.verdict == "worse"]
            alarms += bool(worse)
            times = "; ".join(f"{c.case} {c.text}" for c in checks if c.what == "processor time")
            out.print(f"A/A {number + 1}: {'ALARM ' + str(worse) if worse else 'passes'}  {times}")
    out.print(f"{runs - alarms} of {runs} runs of the same code pass.")
    raise SystemExit(1 if missed or alarms else 0)


if __name__ == "__main__":
    start(main)
