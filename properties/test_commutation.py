"""Several structures (§1): mean-square order 1 where the fields of the noises commute, ½ where they do not.

A scheme that sees increments only cannot be better: the iterated integrals ∫W_i∘dW_j that it does not see are of the
order of h, and are multiplied by the commutators of the fields G_j∇H. The law finds both orders. Where the
flows commute the exact solution is known in closed form; where they do not, another method with finer steps serves,
Heun's, whose own error is shown.
"""

from __future__ import annotations

from typing import Any

from sepv.convergence import slope
from sepv.law import Effort, Finding, Law, Verdict, require
from sepv.scheme import Scheme
from sepv.sequential import FALSE_ALARM, Setup, looks, sampled

STEPS = (16, 32, 64, 128)
# (problem, lower end, upper end) of the slope: half-way to the neighbouring multiples of ½.
EXPECTED = (
    (Setup("commuting-rotations", 1.0, STEPS), 0.75, 1.25),
    (Setup("commuting-oscillators", 1.0, STEPS), 0.75, 1.25),
    (Setup("noncommuting-tops", 1.0, STEPS), 0.25, 0.75),
)


def run(law: Law, scheme: Scheme, effort: Effort) -> Finding:
    """The slopes on two commuting families and on one that does not commute."""
    if scheme.systems != "several":
        return law.finding(Verdict.NOT_APPLICABLE, message="the scheme is for a single structure")
    alpha = FALSE_ALARM / (len(EXPECTED) * len(looks(effort)))
    verdicts, lines, worst, used = [], [], (0.0, 0.0), 0
    for setup, low, high in EXPECTED:
        verdict = Verdict.INCONCLUSIVE
        for paths in looks(effort):
            errors = sampled(scheme, setup, paths, effort)
            if any(errors.failures):
                return law.finding(
                    Verdict.ERROR, checks=paths, message=f"{setup.problem}: failures {errors.failures}"
                )
            found = slope(errors, alpha)
            if low < found.low and found.high < high:
                verdict = Verdict.HOLDS
            elif found.high < low or found.low > high:
                verdict = Verdict.VIOLATED
            if verdict is not Verdict.INCONCLUSIVE:
                break
        used += paths
        verdicts.append(verdict)
        middle = (low + high) / 2
        reference = f", reference wrong by {errors.reference:.1e}" if errors.reference else ""
        lines.append(
            f"{setup.problem}: order {middle:g} expected, {found.value:.3f} in [{found.low:.2f}, {found.high:.2f}] "
            f"from {paths} paths, rms error {errors.rms()[-1]:.1e} at the finest step{reference}"
        )
        worst = max(worst, (abs(found.value - middle), (high - low) / 2))
    verdict = next((v for v in (Verdict.VIOLATED, Verdict.INCONCLUSIVE) if v in verdicts), Verdict.HOLDS)
    return law.finding(
        verdict,
        defect=worst[0],
        bound=worst[1],
        checks=used,
        message="\n".join(lines),
        witness={"seed": effort.seed, "paths": effort.paths},
        replay=f"--law {law.name} --seed {effort.seed} --paths {effort.paths}",
    )


def replay(law: Law, scheme: Scheme, witness: dict[str, Any]) -> Finding:
    """The same paths again."""
    return run(law, scheme, Effort(seed=int(witness["seed"]), paths=int(witness["paths"])))


law = Law(
    name="commutation",
    statement="several structures: mean-square order 1 where the noises commute, ½ where they do not",
    source="§1",
    unit="off slope",
    run=run,
    replay=replay,
)


def test_commutation(scheme: Scheme, effort: Effort) -> None:
    require(law, scheme, effort)
