"""mici's integrators of Hamiltonian systems with a constant mass matrix.
Needs the extra ``samplers``.
"""

from __future__ import annotations

from functools import partial
from typing import Any

from mici import integrators
from mici.errors import IntegratorError
from mici.matrices import DensePositiveDefiniteMatrix, PositiveDiagonalMatrix
from mici.states import ChainState
from mici.systems import EuclideanMetricSystem

from sepv.peers._integrator import REVERSIBLE, SYMPLECTIC, diagonal, integrator
from sepv.peers.peer import Peer
from sepv.problem import Array, Mechanics
from sepv.schemes import Scheme

_BASE = (
    'mici.integrators.Integrator: "approximates the flow-map with Ψ(t) ≈ Φ(t) over some small time interval t, while '
    'conserving the properties of being time-reversible and symplectic".'
)


def _advance(make: Any, system: Mechanics, q: Array, p: Array, h: float) -> tuple[Any, Any]:
    masses = system.mass
    posed = EuclideanMetricSystem(
        lambda q: float(system.potential(q)),
        metric=PositiveDiagonalMatrix(masses.diagonal())
        if diagonal(system)
        else DensePositiveDefiniteMatrix(masses),
        grad_neg_log_dens=lambda q: -system.force(q),
    )
    try:
        state = make(posed, step_size=h).step(ChainState(pos=q, mom=p, dir=1))
    except IntegratorError as error:  # its solver did not converge, or a step back does not return
        raise ArithmeticError(str(error)) from error
    return state.pos, state.mom


def _scheme(name: str) -> Scheme:
    advance = partial(_advance, getattr(integrators, f"{name}Integrator"))
    claims = SYMPLECTIC + REVERSIBLE
    return integrator(f"mici {name}Integrator", advance, order=2, claims=claims, source=_BASE)


leapfrog = _scheme("Leapfrog")
bcss_two_stage = _scheme("BCSSTwoStage")
bcss_three_stage = _scheme("BCSSThreeStage")
bcss_four_stage = _scheme("BCSSFourStage")
# The solvers of these stop at max|x − f(x)| < 1e-9 by default.
implicit_leapfrog = _scheme("ImplicitLeapfrog")
implicit_midpoint = _scheme("ImplicitMidpoint")

PEER = Peer(
    "mici",
    integrators={
        "leapfrog": leapfrog, "bcss-two-stage": bcss_two_stage, "bcss-three-stage": bcss_three_stage,
        "bcss-four-stage": bcss_four_stage, "implicit-leapfrog": implicit_leapfrog,
        "implicit-midpoint": implicit_midpoint,
    },
)  # fmt: skip
