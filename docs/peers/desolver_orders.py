"""desolver ABAs5o6HSolver: it has order 4, not 6 as stated; BABs9o7HSolver has order 4, not 7.

The script prints errors at t = 2 of 4, 8 and 16 steps, relative to 512 steps. From 8 to 16 steps the errors of
ABAs5o6HSolver and BABs9o7HSolver fall by about 16 for V = q⁴/4 (order 4). For V = q²/2 they fall by 64 and more.
Both solvers are symplectic and symmetric. SymplecticEulerSolver, stated to be of order 1, is the leapfrog, of order 2.

Exit code 1 while this is so, 0 where the errors on the quartic fall as stated.
"""

import sys
from importlib.metadata import version

import numpy as np
from desolver.integrators import ABAs5o6HSolver, BABs9o7HSolver, SymplecticEulerSolver

NOTES = [
    (
        "docstring of ABAs5o6HSolver, 5.1.0 (github.com/Microno95/desolver)",
        "2026-11-23",
        "implements the 6th order ABAs5o6H symplectic integrator",
    ),
    (
        "docstring of BABs9o7HSolver, 5.1.0",
        "2026-11-23",
        "implements the 7th order BAB's9o7H symplectic integrator",
    ),
    (
        "both docstrings; no issue that we found names the orders",
        "2026-11-23",
        "Efficient Fourth Order Symplectic Integrators for Near-Harmonic Separable Hamiltonian Systems",
    ),
]


def end(kind, force, steps):
    """(q, p) at t = 2 of q″ = force(q)."""
    z, h = np.array([2.0, 1.0]), np.array(2.0 / steps)
    method = kind(sys_dim=z.shape, dtype=z.dtype)
    for n in range(steps):
        z = z + method(lambda _, y: np.array([y[1], force(y[0])]), n * h, z, {}, h)[1][1]
    return z


falls = {}
for name, force in (("quartic", lambda q: -(q**3)), ("harmonic", lambda q: -q)):
    exact = end(BABs9o7HSolver, force, 512)
    for kind, stated in ((SymplecticEulerSolver, 1), (ABAs5o6HSolver, 6), (BABs9o7HSolver, 7)):
        errors = [np.abs(end(kind, force, steps) - exact).max() for steps in (4, 8, 16)]
        falls[name, kind] = np.log2(errors[-2] / errors[-1])
        values = ", ".join(f"{error:.1e}" for error in errors)
        print(f"desolver {version('desolver')} {name:10} {kind.__name__:21} stated {stated}: {values}")
sys.exit(bool(falls["quartic", ABAs5o6HSolver] < 5))
