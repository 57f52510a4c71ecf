"""mici ImplicitLeapfrogIntegrator: a step of size t advances time by 2t.

The flow of H = (q² + p²)/2 rotates (q, p) by the angle t in the time t. The docstring composes six maps over t/2 each,
but in `_step` each is over t. The composition is symplectic and reversible.

Exit code 1 while this is so, 0 where a step of size t turns by t.
"""

import sys
from importlib.metadata import version

import mici
import numpy as np

NOTES = [
    (
        "docstring of mici.integrators.Integrator, 0.4.1 (github.com/matt-graham/mici)",
        "2024-10-07",
        "Derived classes implement a step method which approximates the flow-map with Ψ(t) ≈ Φ(t) over some small time "
        "interval t",
    ),
    (
        "docstring of ImplicitLeapfrogIntegrator, 0.4.1",
        "2024-10-07",
        "Ψ(t) = A(t/2) ∘ B(t/2) ∘ C(t/2) ∘ C*(t/2) ∘ B*(t/2) ∘ A*(t/2)",
    ),
    (
        "source of ImplicitLeapfrogIntegrator._step, 0.4.1; no note, issue or release names the factor",
        "2024-10-07",
        "self._step_a(state, time_step)",
    ),
]

metric = mici.matrices.PositiveDiagonalMatrix(np.ones(1))
system = mici.systems.EuclideanMetricSystem(
    lambda q: 0.5 * float(q @ q), metric=metric, grad_neg_log_dens=lambda q: q
)
ratios = {}
for name in ("LeapfrogIntegrator", "ImplicitLeapfrogIntegrator"):
    found = []
    for t in (0.1, 0.05, 0.025):
        start = mici.states.ChainState(pos=np.array([1.0]), mom=np.array([0.0]), dir=1)
        end = getattr(mici.integrators, name)(system, step_size=t).step(start)
        ratios[name] = float(np.arctan2(-end.mom[0], end.pos[0])) / t
        found.append(f"{ratios[name]:.4f} t")
    print(f"mici {version('mici')} {name}, t = 0.1, 0.05, 0.025: turns by {', '.join(found)}")
sys.exit(abs(ratios["ImplicitLeapfrogIntegrator"] - 1) > 0.1)
