"""Without noise, a symplectic or reversible method of order p has |H(y_n) − H(y_0)| = O(h^p)
without growth in n.

If H is analytic, the states stay in a compact set and h is small, a symplectic method keeps a
modified Hamiltonian for times of the order exp(c/h); a symmetric reversible method on an integrable
reversible system with diophantine frequencies keeps H to O(h^p) for times of the order h^(−p) (E.
Hairer, C. Lubich and G. Wanner, *Geometric Numerical Integration*, IX.8 and XI.3). The law tests it
on orbits to which this theory applies (`sepv.properties._orders.integrable`).
`sepv.properties._orders.long_times` judges two statements. First, there is no trend: the mean
energy over a window of time moves by no more than the oscillation that such a mean may still
contain. Second, the oscillation falls like h^p.

Claims of *poisson-map:constant* and of an order do not imply this law. A scheme without claims is
measured too.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from sepv.properties._orders.integrable import Orbits, orbits_of_class, users_orbits
from sepv.properties._orders.long_times import JudgedEnergy, power, trend
from sepv.properties._sampled import DEEP_EXAMPLES, DEEPER, sparing

from sepv.errors import Skipped
from sepv.law import Case, Effort, Finding, Law, Run, Verdict, require
from sepv.law.cases.case import quiet_problem
from sepv.law.cases.from_problem import describe
from sepv.law.cases.users_problems import items
from sepv.problem import Systems, one_field
from sepv.schemes import Scheme, takes

# The number of paths on an orbit, for a confidence interval of the growth. A scheme without batches
# gets fewer.
PATHS_ON_ORBIT, SPARED_PATHS_ON_ORBIT = 8, 4
# The largest number of halvings of the step size for a scheme that states a longest step.
HALVINGS_MAX = 3
_ENERGY_RANKS = (Verdict.VIOLATED, Verdict.ERROR, Verdict.INCONCLUSIVE, Verdict.HOLDS)


def run(law: Law, scheme: Scheme, own: Run) -> Finding:
    """Judge the trend and the power of h on all orbits. Report the worst: first by verdict,
    then by `JudgedEnergy.share`.
    """
    if scheme.asks or (scheme.systems.several_fields and scheme.systems is not Systems.MATRIX_HAMILTONIANS):
        why = "the scheme is for several fields, which c = () leaves alone"
        return law.finding(Verdict.NOT_APPLICABLE, message=why)
    effort, found, lines, skipped = own.effort, list[tuple[JudgedEnergy, Orbits]](), list[str](), list[str]()
    for asked in _orbits(scheme, effort.seed):
        try:
            orbits = _taken(scheme, asked) if isinstance(asked, Orbits) else users_orbits(asked)
            judged = _judged(scheme, orbits, effort)
        except Skipped as reason:
            skipped.append(f"{asked.name}: {reason.reason}")
            continue
        found += [(each, orbits) for each in judged]
        lines.append(f"{orbits.name}: " + "; ".join(each.text for each in judged))
    if not found:
        why = (
            "\n".join(skipped)
            or "the class has no mechanical systems or rigid bodies, of which theory speaks"
        )
        return law.finding(Verdict.NOT_APPLICABLE, message=why)
    worst, orbits = min(found, key=lambda each: (_ENERGY_RANKS.index(each[0].verdict), -each[0].share))
    if worst.verdict is not Verdict.HOLDS:
        y = tuple(orbits.of(1)[:, 0].tolist())
        lines.append(Case(describe(orbits.problem), y, orbits.h).describe())
    return law.finding(
        worst.verdict, defect=worst.share, bound=1.0, checks=sum(each.steps for each, _ in found),
        message="\n".join(lines + skipped), witness={"seed": effort.seed, "examples": effort.examples},
        replay=f"--law {law.name} --seed {effort.seed}",
    )  # fmt: skip


def _orbits(scheme: Scheme, seed: int) -> Iterator[Any]:
    """Yield orbits for the scheme's class or families of problems, or the user's own problems,
    without their noise.
    """
    if not scheme.problems:
        yield from orbits_of_class(scheme.systems, seed)
    for item in items(scheme.problems) if scheme.problems else ():
        if item.space is not None:
            yield from orbits_of_class(Systems(item.text.replace("_", "-")), seed)
            continue
        for problem in item.problems:
            if one_field(problem):
                yield quiet_problem(problem)


def _taken(scheme: Scheme, orbits: Orbits) -> Orbits:
    """Halve the step size of the orbits, at most HALVINGS_MAX times, until the scheme takes it.
    Else raise Skipped.
    """
    y = orbits.of(1)[:, 0]
    for halved in range(HALVINGS_MAX + 1):
        shorter = replace(orbits, steps=orbits.steps << halved)
        if takes(scheme, orbits.problem, y, shorter.h, y[:0]):
            return shorter
    raise Skipped("the scheme takes shorter steps alone (longest_step)")


def _judged(scheme: Scheme, orbits: Orbits, effort: Effort) -> list[JudgedEnergy]:
    """Judge the trend of the energy on the orbits and, if H oscillates and has no trend,
    the power of h.
    """
    paths = SPARED_PATHS_ON_ORBIT if sparing(scheme, effort) else PATHS_ON_ORBIT
    first = trend(scheme, orbits, paths, DEEPER if effort.examples >= DEEP_EXAMPLES else 1)
    if first.verdict in (Verdict.VIOLATED, Verdict.ERROR) or first.kept:
        return [first]
    return [first, power(scheme, orbits, (scheme.order or 1.0) - 0.5, first)]


def replay(law: Law, scheme: Scheme, witness: dict[str, Any]) -> Finding:
    """Repeat the run of a witness (a stored counterexample), with its seed and number of
    examples.
    """
    return run(law, scheme, Run(Effort(seed=int(witness["seed"]), examples=int(witness.get("examples", 8)))))


law = Law(
    name="long-time-energy",
    statement="without noise energy errors stay O(h^p) over many periods for the claimed order p (default: 1)",
    source="GNI IX.8, XI.3",
    unit="share",
    cost=1.0,
    steps=1664,
    spared=832,
    run=run,
    replay=replay,
)


def test_long_time_energy(scheme: Scheme, effort: Effort) -> None:
    require(law, scheme, effort)
