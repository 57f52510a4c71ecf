"""For friction with a quadratic V the stationary mean and covariance of a scheme differ from the
exact ones by O(h^q).

q is the claimed weak order, 1 without a claim (D. Talay, Stochastics and Stochastics Reports 29,
1990). Both distributions are computed and not sampled (`sepv.properties._stationary`).

The part *positions* asks for the exact covariance of q, for every stable step h. This is known of
BAOAB (B. Leimkuhler and C. Matthews, Appl. Math. Res. Express 2013) and of the method of N.
Grønbech-Jensen and O. Farago (Mol. Phys. 111, 2013): ⟨q²⟩ = kT/ω² for V = ½ω²q², where ⟨p²⟩ = kT(1
− ¼h²ω²). A wrong factor of the noise, such as e^{−γh/2}σ in place of √((1 − e^{−2γh})/(2γh))σ, has
the right order of h in all moments, and breaks this part.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from sepv.properties._longest_step import divisor
from sepv.properties._orders.local_orders import Slope, judge_slope
from sepv.properties._stationary import Stationary, balanced, does_not_decay, of_step

from sepv.errors import Unasked, UsageError
from sepv.files import finite
from sepv.law import Effort, Finding, Law, Measurement, Run, Verdict, require
from sepv.problem import Array, Problem, mechanics
from sepv.record import EPS
from sepv.schemes import Scheme, order_of

# Step sizes in units of 1/|λ| for the fastest eigenvalue λ of the drift. Coarser ones are unstable
# for some schemes.
EQUILIBRIUM_SIZES = 2.0 ** -np.arange(0.0, 9.0)
# Sizes at which the covariance of q is compared. An order is measured at all of EQUILIBRIUM_SIZES
# but the first.
SIZES_OF_POSITIONS = EQUILIBRIUM_SIZES[[0, 1, 3]]
# Half of the distance of orders: the error is a series in whole powers of h.
EQUILIBRIUM_MARGIN = 0.5
# Errors above this multiple of the bound of roundings change a slope by less than a tenth.
CLEAR_FACTOR = 16.0


@dataclass(frozen=True)
class Balance:
    """A problem, its stationary distribution, and those of the scheme for the step sizes that have
    one.

    `why` says why the last of the others has none.
    """

    problem: Problem
    wanted: Stationary
    sizes: Array
    found: list[Stationary]
    why: str = ""


def balances(scheme: Scheme, seed: int, sizes: Array) -> list[Balance]:
    """The stationary distributions of a scheme and of the exact solution,
    for each problem with a quadratic V.
    """
    taken = []
    for problem, wanted in balanced(scheme, seed):
        # All are shorter for a scheme that states a longest step.
        own = sizes * wanted.time / divisor(scheme, problem, float(sizes[0] * wanted.time))
        steps = [of_step(scheme, problem, h, wanted) for h in own.tolist()]
        found = [each for each in steps if not isinstance(each, str)]
        why = [each for each in steps if isinstance(each, str)]
        taken.append(Balance(problem, wanted, own, found, why[-1] if why else ""))
    return taken


def run(
    measure: Callable[[Law, Scheme, list[Balance]], Finding],
    sizes: Array,
    law: Law,
    scheme: Scheme,
    this_run: Run,
) -> Finding:
    """Judge a law of stationary distributions on each problem with a quadratic V."""
    seed = this_run.effort.seed
    try:
        finding = measure(law, scheme, balances(scheme, seed, sizes))
    except Unasked as reason:
        return law.finding(Verdict.NOT_APPLICABLE, message=reason.reason)
    return replace(
        finding, witness={**(finding.witness or {}), "seed": seed}, replay=f"--law {law.name} --seed {seed}"
    )


def replay(law: Law, scheme: Scheme, witness: dict[str, Any]) -> Finding:
    """Run the law again with the seed of a witness (a stored counterexample),
    so that it draws the same bodies.
    """
    return law.run(law, scheme, Run(Effort(seed=int(witness["seed"]))))


def error(found: Stationary, wanted: Stationary) -> float:
    """The largest error of a mean, and of a covariance,
    in standard deviations of the exact distribution.
    """
    sizes = wanted.sizes
    off = (found.covariance - wanted.covariance) / np.outer(sizes, sizes)
    return float(max(np.max(np.abs(off)), np.max(np.abs((found.mean - wanted.mean) / sizes))))


def words(balance: Balance) -> str:
    """Both covariances at the largest stable step size."""
    found, wanted = (
        " ".join(f"{v:.6g}" for v in np.diag(each.covariance)) for each in (balance.found[0], balance.wanted)
    )
    return f"{balance.problem.name}: variances {found} at h = {balance.found[0].time:.3g}, exact {wanted}"


def order(law: Law, scheme: Scheme, taken: list[Balance]) -> Finding:
    """Judge the power of h in the error of the stationary distribution."""
    needed = order_of(scheme.weak_order, "additive") - EQUILIBRIUM_MARGIN
    lines, slopes, measured = list[str](), list[Slope](), list[dict[str, Any]]()
    for each in taken:
        name = each.problem.name
        if stays := does_not_decay(scheme, each.problem, each.wanted, each.sizes):
            slopes.append(Slope(Verdict.VIOLATED, float("nan"), stays))
            lines.append(stays)
            continue
        if not each.found:
            lines.append(f"{name}: skipped, {each.why}")
            continue
        h = np.array([found.time for found in each.found])
        errors = np.array([error(found, each.wanted) for found in each.found])
        rounding = max(found.rounding for found in each.found)
        seen = judge_slope(h, errors, needed, rounding, CLEAR_FACTOR * rounding)
        slopes.append(seen)
        sizes = {"h": h.tolist(), "error": errors.tolist()}
        measured.append({"problem": name, **sizes, "slope": finite(seen.value), "needed": needed})
        lines.append(f"{name}: {seen.text}, {needed:g} needed")
        if seen.verdict is not Verdict.HOLDS:
            lines += [words(each), f"errors {_row(errors)} for h = {_row(h)}"]
    if not slopes:
        raise Unasked(taken[-1].why)
    found = {s.verdict for s in slopes}
    verdict = next((v for v in (Verdict.VIOLATED, Verdict.INCONCLUSIVE) if v in found), Verdict.HOLDS)
    worst = min((s.value for s in slopes if s.verdict is verdict), default=np.nan)
    checks = sum(len(each.found) * (1 + 2 * each.problem.dimension) for each in taken)
    return law.finding(
        verdict, defect=finite(worst), bound=needed, at_least=True, checks=checks, message="\n".join(lines),
        witness={"measured": measured},
    )  # fmt: skip


def _row(values: Array) -> str:
    return ", ".join(f"{v:.3g}" for v in values)


def of_positions(law: Law, scheme: Scheme, taken: list[Balance]) -> Finding:  # noqa: ARG001 - as of order
    """Compare the covariances of q: defect and bound are in eps,
    for entries in standard deviations.
    """
    asked = list[tuple[Measurement, float]]()
    for problem, wanted, steps in ((each.problem, each.wanted, each.found) for each in taken):
        q = positions(problem)
        if q is None:
            continue
        sizes = wanted.sizes[q]
        for found in steps:
            S, exact = found.covariance[np.ix_(q, q)], wanted.covariance[np.ix_(q, q)]
            off = float(np.max(np.abs(S - exact) / np.outer(sizes, sizes)))
            variances = f"⟨δq²⟩ = {np.diag(S).tolist()}, exact {np.diag(exact).tolist()}"
            text = f"{problem.name}, h = {found.time:.3g}: {variances}"
            asked.append((Measurement(off / EPS, found.rounding / EPS, text), found.time))
    if not asked:
        raise Unasked(
            next((each.why for each in taken if each.why), "no problem with friction is mechanical")
        )
    worst, h = max(asked, key=lambda each: each[0].ratio)
    sizes = {"defect": worst.defect, "bound": worst.bound, "checks": len(asked)}
    if not worst.violates:
        return law.finding(Verdict.HOLDS, **sizes)
    return law.finding(
        Verdict.VIOLATED, **sizes, message=worst.detail, witness={"measured": worst.detail, "h": h}
    )


def positions(problem: Problem) -> np.ndarray | None:
    """The numbers of the positions among the components of y;
    None if the problem is not mechanical.
    """
    try:
        return np.asarray(mechanics(problem).split(np.arange(1.0 * problem.dimension))[0], dtype=np.intp)
    except UsageError:
        return None


law = Law(
    name="equilibrium",
    statement="with friction and quadratic V, the stationary mean and covariance are exact up to O(h^q)",
    source="Talay (1990)",
    unit="slope",
    cost=0.2,
    middle="a step with a state is no map of y alone",
    run=partial(run, order, EQUILIBRIUM_SIZES[1:]),
    replay=replay,
)

for_positions = Law(
    name="equilibrium:positions",
    statement="with friction and quadratic V, the stationary covariance of q is exact for every stable step",
    source="AMRX 2013",
    unit="ulp of 1",
    cost=0.1,
    middle="a step with a state is no map of y alone",
    run=partial(run, of_positions, SIZES_OF_POSITIONS),
    replay=replay,
)
laws = (law, for_positions)


def test_equilibrium(scheme: Scheme, effort: Effort) -> None:
    require(law, scheme, effort)


def test_equilibrium_of_positions(scheme: Scheme, effort: Effort) -> None:
    require(for_positions, scheme, effort)
