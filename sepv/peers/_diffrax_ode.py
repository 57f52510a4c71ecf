"""diffrax's solvers of ordinary differential equations, one step at a time, for mechanical
systems.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import diffrax
import jax

from sepv.peers._integrator import SYMPLECTIC, integrator
from sepv.peers._jax import advance_by
from sepv.schemes import Scheme


def _step(name: str, V: Any, inverse_mass: Any, q: Any, p: Any, h: Any) -> tuple[Any, Any]:
    def velocity(_t: Any, p: Any, _args: Any) -> Any:
        return inverse_mass * p if inverse_mass.ndim == 1 else inverse_mass @ p

    def force(_t: Any, q: Any, _args: Any) -> Any:
        return -jax.grad(V)(q)

    if name == "SemiImplicitEuler":
        terms: Any = (diffrax.ODETerm(velocity), diffrax.ODETerm(force))
    else:
        terms = diffrax.ODETerm(lambda t, y, args: (velocity(t, y[1], args), force(t, y[0], args)))
    solver, start = getattr(diffrax, name)(), 0.0 * h
    state = solver.init(terms, start, h, (q, p), None)
    y1, *_ = solver.step(terms, start, h, (q, p), None, state, made_jump=False)
    return y1[0], y1[1]


def _scheme(name: str, order: int, words: str, claims: tuple[str, ...] = ()) -> Scheme:
    advance, source = advance_by(partial(_step, name)), f'diffrax.{name}: "{words}".'
    return integrator(f"diffrax {name}", advance, order=order, claims=claims, source=source)


INTEGRATORS = {
    "semi-implicit-euler": _scheme("SemiImplicitEuler", 1, "Symplectic method", SYMPLECTIC),
    "tsit5": _scheme("Tsit5", 5, "5th order explicit Runge--Kutta method"),
    "dopri8": _scheme("Dopri8", 8, "8th order Runge--Kutta method"),
}
