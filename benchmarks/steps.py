"""How many steps does a default run ask of a scheme that takes one state at a time?
``python -m benchmarks.steps``.

The default schemes are the midpoint rule and (2.1). The last column has the laws that take the most
steps.
"""

from __future__ import annotations

import argparse
from collections import Counter
from dataclasses import replace
from typing import Any

from benchmarks import over, start
from sepv import schemes, verify
from sepv.law import Finding, Law
from sepv.problem import Array, Problem


def counted(name: str) -> Counter[str]:
    """The number of steps that each law of a whole run takes."""
    scheme, asked = schemes.by_name(name), Counter[str]()
    law = ""

    def step(problem: Problem, y: Array, h: float, *noise: Any) -> Array:
        asked[law] += 1
        return scheme.step(problem, y, h, *noise)

    def begun(at: Law, _finding: Finding | None) -> None:
        nonlocal law
        law = at.name

    verify(replace(scheme, step=step, solve=None, batched=False), progress=begun)
    return asked


def main() -> None:
    """Print the table as Markdown."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n\n")[0])
    parser.add_argument("schemes", nargs="*", default=["midpoint", "energy-preserving"])
    print("| scheme | steps | most of them |\n|---|--:|---|")
    for name in over(parser.parse_args().schemes):
        asked = counted(name)
        most = ", ".join(f"{law} {n}" for law, n in asked.most_common(5))
        print(f"| {name} | {asked.total()} | {most} |", flush=True)


if __name__ == "__main__":
    start(main)
