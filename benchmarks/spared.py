"""How much do sampled laws find on schemes that take one state at a time?
``python -m benchmarks.spared``.

For right schemes the lines count the seeds with each verdict of *mean-square-order*, *weak-order*,
*right-limit* and *rounding*. ``--fault`` and ``--size ε`` choose a faulty scheme: Euler-Heun with
noise or drift times 1 + ε, without the part ε of Itô's correction, or with ε f (ΔW₁² − h) added,
which makes the order ½; or (2.1) by a fixed-point iteration that is stopped at ε. A law finds the
fault if it says `violated`; an inconclusive law accuses nobody.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from benchmarks import arguments, over, start
from sepv import schemes, verify
from sepv.faults.saboteurs.solver import fixed_point, iterated
from sepv.law import Effort
from sepv.problem import Array, Problem
from sepv.schemes import Scheme, Step

SPARED_LAWS = ("mean-square-order", "weak-order", "right-limit", "rounding")
SPARED_SCHEMES = ("midpoint", "energy-preserving", "euler-heun", "milstein", "explicit-8")


def _field(problem: Problem, y: Array) -> Array:
    return np.asarray(np.einsum("ij...,j...->i...", problem.structure(y), problem.gradient(y)))


def _added(size: float, more: Callable[[Problem, Array, float, Array], Array]) -> Step:
    """The step of Euler-Heun plus `size` times more(problem, y, h, dW)."""
    return lambda p, y, h, dW: schemes.euler_heun.step(p, y, h, dW) + size * more(p, y, h, dW)


def _correction(problem: Problem, y: Array, h: float, _dW: Array) -> Array:
    """Itô's correction −½h Σ c_j² f′f by a central difference, whose error only changes ε a
    little.
    """
    ahead = 1e-5 * _field(problem, y)
    slope = (_field(problem, y + ahead) - _field(problem, y - ahead)) / 2e-5
    return -0.5 * h * float(np.sum(problem.c**2)) * slope


# For each fault: the law that should find it, and the step with a fault of size ε.
SIZED_FAULTS: dict[str, tuple[str, Callable[[float], Step]]] = {
    "noise": ("right-limit", lambda e: lambda p, y, h, dW: schemes.euler_heun.step(p, y, h, (1 + e) * dW)),
    "drift": ("right-limit", lambda e: lambda p, y, h, dW: schemes.euler_heun.step(p, y, (1 + e) * h, dW)),
    "Itô": ("right-limit", lambda e: _added(e, _correction)),
    "order": ("mean-square-order", lambda e: _added(e, lambda p, y, h, dW: (dW[0] ** 2 - h) * _field(p, y))),
    "solver": ("rounding", lambda e: iterated(fixed_point, 60, e)().step),
}


def verdicts(scheme: Scheme, laws: list[str], seeds: range) -> Counter[tuple[str, str]]:
    """Count the seeds with each verdict of each law, for a scheme without batches."""
    alone = replace(scheme, batched=False, solve=None)
    runs = (
        verify(alone, laws=laws, effort=Effort(seed=seed, shrink_checks=0))
        for seed in over(seeds, lambda n: f"seed {n}")
    )
    return Counter((found.law, found.verdict.text) for run in runs for found in run.findings)


def main() -> None:
    """Print a line for each scheme."""
    options = arguments(
        __doc__,
        seeds=10,
        start=0,
        scheme={"action": "append", "choices": SPARED_SCHEMES, "help": "right ones; without --fault all"},
        fault={"choices": SIZED_FAULTS},
        size={"type": float, "action": "append", "default": []},
    )
    seeds = range(options.start, options.start + options.seeds)
    rows = [
        (name, schemes.by_name(name), SPARED_LAWS)
        for name in options.scheme or SPARED_SCHEMES
        if not options.fault
    ]
    for size in options.size:
        law, step = SIZED_FAULTS[options.fault]
        wrong = Scheme("wrong", step(size), (law,), mean_square_order=1.0)
        rows.append((f"{options.fault} {size:g}", wrong, (law,)))
    for name, scheme, laws in rows:
        found = verdicts(scheme, [law for law in laws if law in scheme.claims], seeds)
        said = ", ".join(f"{law} {verdict} {n}" for (law, verdict), n in sorted(found.items()))
        print(f"{name}, {options.seeds} seeds: {said}", flush=True)


if __name__ == "__main__":
    start(main)
