"""The laws by name, in the order of the suite: each is a file of `sepv.properties`."""

from __future__ import annotations

from collections.abc import Iterable
from importlib import import_module

from sepv._arguments import did_you_mean
from sepv.errors import UsageError, require_one_of
from sepv.verification._law import Law
from sepv.verification._levels import LEVELS

# In the order in which a reader wants them: what nothing else makes sense without comes first.
LAWS = (
    "contract",
    "reproducibility",
    "identity",
    "energy",
    "energy-drift",
    "casimir",
    "any-casimir",
    "poisson-map",
    "symplecticity",
    "positivity",
    "midpoint",
    "reduction",
    "noise-sum",
    "random-step",
    "expansion",
    "symmetry",
    "equivariance",
    "reference",
    "rounding",
    "truncation",
    "local-mean",
    "local-mean-square",
    "local-weak",
    "mean-square-order",
    "weak-order",
    "right-limit",
    "commutation",
)

# Laws that share the paths they draw (`Run.paths`): one process measures them, in this order.
SAMPLED = ("mean-square-order", "weak-order", "right-limit", "commutation")
# Those that share errors of one step.
LOCAL = ("local-mean", "local-mean-square", "local-weak")


def load_laws(names: Iterable[str] | None = None) -> list[Law]:
    """The laws by name, all of them by default, in the suite's order.

    Raises
    ------
    UsageError
        For an unknown name.
    """
    wanted = LAWS if names is None else tuple(str(n).strip().replace("_", "-") for n in listed(names))
    for name in wanted:
        require_one_of("a law", name, LAWS, "see `sepv list`", did_you_mean(name, LAWS))
    ordered = [name for name in LAWS if name in wanted]
    return [import_module(f"sepv.properties.test_{name.replace('-', '_')}").law for name in ordered]


def laws_of(names: Iterable[str] | None = None, level: int | None = None) -> list[Law]:
    """The laws that a run is asked for: by name, or up to a level of conformance, and not both."""
    if level is None:
        return load_laws(names)
    if level not in LEVELS or isinstance(level, bool) or names is not None:
        raise UsageError(
            expected="a level of 1, 2 or 3, without a list of laws",
            received=f"level {level!r}" + ("" if names is None else " and laws"),
            remedy="level 2 takes the laws of levels 1 and 2; leave out one or the other",
        )
    return [law for law in load_laws() if law.level <= level]


def listed(names: str | Iterable[str]) -> Iterable[str]:
    """The names of a list, or of one string with commas between them."""
    return names.split(",") if isinstance(names, str) else names
