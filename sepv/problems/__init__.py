"""The library of problems: those of Cohen and Dujardin's paper and others by name,
and polynomial problems as data.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from inspect import signature

from sepv._arguments import did_you_mean
from sepv.errors import ProblemError, UsageError, require_one_of, unknown_name
from sepv.problem import Description, GivenProblem, NamedProblem, PolynomialSystem, Problem
from sepv.problem import from_json as from_json
from sepv.problem import to_json as to_json
from sepv.problems._common import HAT, UNIT3, canonical, hat, planes, structure
from sepv.problems._damped_spin import damped_spin as damped_spin
from sepv.problems._damped_top import damped_top as damped_top
from sepv.problems._kepler import kepler as kepler
from sepv.problems._langevin import langevin_double_well as langevin_double_well
from sepv.problems._langevin import langevin_oscillator as langevin_oscillator
from sepv.problems._langevin import langevin_pair as langevin_pair
from sepv.problems._lotka_volterra import lotka_volterra as lotka_volterra
from sepv.problems._lotka_volterra import random_lotka_volterra as random_lotka_volterra
from sepv.problems._matrix_algebras import MatrixAlgebra, algebra_of, product
from sepv.problems._matrix_tops import manakov_top as manakov_top
from sepv.problems._matrix_tops import matrix_system
from sepv.problems._matrix_tops import su3_top as su3_top
from sepv.problems._matrix_tops import zeitlin as zeitlin
from sepv.problems._maxwell_bloch import maxwell_bloch as maxwell_bloch
from sepv.problems._maxwell_bloch import random_maxwell_bloch as random_maxwell_bloch
from sepv.problems._mechanical import harmonic_trap as harmonic_trap
from sepv.problems._mechanical import henon_heiles as henon_heiles
from sepv.problems._mechanical import lennard_jones as lennard_jones
from sepv.problems._mechanical import pendulum_chain as pendulum_chain
from sepv.problems._n_body import figure_eight as figure_eight
from sepv.problems._n_body import planets as planets
from sepv.problems._nambu_system import nambu_system as nambu_system
from sepv.problems._noisy_oscillators import noisy_henon_heiles as noisy_henon_heiles
from sepv.problems._noisy_oscillators import pushed_henon_heiles as pushed_henon_heiles
from sepv.problems._one_degree import harmonic_oscillator as harmonic_oscillator
from sepv.problems._one_degree import pendulum as pendulum
from sepv.problems._point_vortices import point_vortices as point_vortices
from sepv.problems._polynomial_system import bracket, started, structure_entries
from sepv.problems._polynomial_system import polynomial_problem as polynomial_problem
from sepv.problems._rigid_body import rigid_body as rigid_body
from sepv.problems._several import commuting_actions
from sepv.problems._several import commuting_oscillators as commuting_oscillators
from sepv.problems._several import commuting_rotations as commuting_rotations
from sepv.problems._several import kubo_by_hamiltonians as kubo_by_hamiltonians
from sepv.problems._several import kubo_oscillator as kubo_oscillator
from sepv.problems._several import noncommuting_drift as noncommuting_drift
from sepv.problems._several import noncommuting_tops as noncommuting_tops
from sepv.problems._spins import commuting_twists as commuting_twists
from sepv.problems._spins import pushed_rigid_body as pushed_rigid_body
from sepv.problems._spins import random_inertia as random_inertia
from sepv.problems._spins import twisted_top as twisted_top
from sepv.problems._spins import two_spins as two_spins
from sepv.problems._toda import toda as toda


def _listed(*factories: Callable[..., Problem]) -> dict[str, Callable[..., Problem]]:
    return {factory.__name__.replace("_", "-"): factory for factory in factories}


PAPER = _listed(harmonic_oscillator, rigid_body, pendulum, lotka_volterra)
# Problems that the paper does not have.
EXTENSIONS = _listed(
    figure_eight, harmonic_trap, henon_heiles, kepler, lennard_jones, maxwell_bloch, pendulum_chain, planets, toda
)  # fmt: skip
# Problems with several structures or Hamiltonians, with damping or with friction.
SEVERAL = _listed(
    damped_spin, damped_top, commuting_rotations, commuting_oscillators, noncommuting_drift, noncommuting_tops,
    kubo_oscillator, langevin_double_well, langevin_oscillator, langevin_pair,
)  # fmt: skip
# Problems with several Hamiltonians that do not commute.
HAMILTONIANS = _listed(
    commuting_twists, manakov_top, noisy_henon_heiles, point_vortices, pushed_henon_heiles, pushed_rigid_body,
    random_inertia, random_lotka_volterra, random_maxwell_bloch, su3_top, twisted_top, two_spins, zeitlin,
)  # fmt: skip


@lru_cache(maxsize=64)
def by_name(name: str) -> Problem:
    """The built-in problem called `name`, with its default parameters;
    an underscore in `name` counts as a hyphen.
    """
    factories = PAPER | EXTENSIONS | SEVERAL | HAMILTONIANS
    factory = factories.get(str(name).replace("_", "-"))
    if factory is None:
        what = "a problem by name, a .json file, or module:attribute"
        raise unknown_name(what, did_you_mean(name, factories), factories, "see `sepv list`")
    return factory()


def build(data: Description) -> Problem:
    """The problem that `data` describe, by a built-in name and parameters, by polynomials,
    or by a user's functions.
    """
    if isinstance(data, GivenProblem):
        return data.problem
    if isinstance(data, PolynomialSystem):
        return polynomial_problem(data)
    return _named(data)


@lru_cache(maxsize=128)
def _named(data: NamedProblem) -> Problem:
    """A named problem, built once for each name and parameters:
    to record H and B takes as long as a few steps.
    """
    factories = PAPER | EXTENSIONS | HAMILTONIANS
    require_one_of(
        "a problem's name", data.name, factories, "correct the name, or give the problem as polynomial data"
    )
    factory = factories[data.name]
    given = {key: value[0] if len(value) == 1 else value for key, value in data.parameters}
    parameters = signature(factory).parameters.values()
    usual = {p.name: p.default for p in parameters if p.kind is not p.VAR_KEYWORD}
    # A factory with **parameters passes them on to another factory, which checks them.
    for key in given if len(usual) == len(parameters) else ():
        require_one_of(f"a parameter of {data.name}", key, usual)
    try:
        return factory(**given)
    except (TypeError, ValueError) as error:
        if isinstance(error, UsageError):
            raise
        raise ProblemError(
            expected=f"parameters of {data.name} such as {usual}",
            received=f"{given} ({error})",
            remedy="correct them",
        ) from error
