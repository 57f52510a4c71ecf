"""mici ImplicitMidpointIntegrator: it is reversible and symplectic to its solver's tolerance, which is absolute.

The script makes a step of h = 0.1 for V = q⁴/4 and the step back. By default mici solves the step's equation x = f(x)
to max|x − f(x)| < 1e-9, whatever the size of x. So the step back misses the start by up to 1e-9; with
`convergence_tol=1e-15` it misses by rounding. If it misses by more than 2e-8, mici raises an error, so non-convergence
is not silent.

Exit code 1 while this is so, 0 where the way back misses by rounding.
"""

import sys
from importlib.metadata import version

import mici
import numpy as np

NOTES = [
    (
        "docstring of mici.solvers.solve_fixed_point_direct, 0.4.1 (github.com/matt-graham/mici)",
        "2024-10-07",
        "Convergence tolerance - solver successfully terminates when norm(func(x) - x) < convergence_tol.",
    ),
    (
        "docstring of ImplicitMidpointIntegrator, 0.4.1",
        "2024-10-07",
        "As the iterative solve may fail to converge, or may converge to one of multiple solutions … an explicit "
        "reversibility check is performed",
    ),
]

metric = mici.matrices.PositiveDiagonalMatrix(np.ones(1))
system = mici.systems.EuclideanMetricSystem(
    lambda q: float(np.sum(q**4)) / 4, metric=metric, grad_neg_log_dens=lambda q: q**3
)


def step(y, h, **options):
    integrator = mici.integrators.ImplicitMidpointIntegrator(
        system, step_size=h, fixed_point_solver_kwargs=options
    )
    end = integrator.step(mici.states.ChainState(pos=y[:1].copy(), mom=y[1:].copy(), dir=1))
    return np.concatenate([end.pos, end.mom])


y, misses = np.array([1.0, 0.5]), []
for options in ({}, {"convergence_tol": 1e-15}):
    misses.append(float(np.abs(step(step(y, 0.1, **options), -0.1, **options) - y).max()))
    print(f"mici {version('mici')}, {options or 'default'}: the way back misses by {misses[-1]:.1e}")
sys.exit(misses[0] > 1e-13)
