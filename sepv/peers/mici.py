"""mici's integrators of Hamiltonian systems, with a Euclidean metric. Needs the extra ``samplers``."""

from __future__ import annotations

from functools import partial
from typing import Any

from mici import integrators
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
    state = make(posed, step_size=h).step(ChainState(pos=q, mom=p, dir=1))
    return state.pos, state.mom


def _scheme(name: str, source: str) -> Scheme:
    advance = partial(_advance, getattr(integrators, f"{name}Integrator"))
    claims = SYMPLECTIC + REVERSIBLE
    return integrator(f"mici {name}Integrator", advance, order=2, claims=claims, source=f"{_BASE} {source}")


_COMPOSED = 'SymmetricCompositionIntegrator: "symmetric consistent methods of at least order two".'
_SOLVED = 'Its docstring: "second-order". Its solver stops at max|x − f(x)| < 1e-9 by default.'
leapfrog = _scheme("Leapfrog", _COMPOSED)
bcss_two_stage = _scheme("BCSSTwoStage", _COMPOSED)
bcss_three_stage = _scheme("BCSSThreeStage", _COMPOSED)
bcss_four_stage = _scheme("BCSSFourStage", _COMPOSED)
implicit_leapfrog = _scheme("ImplicitLeapfrog", _SOLVED)
implicit_midpoint = _scheme("ImplicitMidpoint", _SOLVED)

PEER = Peer(
    "mici",
    integrators={
        "leapfrog": leapfrog, "bcss-two-stage": bcss_two_stage, "bcss-three-stage": bcss_three_stage,
        "bcss-four-stage": bcss_four_stage, "implicit-leapfrog": implicit_leapfrog,
        "implicit-midpoint": implicit_midpoint,
    },
)  # fmt: skip
