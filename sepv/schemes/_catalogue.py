"""The schemes by name. A new scheme is a file beside this one, and its line here."""

from __future__ import annotations

from collections.abc import Callable

from sepv._arguments import did_you_mean
from sepv.errors import UsageError
from sepv.schemes._area_midpoint import scheme as area_midpoint
from sepv.schemes._both_invariants import scheme as both_invariants
from sepv.schemes._collocation import collocation
from sepv.schemes._darboux_lie import scheme as darboux_lie
from sepv.schemes._discrete_gradient import scheme as discrete_gradient
from sepv.schemes._drift_preserving import scheme as drift_preserving
from sepv.schemes._energy_preserving import scheme as energy_preserving
from sepv.schemes._euler_heun import scheme as euler_heun
from sepv.schemes._euler_maruyama import scheme as euler_maruyama
from sepv.schemes._explicit import explicit
from sepv.schemes._gauss import gauss
from sepv.schemes._gonzalez import scheme as gonzalez
from sepv.schemes._isospectral_midpoint import scheme as isospectral_midpoint
from sepv.schemes._itoh_abe import scheme as itoh_abe
from sepv.schemes._midpoint import scheme as midpoint
from sepv.schemes._milstein import scheme as milstein
from sepv.schemes._modified_weak_two import scheme as modified_weak_two
from sepv.schemes._projected import projected
from sepv.schemes._scheme import Scheme
from sepv.schemes._several_structures import scheme as several_structures
from sepv.schemes._splitting import scheme as splitting
from sepv.schemes._stochastic_midpoint import scheme as stochastic_midpoint
from sepv.schemes._stochastic_splitting import scheme as stochastic_splitting
from sepv.schemes._tableaux import MAX_STAGES

PAPER: dict[str, Scheme] = {
    s.name: s for s in (energy_preserving, midpoint, discrete_gradient, euler_heun, milstein, euler_maruyama)
}
# What the paper does not have.
EXTENSIONS: dict[str, Scheme] = {
    s.name: s
    for s in (
        both_invariants,
        several_structures,
        gonzalez,
        itoh_abe,
        modified_weak_two,
        splitting,
        explicit(4),
        explicit(8),
        projected(4),
        projected(8),
    )
}
# For several Hamiltonians that need not commute.
HAMILTONIANS: dict[str, Scheme] = {
    s.name: s
    for s in (
        stochastic_midpoint,
        area_midpoint,
        stochastic_splitting,
        isospectral_midpoint,
        darboux_lie,
        drift_preserving,
    )
}
# Families: NAME-s is their member with s stages, s = 1 … MAX_STAGES.
FAMILIES: dict[str, Callable[[int], Scheme]] = {"collocation": collocation, "gauss": gauss}


def by_name(name: str) -> Scheme:
    """A built-in scheme, or a member of a family such as "collocation-3"; "_" and "-" are the same.

    Raises
    ------
    UsageError
    """
    wanted = name.replace("_", "-")
    for schemes in (PAPER, EXTENSIONS, HAMILTONIANS):
        if wanted in schemes:
            return schemes[wanted]
    family, _, stages = wanted.rpartition("-")
    if family in FAMILIES and stages.isdecimal() and 1 <= int(stages) <= MAX_STAGES:
        return FAMILIES[family](int(stages))
    families = ", ".join(f"{f}-1 … {f}-{MAX_STAGES}" for f in FAMILIES)
    raise UsageError(
        expected=f"a built-in scheme: {', '.join([*PAPER, *EXTENSIONS, *HAMILTONIANS])}, {families}",
        received=did_you_mean(name, [*PAPER, *EXTENSIONS, *HAMILTONIANS]),
        remedy="see `sepv list`",
    )
