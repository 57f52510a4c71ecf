"""Invariants are looked at along the paths that laws about paths make, for schemes without
memory.
"""

import pickle
from typing import Any

import numpy as np
import pytest

import sepv
from benchmarks.right_schemes import RIGHT_SCHEMES
from sepv import problems
from sepv.faults.saboteurs import SABOTEURS
from sepv.law.along_paths import CASIMIR, ENERGY, taken, watching
from sepv.schemes import Scheme, energy_preserving
from sepv.verification import Effort, Run, replay

LEAST = Effort(examples=1, shrink_checks=0, corpus=False)
SABOTEUR = SABOTEURS["wrong-cell-of-a-table"].scheme


def test_a_fault_that_only_paths_meet_violates_casimir_with_a_case_to_replay() -> None:
    alone = sepv.verify(SABOTEUR, laws="casimir", effort=LEAST).finding(CASIMIR)
    with_paths = sepv.verify(SABOTEUR, laws="casimir,rounding", effort=LEAST)
    found = with_paths.finding(CASIMIR)
    assert (alone.verdict.text, found.verdict.text) == ("holds", "violated")
    assert with_paths.finding("rounding").verdict.text == "holds"
    assert found.claimed
    assert found.checks > alone.checks
    assert found.message.startswith("on a step of a path, found by a law about paths:")
    assert found.replay.startswith("--law casimir --replay ")
    assert found.witness is not None
    again = replay(SABOTEUR, CASIMIR, found.witness)
    assert (again.verdict.text, again.defect) == ("violated", found.defect)


def test_no_right_scheme_is_accused_of_a_step_of_a_path() -> None:
    report = sepv.verify(energy_preserving, laws="energy,casimir,rounding", effort=LEAST)
    assert {f.verdict.text for f in report.findings} == {"holds"}
    alone = sepv.verify(energy_preserving, laws="energy,casimir", effort=LEAST)
    for law, of_paths in (
        (ENERGY, 4),
        (CASIMIR, 3),
    ):  # the runs of rounding, on problems with such an invariant
        assert report.finding(law).checks == alone.finding(law).checks + of_paths


def test_the_step_with_the_largest_change_is_kept_for_each_law_problem_and_size() -> None:
    run, problem = Run(Effort()), problems.rigid_body()
    watch = watching(run, energy_preserving)
    assert watch is not None
    y0, dW = np.array([[0.8, 0.0], [0.6, 1.0], [0.0, 0.0]]), np.array([[0.25, 0.5]])
    y1 = y0 + np.array([[0.0, 1e-9], [1e-12, 0.0], [0.0, 1e-9]])
    watch(problem, y0, y1, 0.125, dW)
    watch(problem, y0[:, :1], y0[:, :1], 0.125, dW[:, :1])
    watch(problem, y0[:, :1], y0[:, :1], 0.5, dW[:, :1])  # nothing changes: no step is kept
    watch(problem, y0[:, :1], y1[:, :1] + np.nan, 0.25, dW[:, :1])
    kept: list[tuple[str, Any]] = list(taken(run, energy_preserving))
    # On the axis of inertia the second state moves along the level of both invariants up to 1e-18.
    assert [(law, witness["y"]) for law, witness in kept] == [
        (law, [v.hex() for v in (0.8, 0.6, 0.0)]) for law in (ENERGY, CASIMIR)
    ]
    assert not run.worst
    assert pickle.loads(pickle.dumps(kept)) == kept


@pytest.mark.parametrize(
    "scheme", [RIGHT_SCHEMES["compensated"], RIGHT_SCHEMES["reversible-heun"]], ids=lambda s: s.name
)
def test_steps_of_a_scheme_with_memory_are_no_cases(scheme: Scheme) -> None:
    assert watching(Run(Effort()), scheme) is None
