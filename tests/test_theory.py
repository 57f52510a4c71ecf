"""The panels about §2, §3 and the remarks: verdicts that the theory gives, on small samples."""

from __future__ import annotations

import numpy as np
import pytest

from sepv import problems
from sepv.errors import UsageError
from sepv.exact._several_structures import heun
from sepv.schemes._several_with_areas import step_with_areas
from sepv.simulate import _wiener as wiener
from sepv.studies._reproduce import deterministic, extensions, lemma, local, remarks

SOURCES = {"§2", "Lemma 3.2", "(3.2)", "(3.8)", "(3.9)", "Lemma 2.1 of [16], as (3.8) and (3.9)",
           "proof of Theorem 3.3"}  # fmt: skip


@pytest.mark.parametrize("section", [deterministic, lemma, local], ids=lambda m: m.__name__.split(".")[-1])
def test_statements_that_need_no_sampling_hold(section) -> None:
    results = {job.key: job.function(**job.arguments) for job in section.jobs(None)}
    statements = [s for panel in section.PANELS["theory"](results) for s in panel.statements]
    assert statements
    assert {s.source for s in statements} <= SOURCES
    assert {s.verdict for s in statements} == {"holds"}, [
        s.measured for s in statements if s.verdict != "holds"
    ]


def test_a_wrong_coefficient_shows(monkeypatch: pytest.MonkeyPatch) -> None:
    right = lemma.coefficient
    monkeypatch.setattr(lemma, "coefficient", lambda problem, y: 1.01 * right(problem, y))
    panel = lemma.panels({("theory", "lemma", name): lemma.measured(name) for name in lemma.NAMES})[0]
    wrong = [s.verdict for s in panel.statements if s.source == "Lemma 3.2"]
    assert wrong == ["fails"] * len(lemma.NAMES)


def test_the_discrete_gradient_has_order_one_on_the_rigid_body_without_noise() -> None:
    errors = np.array(deterministic.errors("discrete-gradient", "rigid-body"))
    assert abs(np.log2(errors[-2] / errors[-1]) - 1) < 0.05


def test_the_casimir_of_lotka_volterra_falls_in_proportion_to_time() -> None:
    found = remarks.casimir_loss(2.0**-7, 1024, 16, 0, "auto")
    means = dict(zip(found["t"], found["mean"], strict=True))
    assert found["T"] == 8.0
    assert -0.2 < means[8.0] < 3 * means[1.0] < 0
    assert not found["failed"]


def test_a_short_run_does_not_refute_and_does_not_confirm_the_rectangle() -> None:
    found = remarks.casimir_loss(2.0**-8, 256, 8, 0, "auto")
    panel = remarks._lost({("theory", "lost", str(h)): found for h in remarks.LOST_H})
    assert panel.statements[0].verdict == "open"


def test_the_sublinear_problem_is_what_the_remark_says() -> None:
    problem = remarks.sublinear()
    far = np.array([1e6, -1e6])
    assert problem.hamiltonian(far) > 1e6
    assert np.all(np.abs(problem.gradient(far)) <= 1)


def test_lotka_volterra_fails_at_large_steps_whether_truncated_or_not() -> None:
    shares = [remarks.failing("lotka-volterra", truncated, 48, 0, "numpy") for truncated in (True, False)]
    assert min(shares[0][0], shares[1][0]) > 0.1
    assert remarks.failing("harmonic-oscillator", False, 48, 0, "numpy") == [0.0] * len(remarks.CLIP_STEPS)
    assert problems.by_name("harmonic-oscillator").noises == 1


def test_areas_keep_the_energy_whatever_they_are_and_bring_order_one() -> None:
    found = extensions.errors(64, 0)
    panel = extensions._areas(found)
    assert panel.statements[0].verdict == "holds", panel.statements[0].measured
    problem = problems.by_name(extensions.TOPS)
    y = np.array(problem.initial)
    wild = np.array([[0.0, 0.3], [-0.3, 0.0]])
    y1 = step_with_areas(problem, y, 0.1, np.array([0.2, -0.1]), wild)
    assert abs(problem.hamiltonian(y1) - problem.hamiltonian(y)) < 1e-15
    # A wrong sign of the areas leaves the order at one half.
    start, fine = y, wiener.increments(0, T=0.5, steps=1024, noises=2, paths=range(32))
    exact = heun(problem, start, 0.5, fine)
    off = []
    for sign in (1.0, -1.0):
        z = np.repeat(start[:, None], 32, axis=1)
        for dW, A in zip(wiener.coarsen(fine, 32), extensions.areas(fine, 32), strict=True):
            z = step_with_areas(problem, z, 0.5 / 32, dW, sign * A)
        off.append(np.sqrt(np.mean((z - exact) ** 2)))
    assert off[1] > 4 * off[0]


def test_a_problem_with_one_structure_has_no_areas() -> None:
    with pytest.raises(UsageError, match="several structures"):
        step_with_areas(
            problems.pendulum(), np.array([0.2, 1.0]), 0.1, np.array([0.1, 0.1]), np.zeros((2, 2))
        )


def test_stages_raise_the_order_where_flows_commute() -> None:
    errors = extensions.staged(2, 12, 0)
    assert errors[0] / errors[-1] > 8**1.5


def test_paths_stay_in_the_sets_of_remark_3_5_and_a_smaller_set_shows() -> None:
    for name in ("pendulum", "rigid-body"):
        found = remarks.furthest(name, 0, "numpy")
        assert remarks._in_the_set(name, found).verdict == "holds"
        assert (
            remarks._in_the_set(name, {k: 1.01 * v / max(found.values()) for k, v in found.items()}).verdict
            == "fails"
        )


def test_one_step_with_a_hamiltonian_that_is_not_bounded_has_the_slopes_of_order_one() -> None:
    mean, rms = remarks.sublinear_step()
    assert abs(mean - 2) < 0.1
    assert abs(rms - 1.5) < 0.1
