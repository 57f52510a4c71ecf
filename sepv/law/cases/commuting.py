"""Steps of systems with several Hamiltonians that all commute with H_0,
from states that are not critical points.
"""

from __future__ import annotations

from random import Random

import numpy as np

from sepv import problems
from sepv.law.cases.case import Case
from sepv.law.cases.random_parts import hamiltonian
from sepv.law.cases.strata import monomials
from sepv.problem import Array, Problem
from sepv.problems import commuting_actions
from sepv.record import Polynomial, poly


def commuting_step(random: Random) -> Case | None:
    """A step whose Hamiltonians are polynomials in the actions ½(q² + p²) of one or two planes;
    None if ∇H_0 is small.

    The field of each noise is written G_j∇H_0, and G_j is singular where ∇H_0 = 0. No majorant
    bounds G_j near such a point. So the step's length is measured: it is a sixteenth of the length
    that the slopes of the fields at y allow.
    """
    n, m = random.randint(1, 2), random.randint(1, 2)
    H = poly.add(poly.linear((1.0,) * n), of_actions(n, random))
    others = [of_actions(n, random) for _ in range(m)]
    system = commuting_actions(H, others, tuple(random.choice([1.0, 0.5, 2.0, 0.25]) for _ in range(m)))
    y = tuple(random.choice([0.5, 1.0, -0.75]) for _ in range(2 * n))
    problem, state = problems.build(system), np.array(y)
    if not float(np.linalg.norm(problem.gradient(state))) > 0.25:
        return None
    part = 1 / (16 * (1 + _steepest(problem, state))) / (m + 1)
    dW = tuple(part * random.choice([1.0, 0.5, -0.5, 2.0**-10]) / c for c in system.noise)
    return Case(system, y, part, dW)


def of_actions(n: int, random: Random) -> Polynomial:
    """A random polynomial of degree one or two in n actions I_k, without constant term."""
    degree = random.randint(1, 2)
    return hamiltonian(n, degree, random.randint(1, min(3, monomials(n, degree))), 1.0, random)


def _steepest(problem: Problem, y: Array) -> float:
    """The largest component at y of the fields B∇H and c_j G_j∇H and of their difference
    quotients.
    """
    worst = 0.0
    for c, G in zip((1.0, *problem.c), problem.structures, strict=True):
        for k in range(y.size):
            at = y.copy()
            at[k] += 1e-6
            field, moved = G(y) @ problem.gradient(y), G(at) @ problem.gradient(at)
            sizes = np.max(np.abs(moved - field)) / 1e-6, np.max(np.abs(field))
            worst = max(worst, c * float(max(sizes)))
    return worst
