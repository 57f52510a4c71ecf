"""The names of the laws that a scheme can claim. Each law is a file of `sepv.properties`."""

from __future__ import annotations

from collections.abc import Iterable

from sepv._arguments import did_you_mean
from sepv.errors import require_one_of

# The laws in the order of a report; a law comes after its prerequisites.
LAWS = (
    "contract",
    "reproducibility",
    "identity",
    "energy",
    "energy-drift",
    "casimir",
    "casimir-drift",
    "any-casimir",
    "invariant",
    "conformal-casimir",
    "conformal-energy",
    "poisson-map",
    "symplecticity",
    "volume",
    "positivity",
    "midpoint",
    "reduction",
    "noise-sum",
    "random-step",
    "expansion",
    "symmetry",
    "reversibility",
    "equivariance",
    "reference",
    "refusal",
    "rounding",
    "truncation",
    "deterministic-order",
    "long-time-energy",
    "local-mean",
    "local-mean-square",
    "local-weak",
    "mean-square-order",
    "weak-order",
    "right-limit",
    "commutation",
)

# Laws about a scheme and its twin, a second program: they are measured only if one is given (`Scheme.twin`).
OF_TWINS = ("agreement",)
ALL_LAWS = (*LAWS, *OF_TWINS)

# Laws about paths, which do not apply to increments that match only some moments of the normal distribution.
PATHWISE = frozenset(("mean-square-order", "right-limit", "local-mean", "local-mean-square", "commutation"))


def require_laws(names: Iterable[str]) -> None:
    """Raise a UsageError for a name that is not a law; the message has the closest law."""
    for name in names:
        require_one_of("a law", name, ALL_LAWS, "see `sepv list`", did_you_mean(name, ALL_LAWS))
