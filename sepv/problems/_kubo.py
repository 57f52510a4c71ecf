"""Kubo's oscillator: H_0 = ½a(p² + q²) and σH_1 = ½σ(p² + q²), and the exact solution is a rotation by aT + σW(T).

R. Kubo, M. Toda and N. Hashitsume, Statistical Physics II (1991), §2.1; G. N. Milstein, Yu. M. Repin and M. V.
Tretyakov (SIAM J. Numer. Anal. 40, 2002), §5.1, use it for symplectic methods with multiplicative noise.
"""

from __future__ import annotations

from functools import lru_cache

from sepv.problem import HamiltoniansProblem, Problem, StructuresProblem
from sepv.problems._polynomial_system import started
from sepv.problems._several import closed_form, commuting_actions
from sepv.record import PolynomialMap
from sepv.record import _polynomial as poly


def kubo_oscillator(a: float = 2.0, sigma: float = 0.5) -> Problem:
    """The oscillator from (1, 0)."""
    H, one = poly.scale(a, poly.variable(1, 0)), poly.variable(1, 0)
    exact = closed_form(H, (sigma,), [list(poly.gradient(one))])
    data = commuting_actions(H, [one], (sigma,))
    return started(data, "kubo-oscillator", (1.0, 0.0), closed_form=exact)


@lru_cache(maxsize=1)
def kubo_by_hamiltonians() -> Problem:
    """The oscillator as a record with H_1, for schemes that ask for its gradient: H_0 and H_1 commute."""
    problem = kubo_oscillator()
    H = poly.polynomial(2, [((2, 0), 0.5), ((0, 2), 0.5)])
    assert isinstance(problem, StructuresProblem)
    return HamiltoniansProblem(
        2, problem.structure, problem.hamiltonian, problem.gradient,
        noise=tuple(problem.c.tolist()), hessian=problem.hessian, structure_derivative=problem.structure_derivative,
        initial=problem.initial, name=problem.name, closed_form=problem.closed_form,
        noise_hamiltonians=(PolynomialMap((), (H,)),), check=False,
    )  # fmt: skip
