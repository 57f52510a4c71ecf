"""SciPy's ODE solvers over one step, at their default tolerances, for comparison:
they preserve no structure.
"""

from __future__ import annotations

from functools import partial

import numpy as np
from scipy.integrate import solve_ivp

from sepv.peers._integrator import integrator
from sepv.peers.peer import Peer
from sepv.problem import Array, Mechanics
from sepv.schemes import Scheme


def _advance(method: str, system: Mechanics, q: Array, p: Array, h: float) -> tuple[Array, Array]:
    def field(_t: float, y: Array) -> Array:
        q, p = np.split(y, 2)
        return np.concatenate([system.velocity(p), system.force(q)])

    solution = solve_ivp(field, (0.0, h), np.concatenate([q, p]), method=method)
    if not solution.success:
        raise ArithmeticError(solution.message)
    q1, p1 = np.split(solution.y[:, -1], 2)
    return q1, p1


def _scheme(method: str) -> Scheme:
    source = "scipy.integrate.solve_ivp: default tolerances rtol=1e-3, atol=1e-6; no law is claimed."
    return integrator(f"scipy {method}", partial(_advance, method), source=source)


rk45, dop853, radau = (_scheme(method) for method in ("RK45", "DOP853", "Radau"))

PEER = Peer("scipy", integrators={"rk45": rk45, "dop853": dop853, "radau": radau})
