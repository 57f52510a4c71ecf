"""The schemes, one file each: those of the paper, and families of higher order by their number of
stages.

Read first `_scheme` (the data of a scheme), `_energy_preserving` (equation (2.1)) and `_one_step`
(how a formula becomes a scheme). `_guard` calls a scheme and checks its result. `_load_target`
finds a scheme by name. `_point_distributions` has increments with two or three values. `_division`
and `_continuation` solve steps that fail. `_catalogue` lists the schemes by name. Each is also an
attribute of this package, such as `schemes.midpoint`.
"""

from __future__ import annotations

from typing import Any

from sepv.core.formula import Fields as Fields
from sepv.core.formula import Increment as Increment
from sepv.core.formula import Values as Values
from sepv.core.newton import Status as Status
from sepv.core.step import Solution as Solution
from sepv.problem import Systems as Systems
from sepv.schemes._catalogue import BY_FILE as BY_FILE
from sepv.schemes._catalogue import DAMPED as DAMPED
from sepv.schemes._catalogue import EXTENSIONS as EXTENSIONS
from sepv.schemes._catalogue import FAMILIES as FAMILIES
from sepv.schemes._catalogue import HAMILTONIANS as HAMILTONIANS
from sepv.schemes._catalogue import PAPER as PAPER
from sepv.schemes._catalogue import built_in as built_in
from sepv.schemes._catalogue import by_name as by_name
from sepv.schemes._claims import (
    ALL_LAWS,
    FORMER_LAWS,
    LAWS,
    LOCAL_LAWS,
    OF_TWINS,
    law_named,
    page_of,
    require_laws,
)
from sepv.schemes._collocation import FIRST_NODES, MAX_NODES
from sepv.schemes._collocation import collocation as collocation
from sepv.schemes._conformal import undamped
from sepv.schemes._continuation import continued as continued
from sepv.schemes._discrete_gradient import coordinate_increments
from sepv.schemes._division import divided as divided
from sepv.schemes._drift_preserving import pushed_by_noise, quiet_step
from sepv.schemes._energy_preserving import formula as energy_preserving_formula
from sepv.schemes._energy_preserving import jacobian as energy_preserving_jacobian
from sepv.schemes._explicit import end as explicit_formula
from sepv.schemes._explicit import explicit as explicit
from sepv.schemes._explicit_tableaux import CLASSICAL, DORMAND_PRINCE_8, TABLEAUX, ExplicitTableau
from sepv.schemes._further_increments import answer as answer_of
from sepv.schemes._further_increments import as_matrix, as_rows, carry, further_rows
from sepv.schemes._gauss import gauss as gauss
from sepv.schemes._guard import (
    SchemeCrash,
    ask_next,
    ask_once,
    check_answer,
    guarded,
    raw_answer,
    require_one_return,
    require_unchanged,
    restored_names,
    translated,
)
from sepv.schemes._guard import ask as ask
from sepv.schemes._itoh_abe import formula as itoh_abe_formula
from sepv.schemes._langevin import LANGEVIN_CLAIMS
from sepv.schemes._leapfrog import KicksAndDrifts, composed_leapfrogs
from sepv.schemes._load_target import as_twin, load_object, require_trusted, words_for
from sepv.schemes._load_target import load_problem as load_problem
from sepv.schemes._load_target import load_scheme as load_scheme
from sepv.schemes._midpoint import formula as midpoint_formula
from sepv.schemes._modified_weak_two import step_and_variance, structure_curvature, structure_slope
from sepv.schemes._one_step import RANDOM_STEP as RANDOM_STEP
from sepv.schemes._one_step import Explicit as Explicit
from sepv.schemes._one_step import (
    Implicit,
    Parts,
    drift_and_noise,
    noise_and_areas,
    random_step,
    require_converged,
)
from sepv.schemes._one_step import implicit as implicit
from sepv.schemes._one_step import one_step as one_step
from sepv.schemes._order_claims import Orders as Orders
from sepv.schemes._order_claims import order_of
from sepv.schemes._picture_look import Look as Look
from sepv.schemes._point_distributions import NORMAL, POINT_LAWS, point_law
from sepv.schemes._point_distributions import PointLaw as PointLaw
from sepv.schemes._projected import projected as projected
from sepv.schemes._recorded import Recorded
from sepv.schemes._scheme import Scheme as Scheme
from sepv.schemes._scheme import Step, as_lanes, takes
from sepv.schemes._scheme import Twin as Twin
from sepv.schemes._scheme import weakly as weakly
from sepv.schemes._stateful import REFUSAL_ERRORS, joined_lanes, lanes
from sepv.schemes._stateful import PathSolver as PathSolver
from sepv.schemes._stateful import StatefulStep as StatefulStep
from sepv.schemes._steps_of_a_path import StepsOfAPath, as_path, has_memory, resumed, several
from sepv.schemes._tableaux import MAX_STAGES, exact_nodes, gauss_tableau, moments
from sepv.schemes._tableaux import amplification as gauss_amplification


def __getattr__(name: str) -> Any:  # a Scheme; mypy leaves a class that is named here unresolved
    """The scheme of the catalogue whose file is `_name.py`, such as `midpoint` of
    `_midpoint.py`.
    """
    if name in BY_FILE:
        return BY_FILE[name]
    raise AttributeError(f"module 'sepv.schemes' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(
        {*(name for name in globals() if not name.startswith("_")), *BY_FILE} - {"Any", "annotations"}
    )
