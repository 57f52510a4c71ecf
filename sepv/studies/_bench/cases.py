"""The cases of the regression benchmark, as data: a saved record contains its cases,
so that it can be measured again.

A portable case uses only + − × ÷ and √. IEEE 754 fixes their results to the last bit on every
machine, so the case's counters can be committed. Sines, logarithms and the nodes of a quadrature
(from LAPACK) differ in the last bit between machines. In one of a few thousand solves, the number
of iterations then differs too.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from sepv import problems
from sepv.errors import UsageError, require_one_of
from sepv.problem import PolynomialSystem
from sepv.record import polynomial

Case = dict[str, Any]


def volterra() -> PolynomialSystem:
    """A system with a quadratic Poisson structure: B₁₂ = y₁y₂, B₂₃ = y₂y₃ and H = ½|y|²."""
    H = polynomial(3, [((2, 0, 0), 0.5), ((0, 2, 0), 0.5), ((0, 0, 2), 0.5)])
    B = (0, 1, polynomial(3, [((1, 1, 0), 1.0)])), (1, 2, polynomial(3, [((0, 1, 1), 1.0)]))
    return PolynomialSystem(3, H, B)


def quartic_body() -> PolynomialSystem:
    """A rigid body whose averaged gradient needs two nodes: B = hat(y)
    and H = ½Σ y_i²/I_i + ¼y₁⁴ + ½y₁²y₂².
    """
    H = polynomial(
        3, [((2, 0, 0), 1.5), ((0, 2, 0), 0.75), ((0, 0, 2), 0.5), ((4, 0, 0), 0.25), ((2, 2, 0), 0.5)]
    )
    rows = ((0, 1, ((0, 0, 1), -1.0)), (0, 2, ((0, 1, 0), 1.0)), (1, 2, ((1, 0, 0), -1.0)))
    structure = tuple((i, j, polynomial(3, [entry])) for i, j, entry in rows)
    return PolynomialSystem(3, H, structure, casimirs=(((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),))


def _case(name: str, problem: Any, h: float, steps: int, *, portable: bool, initial: Any = None) -> Case:
    return {
        "name": name, "problem": problem, "initial": initial, "h": h, "steps": steps, "paths": 512, "seed": 1,
        "portable": portable,
    }  # fmt: skip


# Lotka-Volterra has a step h so small that every solve has a solution. With h = 2⁻⁵, Newton takes
# four iterations.
BENCH_CASES: tuple[Case, ...] = (
    _case("harmonic-oscillator", "harmonic-oscillator", 2.0**-5, 16, portable=True),
    _case("rigid-body", "rigid-body", 2.0**-5, 16, portable=True),
    _case("volterra", problems.to_json(volterra()), 2.0**-5, 16, portable=True, initial=[1.0, 0.75, 0.5]),
    _case("quartic-body", problems.to_json(quartic_body()), 2.0**-5, 16, portable=False, initial=[0.8, 0.6, 0.1]),
    _case("pendulum", "pendulum", 2.0**-5, 16, portable=False),
    _case("lotka-volterra", "lotka-volterra", 2.0**-8, 16, portable=False),
)  # fmt: skip


def own_case(target: str) -> Case:
    """Make a case of a user's problem: 16 steps of size h = 2⁻⁵ from the problem's initial state.

    The target is a name, a file or module:attribute. Raises UsageError for a problem without an
    initial state.
    """
    from sepv.schemes import load_problem

    problem = load_problem(target)
    initial = None if problem.initial is None else [float(v) for v in np.asarray(problem.initial)]
    if initial is None:
        raise UsageError(
            expected="a problem with an initial state", received=f"{target} without one",
            remedy="give initial= when making it, or \"initial\" in its file",
        )  # fmt: skip
    named = target if ":" in target else None
    return _case(
        problem.name,
        named or (problems.to_json(problem.data) if isinstance(problem.data, PolynomialSystem) else target),
        2.0**-5, 16, portable=False, initial=initial,
    )  # fmt: skip


def choose(names: tuple[str, ...], portable: bool) -> list[Case]:
    """The cases with one of the `names`, or all cases if there are no names; with `portable`,
    only portable cases.

    Raises UsageError for an unknown name.
    """
    known = {case["name"]: case for case in BENCH_CASES}
    for name in names:
        require_one_of("a case", name, known)
    return [c for c in BENCH_CASES if (not names or c["name"] in names) and (c["portable"] or not portable)]
