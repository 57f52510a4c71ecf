"""From which size on does each law find a wrong noise or drift?
``python -m benchmarks.thresholds``.

The scheme is (2.1) with the random step h(1 + d) + (1 + n) Σ c_jΔW_j, with the error n of the noise
and d of the drift. Neither error changes an invariant. Each law runs at the default budget, with n
or d falling by factors of ten, until it no longer says `violated`. The table has the smallest error
that a law finds, and its verdict on the next smaller one.
"""

from __future__ import annotations

from benchmarks import arguments, over, start
from sepv.faults.saboteurs.record import claiming
from sepv.law import Effort, Verdict
from sepv.problem import Array, Problem
from sepv.schemes import Scheme, implicit
from sepv.schemes import energy_preserving_formula as formula
from sepv.verification import LAWS, verify

# The smallest power of ten: an error below an ulp of Δ has no effect.
ERROR_MIN_POWER = -16


def wrong(noise: float, drift: float) -> Scheme:
    """Scheme (2.1) with a noise and a drift that are too large by these relative errors."""

    def parts(problem: Problem, h: float, dW: Array) -> Array:
        return (h * (1 + drift) + (1 + noise) * problem.random_step(0.0, dW))[None]

    return claiming(implicit(formula, parts=parts), name="wrong noise or drift")


def verdict(law: str, of: str, size: float) -> Verdict:
    """The verdict of a law on an error of this size in the noise or in the drift."""
    scheme = wrong(size, 0.0) if of == "noise" else wrong(0.0, size)
    return verify(scheme, laws=[law], effort=Effort(shrink_checks=0)).findings[0].verdict


def smallest(law: str, of: str) -> tuple[int | None, Verdict]:
    """The exponent of the least power of ten that a law finds, or None,
    and its verdict on the next smaller power.
    """
    named = None
    for power in range(-1, ERROR_MIN_POWER - 1, -1):
        found = verdict(law, of, 10.0**power)
        if found is not Verdict.VIOLATED:
            return named, found
        named = power
    return named, Verdict.VIOLATED


def main() -> None:
    """Print the table as Markdown."""
    options = arguments(__doc__, law={"action": "append", "choices": LAWS})
    print(
        "| law | noise too large by | below that | drift too large by | below that |\n|---|---|---|---|---|"
    )
    for law in over(options.law or LAWS):
        cells = []
        for of in ("noise", "drift"):
            named, below = smallest(law, of)
            cells += ["–" if named is None else f"1e{named}", below.text]
        print(f"| {law} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    start(main)
