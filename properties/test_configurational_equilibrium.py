"""For friction with a quadratic V some schemes have the exact stationary covariance of q, for every stable step h.

This is known of BAOAB (B. Leimkuhler and C. Matthews, Appl. Math. Res. Express 2013) and of the method of N.
Grønbech-Jensen and O. Farago (Mol. Phys. 111, 2013): ⟨q²⟩ = kT/ω² for V = ½ω²q², where ⟨p²⟩ = kT(1 − ¼h²ω²). A wrong
factor of the noise, such as e^{−γh/2}σ in place of √((1 − e^{−2γh})/(2γh))σ, has the right order of h in all moments,
and breaks this law.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from sepv.properties._stationary import balanced, of_step

from sepv.errors import Unasked, UsageError
from sepv.problem import Problem, mechanics
from sepv.record import EPS
from sepv.schemes import Scheme
from sepv.verification import Effort, Finding, Law, Measurement, Run, Verdict, require

# Step sizes in units of 1/|λ| for the fastest eigenvalue λ of the drift.
SIZES = (1.0, 0.5, 0.125)
# The roundings of a step and of its differences, in eps times the condition of the equations. Not derived: it is ten
# times the largest share that was measured for right schemes.
ROUNDING = 64.0


def positions(problem: Problem) -> np.ndarray:
    """The numbers of the positions among the components of y."""
    try:
        return np.asarray(mechanics(problem).split(np.arange(1.0 * problem.dimension))[0], dtype=np.intp)
    except UsageError as error:
        raise Unasked(f"{problem.name} is not mechanical") from error


def measurements(scheme: Scheme, seed: int) -> list[tuple[Measurement, float]]:
    """A measurement, and the step size, for each problem with a quadratic V and each stable size."""
    taken = []
    for problem, wanted in balanced(scheme, seed):
        q = positions(problem)
        sizes = np.sqrt(np.diag(wanted.covariance)[q])
        for share in SIZES:
            h = share * wanted.time
            found = of_step(scheme, problem, h, wanted)
            if isinstance(found, str):
                continue
            S, exact = found.covariance[np.ix_(q, q)], wanted.covariance[np.ix_(q, q)]
            off = float(np.max(np.abs(S - exact) / np.outer(sizes, sizes)))
            bound = (ROUNDING * EPS + scheme.precision) * max(found.condition, wanted.condition)
            text = (
                f"{problem.name}, h = {h:.3g}: ⟨δq²⟩ = {np.diag(S).tolist()}, exact {np.diag(exact).tolist()}"
            )
            taken.append((Measurement(off / EPS, bound / EPS, text), h))
    return taken


def run(law: Law, scheme: Scheme, this_run: Run) -> Finding:
    """Compare the covariance of q with the exact one, on each problem with a quadratic V."""
    try:
        taken = measurements(scheme, this_run.effort.seed)
    except Unasked as reason:
        return law.finding(Verdict.NOT_APPLICABLE, message=reason.reason)
    if not taken:
        why = f"no step of {', '.join(map(str, SIZES))} /|λ| is affine and stable"
        return law.finding(Verdict.NOT_APPLICABLE, message=why)
    worst, h = max(taken, key=lambda each: each[0].ratio)
    sizes = {"defect": worst.defect, "bound": worst.bound, "checks": len(taken)}
    if not worst.violates:
        return law.finding(Verdict.HOLDS, **sizes)
    witness, command = {"measured": worst.detail, "h": h}, f"--law {law.name}"
    return law.finding(Verdict.VIOLATED, **sizes, message=worst.detail, witness=witness, replay=command)


def replay(law: Law, scheme: Scheme, witness: dict[str, Any]) -> Finding:  # noqa: ARG001 - it has nothing random
    """Measure again: a witness is the worst measurement."""
    return run(law, scheme, Run(Effort()))


law = Law(
    name="configurational-equilibrium",
    statement="with friction and quadratic V, the stationary covariance of q is exact for every stable step",
    source="Leimkuhler and Matthews (2013)",
    unit="ulp of 1",
    cost=0.1,
    middle="a step with a state is no map of y alone",
    run=run,
    replay=replay,
)


def test_configurational_equilibrium(scheme: Scheme, effort: Effort) -> None:
    require(law, scheme, effort)
