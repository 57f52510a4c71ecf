"""The names of the laws that a scheme can claim. Each law is a file of `sepv.properties`.

A law may have parts, which are claimed and measured apart: LAW:PART, such as
*poisson-map:constant*. A part says of some systems, or of some functions, what the law says of
others. Both have one measurement, one bound and one page.
"""

from __future__ import annotations

import multiprocessing
import warnings
from collections.abc import Iterable
from functools import cache

from sepv._arguments import did_you_mean
from sepv.errors import require_one_of

# The laws in the order of a report; a law comes after its prerequisites.
LAWS = (
    "contract",
    "reproducibility",
    "identity",
    "energy",
    "casimir",
    "invariant",
    "invariant:energy",
    "invariant:casimir",
    "equilibrium",
    "equilibrium:positions",
    "poisson-map",
    "poisson-map:constant",
    "poisson-map:conformal",
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
)

# Laws about a scheme and its twin, a second program: they are measured only if one is given
# (`Scheme.twin`).
OF_TWINS = ("agreement",)
ALL_LAWS = (*LAWS, *OF_TWINS)

# Laws about paths, which do not apply to increments that match only some moments of the normal
# distribution.
# The laws about one step from one state.
LOCAL_LAWS = ("local-mean", "local-mean-square", "local-weak")
PATHWISE = frozenset(("mean-square-order", "right-limit", "local-mean", "local-mean-square"))


# Names of former versions, and the laws that say now what they said. They work for one version
# more.
FORMER_LAWS = {
    "symplecticity": "poisson-map:constant",
    "any-casimir": "invariant:casimir",
    "casimir-drift": "invariant:casimir",
    "conformal-casimir": "invariant:casimir",
    "energy-drift": "invariant:energy",
    "conformal-energy": "invariant:energy",
    "conformal-symplecticity": "poisson-map:conformal",
    "configurational-equilibrium": "equilibrium:positions",
    "commutation": "mean-square-order",
}


def law_named(name: str) -> str:
    """The name of a law as it is in `ALL_LAWS`. A former name, or one with underscores,
    is replaced.

    The first time that a process meets a former name, it warns. A name that is no law is returned
    as it is.
    """
    plain = name.strip().replace("_", "-")
    if plain in FORMER_LAWS:
        note_former(plain)
    return FORMER_LAWS.get(plain, plain)


@cache
def note_former(name: str) -> None:
    """Warn, once in a process, that a law has another name;
    worker processes leave this to their parent.
    """
    if multiprocessing.parent_process() is None:
        warnings.warn(
            f"the law {name} is now {FORMER_LAWS[name]}: the old name ends with the next version",
            FutureWarning,
            stacklevel=2,
        )


def page_of(law: str) -> str:
    """The name of a law without its part: that of its page and of its file in `sepv.properties`."""
    return law.partition(":")[0]


def require_laws(names: Iterable[str]) -> None:
    """Raise a UsageError for a name that is not a law; the message has the closest law."""
    for name in names:
        if (
            name not in ALL_LAWS
        ):  # only then is the closest law searched for: 30 ms for the claims of a scheme
            require_one_of("a law", name, ALL_LAWS, "see `sepv list`", did_you_mean(name, ALL_LAWS))
