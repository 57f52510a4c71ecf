"""Conformance: the level that a scheme reaches, and the version of the suite whose laws say so.

1. It is a one-step method for this equation: its contract holds, the same input gives the same bits in any batch, and
   it converges to the Stratonovich solution (these three are needed, claimed or not); *identity* holds where it is
   claimed, as a method that treats drift and noise apart may move where Δ = 0.
2. And it has the orders that it claims: it claims a law of level 2, and those that it claims hold.
3. And it keeps what it claims to keep, to the digits that it claims: likewise with level 3.

A law that says nothing about a class of schemes (`not applicable`, with no case skipped) hinders no level and makes
none. A waiver, which is an expected failure with its reason (`sepv.verification._expected_failures`), hinders none
either; it is counted and shown. Each law's level is on its record (`Law.level`, `Law.needed`).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from sepv.verification._law import Finding, Law, Verdict

# The version of the suite: one more for each law that is added or asks for more, with a note in docs/levels.md.
SUITE = 1
LEVELS = (1, 2, 3)


@dataclass(frozen=True)
class Conformance:
    """The level of a scheme.

    Attributes
    ----------
    level : int
        The highest that is reached; 0 for none.
    laws : dict of int to tuple of str
        The laws that made each level, up to `level`.
    waived : tuple of str
        Laws of these levels that fail as expected.
    why : str
        Why the next level is not reached; empty at the highest, or where its laws were not all measured.
    suite : int
        The version of the suite.
    """

    level: int
    laws: dict[int, tuple[str, ...]]
    waived: tuple[str, ...]
    why: str
    suite: int = SUITE

    def __str__(self) -> str:
        """One sentence for a reader."""
        waivers = f" with {len(self.waived)} waived ({', '.join(self.waived)})" if self.waived else ""
        reached = f"Level {self.level} of suite version {self.suite}{waivers}"
        return f"{reached}; not {self.level + 1}: {self.why}." if self.why else f"{reached}."


def conformance(findings: Iterable[Finding], laws: Sequence[Law]) -> Conformance | None:
    """The level that findings show.

    Parameters
    ----------
    laws : sequence of Law
        The whole suite.

    Returns
    -------
    Conformance or None
        None where not every law of level 1 was measured: a run of a few laws says nothing of levels.
    """
    found = {f.law: f for f in findings if f.verdict is not Verdict.NOT_MEASURED}
    reached, made, waived, why = 0, {}, [], ""
    for level in LEVELS:
        own = [law for law in laws if law.level == level]
        if any(law.name not in found for law in own):
            break
        asked = [found[law.name] for law in own if law.needed or found[law.name].claimed]
        why = _missing(level, asked)
        if why:
            break
        reached = level
        made[level] = tuple(f.law for f in asked if f.verdict is Verdict.HOLDS)
        waived += [f.law for f in asked if _waived(f)]
    if not reached and not why:
        return None
    return Conformance(reached, made, tuple(waived), why)


def _missing(level: int, asked: list[Finding]) -> str:
    """What a level lacks; empty where it is reached."""
    wrong = [f for f in asked if not (f.verdict is Verdict.HOLDS or _silent(f) or _waived(f))]
    if wrong:
        return ", ".join(f"{f.law} {f.verdict.text}" for f in wrong)
    if all(_silent(f) for f in asked):
        return {1: "no law speaks of it", 2: "it claims no order", 3: "it claims to keep nothing"}[level]
    return ""


def _silent(finding: Finding) -> bool:
    return finding.verdict is Verdict.NOT_APPLICABLE and not finding.skipped


def _waived(finding: Finding) -> bool:
    """Fails as expected."""
    return finding.expected is not None and finding.verdict is Verdict.VIOLATED
