"""The problems on which a library's solvers for general noise are measured (`Peer.solvers`), and a
solver as a scheme for them.

The problems are systems with several Hamiltonians, one system for each kind of noise. If a solver
needs space-time Lévy areas or the areas A_ij besides increments, it gets them from the path that
the reference solution uses (`sepv.simulate._areas`).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

from sepv import problems
from sepv.peers.peer import Solver
from sepv.problem import Problem
from sepv.schemes import Scheme, Systems

# One system for each kind of noise. The systems are polynomial, so that the generator gives exact
# means. They have no symmetry that would make errors vanish.
NOISE_PROBLEMS: dict[str, Callable[[], Problem]] = {
    "general": problems.random_inertia,
    "commutative": problems.commuting_twists,
    "one": problems.twisted_top,
    "additive": problems.pushed_henon_heiles,
}
NOISE_KINDS = {
    "general": "rigid body, H_1 = y_1²/2, H_2 = y_2²",
    "commutative": "rigid body, H_1 = y_3²/2, H_2 = y_3 + y_3³/6: both noises rotate about the third axis",
    "one": "rigid body, a single H_1 = y_1²/2 + y_2y_3/2 + y_3",
    "additive": "Hénon and Heiles, H_1 = p_1 − q_1/2, H_2 = p_2/2 − q_2",
}


@lru_cache(maxsize=8)
def problem_of(kind: str) -> Problem:
    """The system for this kind of noise, made once."""
    return NOISE_PROBLEMS[kind]()


def scheme(solver: Solver, kind: str) -> Scheme:
    """The solver's step as a scheme for the problem with this kind of noise;
    it claims the documented orders.
    """
    strong, weak = solver.documented[kind]
    return Scheme(
        name=f"{solver.name}, {kind}",
        step=solver.step(kind),
        mean_square_order=strong,
        weak_order=weak,
        source=solver.source,
        truncation=None,
        batched=solver.batched,
        systems=Systems.HAMILTONIANS,
        asks=solver.asks,
        problems=(problem_of(kind),),
    )
