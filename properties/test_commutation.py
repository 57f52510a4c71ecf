"""Several structures (§1): mean-square order 1 if the fields of the noises commute, ½ if they do not.

If the fields G_j∇H do not commute, a scheme that uses only increments of W has at most order ½: the fields'
commutators are multiplied by iterated integrals ∫W_i∘dW_j, which are of the order of h. Commutators of the drift with a
noise do not lower the order, because ∫W∘dt is of the order of h^(3/2). If all flows commute, the exact solution has a
closed form. Otherwise the reference is Heun's method with finer steps, and the report shows its error.
"""

from __future__ import annotations

from typing import Any

from sepv.properties._orders.convergence import StrongErrors, mean_square_order
from sepv.properties._sampled import pathwise
from sepv.properties._sequential import Assessment, judge
from sepv.properties._setups import Setup

from sepv.law import Effort, Finding, Law, Run, Verdict, require
from sepv.problem import Problem
from sepv.schemes import Scheme, Systems

T, STEPS = 0.5, (4, 16, 64)
# Half the distance between mean-square orders, which are multiples of ½.
MARGIN = 0.25
# For each problem the expected order, and True if no scheme that uses only increments has a higher order.
EXPECTED = {
    "commuting-rotations": (1.0, False),
    "commuting-oscillators": (1.0, False),
    "noncommuting-drift": (1.0, False),
    "noncommuting-tops": (0.5, True),
}
SETUPS = tuple(Setup(name, T, STEPS) for name in EXPECTED)


def assess(problem: Problem, errors: StrongErrors, alpha: float, more: float) -> Assessment:
    """Compare the confidence interval of the measured mean-square order with the order in EXPECTED."""
    order, at_most = EXPECTED[problem.name]
    value, low, high = mean_square_order(errors, alpha, more=more)
    verdict = Verdict.INCONCLUSIVE
    if high < order - MARGIN or (at_most and low > order + MARGIN):
        verdict = Verdict.VIOLATED
    elif low > order - MARGIN and (high < order + MARGIN or not at_most):
        verdict = Verdict.HOLDS
    reference = f", reference wrong by {errors.reference:.1e}" if errors.reference else ""
    text = (
        f"order {order:g}{'' if at_most else ' at least'} expected, {value:.3f} in [{low:.2f}, {high:.2f}], "
        f"rms error {errors.rms()[-1]:.1e} at the finest step{reference},"
    )
    off = abs(value - order) if at_most else max(order - value, 0.0)
    return Assessment(verdict, off, low, high, MARGIN, text)


def run(law: Law, scheme: Scheme, this_run: Run) -> Finding:
    """Measure the order on problems where all flows commute, where only noises commute, and where noises do not."""
    if scheme.systems != Systems.SEVERAL:
        return law.finding(Verdict.NOT_APPLICABLE, message="the scheme is not for several structures")
    return judge(law, scheme, this_run, assess, at_least=False, setups=SETUPS)


def replay(law: Law, scheme: Scheme, witness: dict[str, Any]) -> Finding:
    """Repeat the run of a witness (a stored counterexample), with its seed and number of paths."""
    return run(law, scheme, Run(Effort(seed=int(witness["seed"]), paths=int(witness["paths"]))))


law = Law(
    name="commutation",
    statement="if each noise has its own structure, the mean-square order is 1 for noises that commute, else ½",
    source="§1",
    unit="slope error",
    cost=0.1,
    run=pathwise(run),
    replay=replay,
    statistical=True,
)


def test_commutation(scheme: Scheme, effort: Effort) -> None:
    require(law, scheme, effort)
