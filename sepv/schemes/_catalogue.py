"""The schemes by name. To add one, write a file `_name.py` in this folder that defines `scheme`,
and list it below.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module

from sepv._arguments import did_you_mean
from sepv.errors import unknown_name
from sepv.schemes._collocation import collocation
from sepv.schemes._explicit import explicit
from sepv.schemes._gauss import gauss
from sepv.schemes._langevin import obabo
from sepv.schemes._leapfrog import blanes_moan, yoshida
from sepv.schemes._projected import projected
from sepv.schemes._scheme import Scheme
from sepv.schemes._tableaux import MAX_STAGES

# Schemes by the names of their Python files.
BY_FILE: dict[str, Scheme] = {}


def _listed(*files: str) -> dict[str, Scheme]:
    by_file = {file: import_module(f"sepv.schemes._{file}").scheme for file in files}
    BY_FILE.update(by_file)
    return {scheme.name: scheme for scheme in by_file.values()}


PAPER = _listed(
    "energy_preserving",
    "midpoint",
    "discrete_gradient",
    "euler_heun",
    "milstein",
    "euler_maruyama",
)
# Schemes beyond the paper.
EXTENSIONS = _listed(
    "both_invariants",
    "several_structures",
    "gonzalez",
    "itoh_abe",
    "leapfrog",
    "modified_weak_two",
    "splitting",
) | {
    scheme.name: scheme
    for scheme in (yoshida, blanes_moan, explicit(4), explicit(8), projected(4), projected(8))
}
# Schemes for several Hamiltonians that need not commute.
HAMILTONIANS = _listed(
    "stochastic_midpoint",
    "area_midpoint",
    "stochastic_splitting",
    "isospectral_midpoint",
    "darboux_lie",
    "drift_preserving",
)
# Schemes for damped systems and for friction.
DAMPED = _listed("conformal", "langevin", "gronbech_jensen_farago", "friction_euler_maruyama") | {
    obabo.name: obabo
}
# Families of schemes: the name NAME-s is the member with s stages, s = 1 … MAX_STAGES.
FAMILIES: dict[str, Callable[[int], Scheme]] = {"collocation": collocation, "gauss": gauss}


def built_in(name: object) -> Scheme | None:
    """The built-in scheme or member of a family such as "collocation-3" with this name;
    "_" counts as "-".
    """
    wanted = str(name).replace("_", "-")
    family, _, stages = wanted.rpartition("-")
    if family in FAMILIES and stages.isdecimal() and 1 <= int(stages) <= MAX_STAGES:
        return FAMILIES[family](int(stages))
    return (PAPER | EXTENSIONS | HAMILTONIANS | DAMPED).get(wanted)


def by_name(name: str) -> Scheme:
    """The built-in scheme with this name. Raises UsageError for any other name."""
    if scheme := built_in(name):
        return scheme
    known = [*PAPER, *EXTENSIONS, *HAMILTONIANS, *DAMPED]
    families = [f"{f}-1 … {f}-{MAX_STAGES}" for f in FAMILIES]
    raise unknown_name("a built-in scheme", did_you_mean(name, known), [*known, *families], "see `sepv list`")
