"""How much do few steps tell? ``python -m benchmarks.spared``: sampled laws on schemes that take one state at a time.

Right schemes first: how many seeds of *mean-square-order*, *weak-order*, *right-limit* and *rounding* end in each
verdict. Then Euler-Heun with a fault of a size: a noise or a drift too large by the share ε, the part ε of Itô's
correction left out, or ε f (ΔW₁² − h) added, which makes the order ½; and (2.1) by a fixed point stopped at ε. A
fault is named where its law says `violated`; where a law is open it is red too, but accuses nobody.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from sepv.reference.faults.saboteurs.solver import _fixed_point, _iterated

from benchmarks import over, start
from sepv import schemes, verify
from sepv.problem import Array, Problem
from sepv.schemes import Scheme, Step
from sepv.verification import Effort

LAWS = ("mean-square-order", "weak-order", "right-limit", "rounding")
RIGHT = ("midpoint", "energy-preserving", "euler-heun", "milstein", "explicit-8")


def _field(problem: Problem, y: Array) -> Array:
    return np.asarray(np.einsum("ij...,j...->i...", problem.structure(y), problem.gradient(y)))


def _added(size: float, more: Callable[[Problem, Array, float, Array], Array]) -> Step:
    """Euler-Heun, and so much of something else."""
    return lambda p, y, h, dW: schemes.euler_heun.step(p, y, h, dW) + size * more(p, y, h, dW)


def _correction(problem: Problem, y: Array, h: float, _dW: Array) -> Array:
    """−½h Σ c_j² f′f, by a central difference: its error only changes ε a little."""
    ahead = 1e-5 * _field(problem, y)
    slope = (_field(problem, y + ahead) - _field(problem, y - ahead)) / 2e-5
    return -0.5 * h * float(np.sum(problem.c**2)) * slope


# By what is wrong: the law that is to name it, and the step with a fault of size ε.
FAULTS: dict[str, tuple[str, Callable[[float], Step]]] = {
    "noise": ("right-limit", lambda e: lambda p, y, h, dW: schemes.euler_heun.step(p, y, h, (1 + e) * dW)),
    "drift": ("right-limit", lambda e: lambda p, y, h, dW: schemes.euler_heun.step(p, y, (1 + e) * h, dW)),
    "Itô": ("right-limit", lambda e: _added(e, _correction)),
    "order": ("mean-square-order", lambda e: _added(e, lambda p, y, h, dW: (dW[0] ** 2 - h) * _field(p, y))),
    "solver": ("rounding", lambda e: _iterated(_fixed_point, 60, e)().step),
}


def verdicts(scheme: Scheme, laws: list[str], seeds: range) -> Counter[tuple[str, str]]:
    """How many seeds of each law end so."""
    alone = replace(scheme, batched=False, solve=None)
    runs = (
        verify(alone, laws=laws, effort=Effort(seed=seed, shrink_checks=0))
        for seed in over(seeds, lambda n: f"seed {n}")
    )
    return Counter((found.law, found.verdict.text) for run in runs for found in run.findings)


def main() -> None:
    """Print a line for each scheme."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--start", type=int, default=0)
    parser.add_argument("--scheme", action="append", choices=RIGHT, help="right ones; without --fault all")
    parser.add_argument("--fault", choices=FAULTS)
    parser.add_argument("--size", type=float, action="append", default=[])
    options = parser.parse_args()
    seeds = range(options.start, options.start + options.seeds)
    rows = [(name, schemes.by_name(name), LAWS) for name in options.scheme or RIGHT if not options.fault]
    for size in options.size:
        law, step = FAULTS[options.fault]
        wrong = Scheme("wrong", step(size), (law,), mean_square_order=1.0)
        rows.append((f"{options.fault} {size:g}", wrong, (law,)))
    for name, scheme, laws in rows:
        found = verdicts(scheme, [law for law in laws if law in scheme.claims], seeds)
        said = ", ".join(f"{law} {verdict} {n}" for (law, verdict), n in sorted(found.items()))
        print(f"{name}, {options.seeds} seeds: {said}", flush=True)


if __name__ == "__main__":
    start(main)
