"""The schemes, one file each: those of the paper, and families of higher order by their number of stages.

Read `_scheme` first (what a scheme says of itself), `_energy_preserving` (equation (2.1)) and `_one_step` (a
formula becomes a scheme). `_guard` asks a scheme and checks what it answers, `_load` finds it by name,
`_point_laws` has increments with two or three values, `_division` and `_continuation` solve long steps.
"""

from __future__ import annotations

from sepv.schemes._area_midpoint import scheme as area_midpoint
from sepv.schemes._both_invariants import scheme as both_invariants
from sepv.schemes._catalogue import EXTENSIONS as EXTENSIONS
from sepv.schemes._catalogue import FAMILIES as FAMILIES
from sepv.schemes._catalogue import HAMILTONIANS as HAMILTONIANS
from sepv.schemes._catalogue import PAPER as PAPER
from sepv.schemes._catalogue import by_name as by_name
from sepv.schemes._collocation import collocation as collocation
from sepv.schemes._continuation import continued as continued
from sepv.schemes._darboux_lie import scheme as darboux_lie
from sepv.schemes._discrete_gradient import scheme as discrete_gradient
from sepv.schemes._division import divided as divided
from sepv.schemes._drift_preserving import scheme as drift_preserving
from sepv.schemes._energy_preserving import scheme as energy_preserving
from sepv.schemes._euler_heun import scheme as euler_heun
from sepv.schemes._euler_maruyama import scheme as euler_maruyama
from sepv.schemes._explicit import explicit as explicit
from sepv.schemes._gauss import gauss as gauss
from sepv.schemes._gonzalez import scheme as gonzalez
from sepv.schemes._guard import ask as ask
from sepv.schemes._isospectral_midpoint import scheme as isospectral_midpoint
from sepv.schemes._itoh_abe import scheme as itoh_abe
from sepv.schemes._load import load_problem as load_problem
from sepv.schemes._load import load_scheme as load_scheme
from sepv.schemes._midpoint import scheme as midpoint
from sepv.schemes._milstein import scheme as milstein
from sepv.schemes._modified_weak_two import scheme as modified_weak_two
from sepv.schemes._one_step import RANDOM_STEP as RANDOM_STEP
from sepv.schemes._one_step import Explicit as Explicit
from sepv.schemes._one_step import implicit as implicit
from sepv.schemes._one_step import one_step as one_step
from sepv.schemes._orders import Orders as Orders
from sepv.schemes._point_laws import PointLaw as PointLaw
from sepv.schemes._projected import projected as projected
from sepv.schemes._scheme import Scheme as Scheme
from sepv.schemes._scheme import weakly as weakly
from sepv.schemes._several_structures import scheme as several_structures
from sepv.schemes._splitting import scheme as splitting
from sepv.schemes._stochastic_midpoint import scheme as stochastic_midpoint
from sepv.schemes._stochastic_splitting import scheme as stochastic_splitting

__all__ = [
    "EXTENSIONS",
    "FAMILIES",
    "HAMILTONIANS",
    "PAPER",
    "RANDOM_STEP",
    "Explicit",
    "Orders",
    "PointLaw",
    "Scheme",
    "area_midpoint",
    "ask",
    "both_invariants",
    "by_name",
    "collocation",
    "continued",
    "darboux_lie",
    "discrete_gradient",
    "divided",
    "drift_preserving",
    "energy_preserving",
    "euler_heun",
    "euler_maruyama",
    "explicit",
    "gauss",
    "gonzalez",
    "implicit",
    "isospectral_midpoint",
    "itoh_abe",
    "load_problem",
    "load_scheme",
    "midpoint",
    "milstein",
    "modified_weak_two",
    "one_step",
    "projected",
    "several_structures",
    "splitting",
    "stochastic_midpoint",
    "stochastic_splitting",
    "weakly",
]
