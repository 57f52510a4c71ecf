"""How surely does a law find a fault that shows in one stratum of its cases only,
or in one pair of strata?

``python -m benchmarks.power [--seeds N] [--start S]``. A stratum is a part of the test cases, such
as those with d = 3. A law's design is a list of cases that covers the strata and their pairs. The
schemes are saboteurs (broken on purpose). In the strata that the table names they are right, or
their error is below rounding. Each case of the design is measured once. If the saboteur is accused
in a case of two strata, so is a scheme that is broken only in this pair of strata. So one
measurement of each case gives the power for all pairs. Random examples, which come after the
design, do not count.
"""

from __future__ import annotations

import sys
import warnings
from dataclasses import replace
from functools import partial
from importlib import import_module
from itertools import combinations
from typing import NamedTuple

import numpy as np

from benchmarks import arguments, over, start
from sepv.errors import SchemeFault, SepvError
from sepv.faults.saboteurs import SABOTEURS
from sepv.law.cases.strata import Space
from sepv.problem import Array, Problem, Systems
from sepv.schemes import Scheme, Step, both_invariants, energy_preserving, page_of, several_structures
from sepv.verification import load_laws


class FaultOfLaw(NamedTuple):
    """A scheme that a law must accuse, and the strata in which it is right or its error is below
    rounding.
    """

    law: str
    broken: str
    exempt: tuple[str, ...] = ()
    systems: Systems = Systems.SINGLE


# A quadrature with too few nodes, or B at the wrong place, causes an error that is a power of
# step/contraction radius.
_SHORT_STEPS = "step/radius: 2⁻¹⁰"
_QUADRATIC = ("degree of H: 1–2", _SHORT_STEPS)
_CONSTANT_B = ("degree of B: 0", _SHORT_STEPS)

# First faults that show in all cases to which the law applies, to test which cases a design has.
# Then subtler faults.
POWER_FAULTS = (
    *(
        FaultOfLaw(law, "relative-error-1e-10")
        for law in ("energy", "casimir", "identity", "midpoint", "reference", "symmetry")
    ),
    FaultOfLaw("reduction", "float32"),
    FaultOfLaw("noise-sum", "c-squared"),
    FaultOfLaw("equivariance", "first component off by 1e-9 of max y"),
    FaultOfLaw("reproducibility", "relative error of 1e-12 in batches"),
    FaultOfLaw("energy", "one-point-quadrature", _QUADRATIC),
    FaultOfLaw("casimir", "b-at-y0", (*_CONSTANT_B, "Casimirs: linear")),
    FaultOfLaw("casimir", "float32-structure", (*_CONSTANT_B, "Casimirs: linear")),
    FaultOfLaw("symmetry", "b-at-y0", _CONSTANT_B),
    FaultOfLaw("reference", "one-point-quadrature", _QUADRATIC),
    FaultOfLaw("reference", "step-off-by-1e-10", (_SHORT_STEPS,)),
    FaultOfLaw("midpoint", "b-at-y1", _CONSTANT_B),
    FaultOfLaw("reduction", "step-off-by-1e-10", (_SHORT_STEPS,)),
    FaultOfLaw("noise-sum", "first noise too large by 1e-4", (_SHORT_STEPS,)),
    FaultOfLaw("random-step", "drift-too-large"),
    FaultOfLaw("random-step", "explicit-drift-structure", _CONSTANT_B),
    FaultOfLaw("expansion", "drift-too-large"),
    FaultOfLaw("expansion", "ito-correction"),
    FaultOfLaw("identity", "drift-too-large", ("why: ∇H = 0", "m: 0")),
    FaultOfLaw("reproducibility", "first-of-a-batch"),
    FaultOfLaw("contract", "changes-y-in-batches"),
    FaultOfLaw("contract", "returns-a-buffer"),
    FaultOfLaw("energy", "one-point-quadrature", _QUADRATIC, Systems.NAMBU),
    FaultOfLaw(
        "invariant:casimir", "(2.1)", ("degree of C: 1", "degree of C: 2", _SHORT_STEPS), Systems.NAMBU
    ),
    FaultOfLaw("invariant:casimir", "relative error of 1e-10", (), Systems.NAMBU),
    FaultOfLaw("symmetry", "relative error of 1e-10", (), Systems.NAMBU),
    FaultOfLaw("reference", "relative error of 1e-10", (), Systems.NAMBU),
    FaultOfLaw("energy", "relative error of 1e-10", (), Systems.SEVERAL),
    FaultOfLaw("symmetry", "relative error of 1e-10", (), Systems.SEVERAL),
    FaultOfLaw("reference", "relative error of 1e-10", (), Systems.SEVERAL),
    FaultOfLaw("reference", "first noise too large by 1e-4", (_SHORT_STEPS,), Systems.SEVERAL),
    FaultOfLaw("noise-sum", "first noise too large by 1e-4", (_SHORT_STEPS,), Systems.SEVERAL),
)


def _first_component(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    y1 = energy_preserving.step(problem, y, h, dW)
    y1[0] += 1e-9 * np.max(np.abs(y1), axis=0)
    return y1


def _in_batches(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    y1 = energy_preserving.step(problem, y, h, dW)
    return y1 * (1 + 1e-12) if y.ndim > 1 and y.shape[1] > 1 else y1


OWN_SCHEMES = {
    "first component off by 1e-9 of max y": Scheme("first component", _first_component),
    "relative error of 1e-12 in batches": Scheme("in batches", _in_batches, batched=True),
}


def _off(problem: Problem, y: Array, h: float, dW: Array, *, step: Step) -> Array:
    return step(problem, y, h, dW) * (1 + 1e-10)


def _first_noise(problem: Problem, y: Array, h: float, dW: Array, *, step: Step) -> Array:
    return step(problem, y, h, np.concatenate([(1 + 1e-4) * dW[:1], dW[1:]]))


_SCHEME_OF_CLASS = {
    Systems.SINGLE: energy_preserving,
    Systems.NAMBU: both_invariants,
    Systems.SEVERAL: several_structures,
}


def scheme_of(fault: FaultOfLaw) -> Scheme:
    """The broken scheme of a fault, for the class of systems on which the law runs."""
    right = _SCHEME_OF_CLASS[fault.systems]
    if fault.broken == "relative error of 1e-10":
        return replace(right, step=partial(_off, step=right.step), solve=None)
    if fault.broken == "first noise too large by 1e-4":
        return replace(right, step=partial(_first_noise, step=right.step), solve=None)
    if fault.systems is Systems.SINGLE:
        return OWN_SCHEMES[fault.broken] if fault.broken in OWN_SCHEMES else SABOTEURS[fault.broken].scheme
    step = energy_preserving.step if fault.broken == "(2.1)" else SABOTEURS[fault.broken].scheme.step
    return replace(right, step=step, solve=None)


def _space(fault: FaultOfLaw) -> Space:
    (law,) = load_laws([fault.law])
    assert law.cases is not None
    space = law.cases.space(fault.systems)
    assert space is not None
    return space


def measured(fault: FaultOfLaw, seed: int) -> dict[tuple[int, ...], bool]:
    """Map each row of the law's design to True if the law accuses the scheme in the case of this
    row.
    """
    module = import_module(f"sepv.properties.test_{page_of(fault.law).replace('-', '_')}")
    check = module.check_casimir if fault.law == "invariant:casimir" else module.check
    found = {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for row, case in over(_space(fault).cases(seed), lambda _: f"seed {seed}"):
            try:
                found[row] = check(scheme_of(fault), case).violates
            except SchemeFault:
                found[row] = fault.law == "contract"
            except SepvError:
                found[row] = False
    return found


def power(fault: FaultOfLaw, seen: dict[tuple[int, ...], bool]) -> tuple[int, int, int, int, set[str]]:
    """The power of a law against one fault.

    The result has the number of strata in which the fault is found, the number of all strata, these
    two numbers for pairs of strata, and the names of the missed pairs.
    """
    space = _space(fault)
    levels = [
        (a, k)
        for a, axis in enumerate(space.axes)
        for k, stratum in enumerate(axis.strata)
        if f"{axis.name}: {stratum.name}" not in fault.exempt
    ]
    impossible = space.design().impossible
    possible = [p for p in combinations(levels, 2) if p[0][0] != p[1][0] and p not in impossible]
    hits = [set(enumerate(row)) for row, violates in seen.items() if violates]
    strata = sum(any(level in hit for hit in hits) for level in levels)
    pairs = sum(any(set(pair) <= hit for hit in hits) for pair in possible)
    missed = {p for p in possible if not any(set(p) <= hit for hit in hits)}
    names = {
        " and ".join(f"{space.axes[a].name}: {space.axes[a].strata[k].name}" for a, k in p) for p in missed
    }
    return strata, len(levels), pairs, len(possible), names


def main() -> None:
    """Print the table."""
    options = arguments(
        __doc__,
        seeds={"type": int, "default": 3, "help": "how many"},
        start={"type": int, "default": 0, "help": "the first: one that nobody has looked at while tuning"},
        law={"action": "append", "help": "only this one"},
        missed={"action": "store_true", "help": "name the pairs that were missed"},
    )
    print("| systems | law | broken | but for | cases | found: strata | found: pairs | of |", flush=True)
    print("|---|---|---|---|--:|--:|--:|--:|")
    asked = [f for f in POWER_FAULTS if not options.law or f.law in options.law]
    for fault in over(asked, lambda f: f"{f.systems}: {f.law}, {f.broken}"):
        rows = len(_space(fault).design().rows)
        totals = [
            power(fault, measured(fault, seed))
            for seed in range(options.start, options.start + options.seeds)
        ]
        strata = sum(t[0] for t in totals) / sum(t[1] for t in totals)
        pairs = sum(t[2] for t in totals) / sum(t[3] for t in totals)
        print(
            f"| {fault.systems} | {fault.law} | {fault.broken} | {', '.join(fault.exempt)} | {rows} "
            f"| {strata:.4f} | {pairs:.4f} | {totals[0][3]} |",
            flush=True,
        )
        if options.missed:
            for name in sorted(set().union(*(t[4] for t in totals))):
                print(f"    missed: {name}", file=sys.stderr)


if __name__ == "__main__":
    start(main)
