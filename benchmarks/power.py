"""How surely is a fault of one stratum, or of a pair of strata, found by the law that states it?

``python -m benchmarks.power [--seeds N]``. The schemes are saboteurs, broken everywhere. Each case of a design is
measured once: a scheme broken in a pair of strata only is accused if the one that is broken everywhere is accused
in a case that lies in both. So one measurement of each case gives the power against the faults of all pairs. Random
examples, which come after the design, are not counted.
"""

from __future__ import annotations

import argparse
import warnings
from importlib import import_module
from itertools import combinations

import numpy as np

from benchmarks import over, start
from sepv.errors import SepvError
from sepv.problem import Array, Problem
from sepv.saboteurs import ALL
from sepv.scheme import Scheme
from sepv.schemes import energy_preserving
from sepv.spaces import SPACES

# Faults that show wherever the law speaks: what is asked is whether the design goes there.
FAULTS = {
    "energy": "relative-error-1e-10",
    "casimir": "relative-error-1e-10",
    "identity": "relative-error-1e-10",
    "midpoint": "relative-error-1e-10",
    "reference": "relative-error-1e-10",
    "symmetry": "relative-error-1e-10",
    "reduction": "float32",
    "noise-sum": "c-squared",
    "equivariance": "first component off by 1e-9 of max y",
    "reproducibility": "relative error of 1e-12 in batches",
}


def _first_component(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    y1 = energy_preserving.step(problem, y, h, dW)
    y1[0] += 1e-9 * np.max(np.abs(y1), axis=0)
    return y1


def _in_batches(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    y1 = energy_preserving.step(problem, y, h, dW)
    return y1 * (1 + 1e-12) if y.ndim > 1 and y.shape[1] > 1 else y1


OWN = {
    "first component off by 1e-9 of max y": Scheme("first component", _first_component),
    "relative error of 1e-12 in batches": Scheme("in batches", _in_batches, batched=True),
}


def measured(law: str, name: str, seed: int) -> dict[tuple[int, ...], bool]:
    """For each row of the law's design, whether its case accuses the saboteur."""
    check = import_module(f"sepv.properties.test_{law.replace('-', '_')}").check
    scheme = OWN[name] if name in OWN else ALL[name].scheme
    found = {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for row, case in over(SPACES["single"][law].cases(seed), lambda _: f"seed {seed}"):
            try:
                found[row] = check(scheme, case).violates
            except SepvError:
                found[row] = False
    return found


def power(law: str, seen: dict[tuple[int, ...], bool]) -> tuple[int, int, int, int]:
    """Strata in which the fault is found, strata, pairs in which it is found, pairs that are possible."""
    space = SPACES["single"][law]
    levels = [(a, k) for a, axis in enumerate(space.axes) for k in range(len(axis.strata))]
    impossible = space.design().impossible
    possible = [p for p in combinations(levels, 2) if p[0][0] != p[1][0] and p not in impossible]
    hits = [set(enumerate(row)) for row, violates in seen.items() if violates]
    strata = sum(any(level in hit for hit in hits) for level in levels)
    pairs = sum(any(set(pair) <= hit for hit in hits) for pair in possible)
    return strata, len(levels), pairs, len(possible)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=3)
    seeds = parser.parse_args().seeds
    print("| law | broken | cases | visited: strata, pairs | found: strata | found: pairs |")
    print("|---|---|---|---|---|---|")
    for law, name in over(FAULTS.items(), lambda item: f"{item[0]}, {item[1]}"):
        rows = len(SPACES["single"][law].design().rows)
        visited = power(law, dict.fromkeys(SPACES["single"][law].design().rows, True))
        totals = [power(law, measured(law, name, seed)) for seed in range(seeds)]
        strata, pairs = (sum(t[i] for t in totals) / sum(t[i + 1] for t in totals) for i in (0, 2))
        print(
            f"| {law} | {name} | {rows} | {visited[0]}/{visited[1]}, {visited[2]}/{visited[3]} "
            f"| {strata:.4f} | {pairs:.4f} |",
            flush=True,
        )


if __name__ == "__main__":
    start(main)
