"""The weak error of one step is O(h^(q+1)) for a claimed weak order q, by quadrature over ΔW.

Test functions are polynomials of degree 1, …, 2q + 1 in y − y0, as in G. N. Milstein, Numerical
Integration of Stochastic Differential Equations (1995), §9.
"""

from __future__ import annotations

from typing import Any

from sepv.properties._orders.local_example import weak_example
from sepv.properties._orders.local_orders import judge, mean_slope
from sepv.properties._sampled import FIRST_STEP, of_one_step

from sepv.law import Effort, Finding, Law, Run, about_noise, require
from sepv.schemes import Scheme, order_of


def run(law: Law, scheme: Scheme, this_run: Run) -> Finding:
    """Compare the slope of the weak error of one step with the claimed weak order (1 without a
    claim).
    """
    return judge(
        law,
        scheme,
        this_run,
        lambda errors: errors.weak,
        lambda errors: order_of(scheme.weak_order, errors.column),
        mean_slope,
        1.0,
        example=weak_example,
    )


def replay(law: Law, scheme: Scheme, _witness: dict[str, Any]) -> Finding:
    """Run the law again, because it draws no random numbers that a witness would have to store."""
    return run(law, scheme, Run())


law = Law(
    name="local-weak",
    statement="the error of expectations after one step is O(h^(q+1)) for the claimed weak order q (default: 1)",
    source="§5",
    unit="slope",
    cost=0.1,
    run=about_noise(of_one_step(run)),
    replay=replay,
    middle=FIRST_STEP,
)


def test_local_weak(scheme: Scheme, effort: Effort) -> None:
    require(law, scheme, effort)
