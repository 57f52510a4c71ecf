"""Profiles: the properties that a scheme was found to have, claimed or not.

A profile is a named set of laws. It is found if each of its laws was measured and holds. It is not
found if one of its laws is not applicable, inconclusive or expected to fail.

A profile such as "order" states a measured order. Each of its laws measures the slope of the errors
in log-log scale on some problems. For each problem the law finds the largest order whose bound lies
below the slope, or below the lower end of the slope's confidence interval if paths are sampled. The
profile has the least of these orders over problems and laws. For mean-square order p the laws are
Milstein's conditions on one step, (3.8) and (3.9) of the paper, and the rms error of paths. This
error must have been measured; the conditions are ignored if one step has no reference solution.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from fractions import Fraction

from sepv._arguments import did_you_mean
from sepv.errors import UsageError, require_one_of
from sepv.law import Finding, Verdict

# The version of the suite, raised for each law that is added or becomes stricter, with a note in
# docs/profiles.md.
SUITE = 1


@dataclass(frozen=True)
class Profile:
    """A profile, a named set of laws: its name after ``--require``, its words on a badge,
    and its laws.

    Attributes
    ----------
    ordered : bool
        True if the profile states an order. Its first law must have measured an order; its other
        laws need not apply.
    """

    name: str
    words: str
    laws: tuple[str, ...]
    ordered: bool = False


METHOD = Profile("method", "method", ("contract", "reproducibility", "right-limit"))
PROFILES = (
    METHOD,
    Profile("order", "order", ("mean-square-order", "local-mean", "local-mean-square"), ordered=True),
    Profile("weak-order", "weak order", ("weak-order", "local-weak"), ordered=True),
    Profile("deterministic-order", "deterministic order", ("deterministic-order",), ordered=True),
    Profile("energy", "energy", ("energy",)),
    Profile("casimir", "Casimirs", ("casimir",)),
    Profile("every-casimir", "every Casimir", ("invariant:casimir",)),
    Profile("symplectic", "symplectic", ("poisson-map:constant",)),
    Profile("poisson", "Poisson", ("poisson-map",)),
    Profile("symmetric", "symmetric", ("symmetry",)),
    Profile("2.1", "(2.1)", ("reference", "expansion", "midpoint", "reduction")),
)
PROFILE_NAMES = tuple(p.name for p in PROFILES)
# A requested order above this is taken for a typing error.
_ORDER_MAX = 100


@dataclass(frozen=True)
class Requirement:
    """A profile that a scheme must be found to have, and the least order wanted if the profile
    states an order.
    """

    profile: Profile
    order: float = 0.0

    @property
    def name(self) -> str:
        """The name after ``--require``, such as energy or order-1."""
        return f"{self.profile.name}-{self.order:g}" if self.profile.ordered else self.profile.name


@dataclass(frozen=True)
class Profiled:
    """The result of the laws of one profile.

    Attributes
    ----------
    order : float or None
        The measured order, for a profile that states one; None if the errors show no order for
        certain.
    why : str
        The reason why the profile is not found; empty if it is.
    """

    profile: Profile
    order: float | None
    why: str

    @property
    def name(self) -> str:
        """The name of the profile after ``--require``."""
        return Requirement(self.profile, self.order or 0.0).name

    @property
    def words(self) -> str:
        """The words for the profile on a badge."""
        return f"{self.profile.words} {self.order:g}" if self.profile.ordered else self.profile.words


def requirements(profiles: str | Iterable[str]) -> tuple[Requirement, ...]:
    """Read requirements from a list, or from one string with commas: "energy,order-1".

    Raises
    ------
    UsageError
        For an unknown profile, for no profile at all, or for an order that is no positive number.
    """
    given = profiles.split(",") if isinstance(profiles, str) else list(profiles)
    names = [str(name).strip().lower().replace("_", "-") for name in given]
    required = tuple(_requirement(name) for name in names if name)
    if not required:
        raise UsageError(
            expected=f"a profile to require, of {', '.join(PROFILE_NAMES)}",
            received=repr(profiles),
            remedy='require="energy,order-1", or leave it out',
        )
    return required


def _requirement(name: str) -> Requirement:
    for profile in PROFILES:
        number = name.removeprefix(f"{profile.name}-")
        if profile.ordered and (number != name or name == profile.name):
            try:
                order = Fraction(number)
            except (ValueError, ZeroDivisionError):
                order = Fraction(0)
            if not 0 < order <= _ORDER_MAX:
                raise UsageError(
                    expected=f"an order after {profile.name}-, a positive number",
                    received=f"{name!r:.60}",
                    remedy=f"{profile.name}-1, or {profile.name}-0.5",
                )
            return Requirement(profile, float(order))
    require_one_of(
        "a profile", name, PROFILE_NAMES, "order-1 asks for an order", did_you_mean(name, PROFILE_NAMES)
    )
    return Requirement(next(p for p in PROFILES if p.name == name))


def laws_for(required: Iterable[Requirement]) -> set[str]:
    """The names of the laws of these profiles, and of the profile "method"."""
    return {law for profile in (METHOD, *(r.profile for r in required)) for law in profile.laws}


def profiled(findings: Iterable[Finding]) -> tuple[Profiled, ...]:
    """The results, found or not, of the profiles whose laws were all measured."""
    by_law = {f.law: f for f in findings if f.verdict is not Verdict.NOT_MEASURED}
    whole = [(p, [by_law[law] for law in p.laws]) for p in PROFILES if all(law in by_law for law in p.laws)]
    return tuple(_profiled(profile, about) for profile, about in whole)


def _profiled(profile: Profile, findings: list[Finding]) -> Profiled:
    if not profile.ordered:
        lacking = [f"{f.law} {f.verdict.text}" for f in findings if f.verdict is not Verdict.HOLDS]
        return Profiled(profile, None, ", ".join(lacking))
    shown = {
        f.law: _order_shown(f)
        for f in findings
        if f is findings[0] or f.verdict is not Verdict.NOT_APPLICABLE
    }
    least = min(shown.values())
    lacking = [law for law, order in shown.items() if order <= 0]
    return Profiled(profile, least or None, f"{', '.join(lacking)}: no order is sure" if lacking else "")


def _order_shown(finding: Finding) -> float:
    """The least of the orders that a law measured on its problems;
    0 if it found no order on one of them.
    """
    measured = (finding.witness or {}).get("measured", ())
    return min((entry.get("order") or 0.0 for entry in measured), default=0.0)


def found(profiles: Iterable[Profiled]) -> list[str]:
    """The profiles that were found, in words.

    If a mean-square order was found, the deterministic order is left out, and a weak order is named
    only if larger.
    """
    have = {p.profile.name: p for p in profiles if not p.why}
    if "order" in have:
        have.pop("deterministic-order", None)
    if "order" in have and "weak-order" in have and have["order"].order >= have["weak-order"].order:  # type: ignore[operator]
        del have["weak-order"]
    return [p.words for p in have.values()]


def missing(profiles: Iterable[Profiled], required: Iterable[Requirement]) -> list[str]:
    """The required profiles that were not found, each with the reason."""
    have = {p.profile.name: p for p in profiles}
    lacking = []
    for law in required:
        got = have.get(law.profile.name)
        if got is None or got.why:
            lacking.append(f"{law.name} ({got.why if got else 'not measured'})")
        elif (got.order or 0.0) < law.order:
            lacking.append(f"{law.name} ({got.words} was measured)")
    return lacking
