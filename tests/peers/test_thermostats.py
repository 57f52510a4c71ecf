"""Langevin dynamics of other libraries with given noise."""

from importlib import import_module

import numpy as np
import pytest

from sepv.core.arrays import Array
from sepv.errors import Skipped
from sepv.peers._integrator import BAOAB_CLAIMS, thermostat
from sepv.peers.peer import Peer
from sepv.problem import Mechanics, Problem, friction
from sepv.problems import henon_heiles, langevin_double_well, langevin_pair
from sepv.schemes import Scheme, by_name, load_scheme
from sepv.verification import Effort, verify


def baoab(
    system: Mechanics, rate: float, kT: float, q: Array, p: Array, h: float, xi: Array
) -> tuple[Array, Array]:
    """BAOAB_CLAIMS as libraries of particles write it: by kT, masses and normal numbers."""
    p = p + h / 2 * system.force(q)
    q = q + h / 2 * system.velocity(p)
    c = np.exp(-rate * h)
    p = c * p + np.sqrt(kT * (1 - c * c) * np.diag(system.mass)) * xi
    q = q + h / 2 * system.velocity(p)
    return q, p + h / 2 * system.force(q)


PROBLEMS = (langevin_pair(), langevin_double_well(), friction(henon_heiles(coupling=0.0), 0.5, 0.0))


def steps(scheme: Scheme, problem: Problem) -> tuple[Array, Array]:
    y, dW = np.array(problem.initial) + 0.25, np.array([0.2, -0.3])[: problem.noises]
    return scheme.step(problem, y, 0.25, dW), by_name("baoab").step(problem, y, 0.25, dW)


@pytest.mark.parametrize("problem", PROBLEMS)
def test_a_library_gets_the_normal_numbers_of_the_increments(problem: Problem) -> None:
    came, expected = steps(thermostat("own", baoab, source="", claims=BAOAB_CLAIMS), problem)
    np.testing.assert_allclose(came, expected, rtol=0, atol=4e-16)


def test_space_time_areas_are_normal_numbers_too() -> None:
    def told(*given: object) -> tuple[Array, Array]:
        assert isinstance(given[-1], np.ndarray)
        return given[-1][0], given[-1][1]

    scheme = thermostat("own", told, source="", asks="space-time")
    h, problem = 0.25, langevin_pair()
    draws = np.random.default_rng(0).standard_normal((2, 2, 64))
    ends = np.stack([
        scheme.step(problem, np.zeros(4), h, np.sqrt(h) * a, np.sqrt(h / 12) * b)
        for a, b in np.moveaxis(draws, 2, 0)
    ])  # fmt: skip
    np.testing.assert_allclose(ends.T.reshape(2, 2, 64), draws, rtol=1e-12)


def test_what_a_library_cannot_take_is_left_out() -> None:
    scheme = thermostat("own", baoab, source="")
    with pytest.raises(Skipped, match="h > 0"):
        scheme.step(langevin_pair(), np.ones(4), -0.1, np.zeros(2))
    with pytest.raises(Skipped, match="no Langevin dynamics"):
        scheme.step(henon_heiles(noise=()), np.ones(4), 0.1, np.zeros(0))


def test_the_laws_judge_such_a_step_as_baoab() -> None:
    scheme = thermostat("own", baoab, source="", claims=BAOAB_CLAIMS)
    laws = ("equilibrium", "equilibrium:positions", "local-mean-square", "local-weak")
    found = verify(scheme, laws=laws, effort=Effort(corpus=False)).findings
    assert [finding.verdict.text for finding in found] == ["holds"] * 4


def loaded(library: str) -> Scheme:
    pytest.importorskip(library, reason=f"{library} is not installed: the extra `simulators`")
    found: Peer = import_module(f"sepv.peers.{library}").PEER
    return found.thermostats["langevin"]


def test_ase_has_mean_square_order_two_with_the_area() -> None:
    found = verify(
        loaded("ase"), laws=("local-mean", "local-mean-square", "local-weak", "equilibrium")
    ).findings
    assert [finding.verdict.text for finding in found] == ["holds"] * 4


@pytest.mark.parametrize("library", ["jax_md", "torch_sim"])
def test_libraries_that_say_baoab_step_as_baoab(library: str) -> None:
    scheme = loaded(library)
    assert load_scheme(f"{library}-langevin") is scheme
    for problem in PROBLEMS:
        came, expected = steps(scheme, problem)
        np.testing.assert_allclose(came, expected, rtol=0, atol=4e-16)
