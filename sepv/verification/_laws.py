"""The laws of a run, and their order in it."""

from __future__ import annotations

from collections.abc import Iterable

from sepv.errors import UsageError
from sepv.law import Law
from sepv.properties import listed, load_laws
from sepv.schemes import LAWS, LOCAL_LAWS, OF_TWINS
from sepv.verification._profiles import Requirement, laws_for

# Laws that share the paths they draw (`Run.paths`): one process measures them, in this order.
SAMPLED_LAWS = ("mean-square-order", "weak-order", "right-limit")
# Laws measured first: they need a second or two, and show most faults. The contract is the very
# first: if every step sets the same global state, such as a seed, this no longer shows after the
# steps of another law.
MEASURED_FIRST = ("contract", "identity", "energy", "casimir")
# Laws that make more than this number of steps of single states are measured last, the most
# expensive law at the end.
MANY_STEPS = 2000


def soonest(laws: Iterable[Law]) -> list[Law]:
    """Sort laws for a run: laws that show most faults first, costly ones last,
    and laws that share paths together.
    """
    asked = list(laws)
    steps = {law.name: law.spared or law.steps for law in asked}
    for family in (SAMPLED_LAWS, LOCAL_LAWS):
        own = [name for name in family if name in steps]
        steps |= dict.fromkeys(own, max(map(steps.__getitem__, own), default=0))
    return sorted(
        asked,
        key=lambda law: (law.name not in MEASURED_FIRST, steps[law.name] * (steps[law.name] > MANY_STEPS)),
    )


def laws_of(
    names: Iterable[str] | None = None, required: tuple[Requirement, ...] = (), *, twin: bool = False
) -> list[Law]:
    """Load the laws of a run, given by `names` or by `required` profiles;
    a UsageError if both are given.

    If the scheme has a `twin`, the laws about twins are measured too.
    """
    if required and names is not None:
        raise UsageError(
            expected="profiles to require, or a list of laws",
            received="both",
            remedy="a profile brings its own laws; leave out one or the other",
        )
    asked = laws_for(required) if required else LAWS if names is None else tuple(listed(names))
    laws: list[Law] = load_laws((*asked, *(OF_TWINS if twin else ())))
    return laws
