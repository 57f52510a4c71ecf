"""Damped systems: decay along exact solutions, the order of *conformal*, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest

import sepv
from sepv import problems, schemes
from sepv.errors import Skipped, SystemsError
from sepv.problem import DampedProblem
from sepv.problems import from_json, to_json
from sepv.simulate import _wiener as wiener

PATHS = 200


def test_conformal_has_order_one_against_the_flow_at_a_time_of_the_whole_path() -> None:
    """y(T) = e^{−γT}φ_θ(y0), θ = ∫e^{−κγs}(ds + c dW), κ = 1 for the rigid body.

    θ is a sum over steps of 2⁻¹¹, whose error is h_fine/√12·κγ of the size of W: 1e-4. A scheme of order ½ would have a
    ratio of 2 and one of order 1 has 4: 200 paths measure it to some per cent.
    """
    top = problems.damped_top()
    gamma, T, fine = 0.5, 1.0, 2048
    dW = wiener.increments(0, T=T, steps=fine, noises=1, paths=range(PATHS))
    middle = (np.arange(fine) + 0.5) * T / fine
    theta = (1 - np.exp(-gamma * T)) / gamma + np.exp(-gamma * middle) @ dW[:, 0]
    undamped = problems.rigid_body()
    exact = np.exp(-gamma * T) * sepv.exact_flow(undamped, theta, np.array(top.initial)).y
    errors = []
    for steps in (16, 64):
        y = np.repeat(np.array(top.initial)[:, None], PATHS, axis=1)
        for increment in wiener.coarsen(dW, fine // steps):
            y = schemes.conformal.step(top, y, T / steps, increment)
        errors.append(np.sqrt(np.mean(np.sum((y - exact) ** 2, axis=0))))
    assert 2.8 < errors[0] / errors[1] < 5.6


def test_casimir_and_energy_decay_by_their_factors_over_many_steps() -> None:
    top = problems.damped_top(damping=0.25)
    path = sepv.integrate("conformal", top, h=0.125, T=16.0, seed=3)
    factor = np.exp(-0.5 * path.t)
    assert np.allclose(np.sum(path.y**2, axis=0), factor, rtol=1e-13)
    assert np.allclose(top.hamiltonian(path.y), factor * top.hamiltonian(path.y[:, 0]), rtol=1e-13)


def test_damping_is_data() -> None:
    top = problems.damped_top()
    assert from_json(to_json(top)) == top.data
    assert to_json(top.data)["damping"] == (0.5).hex()
    assert isinstance(problems.build(top.data), DampedProblem)
    assert type(problems.build(replace(top.data, damping=0.0))) is sepv.Problem


@pytest.mark.parametrize("name", [*schemes.PAPER, *schemes.EXTENSIONS, *schemes.HAMILTONIANS])
def test_no_other_scheme_leaves_the_damping_out_in_silence(name: str) -> None:
    scheme, top = schemes.by_name(name), problems.damped_top()
    further = {"areas": np.zeros((1, 1)), "halves": np.zeros(1), "space-time": np.zeros(1)}.get(scheme.asks)
    arguments = (top, np.array(top.initial), 0.1, np.array([0.1]), *([] if further is None else [further]))
    with pytest.raises((SystemsError, Skipped)):
        scheme.step(*arguments)
