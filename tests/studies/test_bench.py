"""The gate of the benchmark: what it must see, what it must let pass, and its files and
messages.
"""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import Result
from drawn import refusing

import sepv
from sepv import StepFailure, TargetError, UsageError, schemes
from sepv.core.step import Solution
from sepv.files import json_text
from sepv.problem import Array, Problem
from sepv.schemes import Scheme, energy_preserving
from sepv.studies._bench import cases, gate, measure, pairs, store

COUNTERS = Path(__file__).resolve().parents[2] / "benchmarks" / "counters.json"
CASE = cases.choose(("rigid-body",), portable=False)


def record(scheme: Scheme) -> dict[str, Any]:
    return store.record("target", scheme, CASE)


@pytest.fixture(scope="module")
def base() -> dict[str, Any]:
    return record(energy_preserving)


def worse(head: Scheme, base: dict[str, Any]) -> set[str]:
    """What the gate calls worse in a scheme against the energy-preserving one."""
    return {c.what for c in gate.check(record(head), base) if c.verdict == "worse"}


# What it must see


def solved(change: Callable[[Solution], Solution]) -> Scheme:
    """(2.1) with another answer of its solver."""
    solve = energy_preserving.solve
    assert solve is not None
    return replace(energy_preserving, solve=lambda *step: change(solve(*step)))


def test_one_newton_iteration_more_in_one_lane_is_seen(base: dict[str, Any]) -> None:
    first = np.eye(1, CASE[0]["paths"], dtype=int)[0]
    assert worse(solved(lambda s: replace(s, iterations=s.iterations + first)), base) == {"iterations"}


@pytest.mark.parametrize("function", ["gradient", "structure", "hamiltonian", "hessian"])
def test_one_evaluation_more_in_all_is_seen(base: dict[str, Any], function: str) -> None:
    wasted = []

    def solve(problem: Problem, y: Array, h: float, dW: Array) -> Solution:
        if not wasted:
            wasted.append(getattr(problem, function)(y[:, 0]))
        assert energy_preserving.solve is not None
        return energy_preserving.solve(problem, y, h, dW)

    assert worse(replace(energy_preserving, solve=solve), base) == {function}


def test_the_evaluations_of_a_scheme_that_reports_nothing_are_seen() -> None:
    def wasteful(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        problem.gradient(y[:, :1])
        return schemes.euler_heun.step(problem, y, h, dW)

    plain = record(schemes.euler_heun)
    assert plain["cases"][0]["counters"]["iterations"] is None
    assert worse(replace(schemes.euler_heun, step=wasteful), plain) == {"gradient"}


def with_larger_error(factor: float) -> Scheme:
    """The local error of (2.1) times `factor`: it is of third order in Δ,
    so that two halves leave a quarter of it.
    """

    def step(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        whole = energy_preserving.step(problem, y, h, dW)
        half = y
        for _ in range(2):
            half = energy_preserving.step(problem, half, h / 2, dW / 2)
        return whole + (factor - 1) * (whole - half) / 0.75

    return replace(energy_preserving, step=step, solve=None)


@pytest.mark.parametrize("case", [c["name"] for c in cases.BENCH_CASES])
def test_an_error_five_per_cent_larger_is_seen_and_its_energy_too(case: str) -> None:
    chosen = cases.choose((case,), portable=False)
    plain, larger = (store.record("target", s, chosen) for s in (energy_preserving, with_larger_error(1.05)))
    found = {c.what: c for c in gate.check(larger, plain)}
    assert found["error"].verdict == "worse"
    assert found["energy"].verdict == "worse"
    smaller = store.record("target", with_larger_error(0.9), chosen)
    assert {c.what: c.verdict for c in gate.check(smaller, plain)}["error"] == "better"


def test_a_failed_solve_more_is_seen(base: dict[str, Any]) -> None:
    one = lambda problem, y, h, dW: y.ndim == 2 or dW[0] > 0.62  # noqa: E731  (of the case's increments)
    step = refusing(StepFailure("no step"), one, schemes.euler_heun.step)
    dW = measure.raw_increments(measure.build(CASE[0]), CASE[0])
    lost = np.count_nonzero(np.any(dW[:, 0] > 0.62, axis=0))
    assert lost
    found = record(replace(schemes.euler_heun, step=step, truncation=None))
    assert found["cases"][0]["counters"]["failed solves"] == lost
    assert "failed solves" in {c.what for c in gate.check(found, base) if c.verdict == "worse"}


def test_a_solver_that_stops_early_loses_the_energy(base: dict[str, Any]) -> None:
    assert {"energy", "casimir"} <= worse(solved(lambda s: replace(s, value=s.value * (1 + 1e-14))), base)


# What it must let pass


def test_rounding_is_no_regression(base: dict[str, Any]) -> None:
    up = np.where(np.arange(CASE[0]["paths"]) % 3 == 0, 1 + 2.0**-52, 1.0)
    found = gate.check(record(solved(lambda s: replace(s, value=s.value * up))), base)
    assert not [c for c in found if c.what == "error" and c.verdict != "same"]


def test_errors_of_other_paths_of_the_same_scheme_pass() -> None:
    """Independent paths: the false alarm of one such check is at most 1e-3,
    and 20 fixed pairs are tried.
    """
    checks = []
    for seed in range(20):
        head, other = ({**CASE[0], "seed": 100 + 2 * seed + n, "paths": 128} for n in (0, 1))
        ours, theirs = (measure.measure(schemes.euler_heun, case)["error"] for case in (head, other))
        checks.append(gate._ratio("t", "c", "error", ours, theirs).verdict)
    assert "worse" not in checks


# Time


def test_the_bootstrap_bound_catches_ten_per_cent_and_lets_noise_pass() -> None:
    """Simulated: batches with a bias of 1 % each, pairs with 5 % noise and a tenth of them doubled
    on one side.
    """
    rng = np.random.default_rng(7)

    def simulated(true: float) -> tuple[float, float, float]:
        bias = 0.01 * rng.standard_normal((8, 1))
        noise = 0.05 * rng.standard_normal((8, pairs.TIMED_PAIRS))
        hit = np.log(2) * (rng.random(noise.shape) < 0.1) * rng.choice([-1, 1], noise.shape)
        return pairs.bootstrap(list(np.log(true) + bias + noise + hit))

    alike = [simulated(1.0) for _ in range(100)]
    slower = [simulated(1.1) for _ in range(100)]
    tolerance = np.log(pairs.TIME_TOLERANCE)
    # A false alarm needs a bound that fails (1e-3) by another two per cent.
    assert not [low for _, low, _ in alike if low > tolerance]
    assert len([low for _, low, _ in slower if low > tolerance]) >= 95


def test_two_checkouts_take_turns(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[str] = []

    class Told(pairs.Side):
        def __init__(self, target: str, checkout: Path, label: str) -> None:
            self.label = label

        def ask(self, question: dict[str, Any]) -> dict[str, Any]:
            asked.append(self.label)
            seconds = 0.02 * question["loops"] * (1.25 if self.label == "head's" else 1.0)
            return {"seconds": [seconds, seconds]}

        def close(self) -> None:
            pass

    monkeypatch.setattr(pairs, "Side", Told)
    built_in = pairs.time_pairs("t", tmp_path, tmp_path, CASE)
    clocks = ["processor time", "clock time"]
    assert [c.what for c in built_in] == [*clocks, *(f"{c} of an ensemble" for c in clocks)]
    asked.clear()
    found = pairs.time_pairs("mine:t", tmp_path, tmp_path, CASE)
    assert [c.verdict for c in found] == ["worse", "worse"]
    readings = asked[4 : 4 + 2 * pairs.TIMED_PAIRS]  # after the first runs and the look at how long one takes
    assert readings == ["head's", "other", "other", "head's"] * (pairs.TIMED_PAIRS // 2)
    assert len(asked) == pairs.FEWEST_BATCHES * (4 + 2 * pairs.TIMED_PAIRS)


# The command


MODULE = "from sepv.schemes._energy_preserving import scheme\nfrom sepv.schemes._euler_heun import step\n"


def test_a_third_party_saves_and_compares(call: Callable[..., Result], tmp_path: Path) -> None:
    saved = call("bench mine:step --case rigid-body --save base.json", MODULE)
    assert saved.exit_code == 0, saved.output
    assert "16384" in saved.output  # two evaluations, 512 paths, 16 steps
    again = call("bench mine:step --against base.json", MODULE)
    assert again.exit_code == 0, again.output
    assert "9 checks: 9 same." in again.output
    wasteful = MODULE + (
        "heun = step\ndef step(problem, y, h, dW):\n"
        "    problem.gradient(y)\n    return heun(problem, y, h, dW)\n"
    )
    found = call("bench mine:step --against base.json", wasteful)
    assert found.exit_code == 1, found.output
    assert "gradient worse  16384 → 24576 (+8192)" in found.output
    assert "Traceback" not in found.output


def test_another_checkout_is_measured_with_its_own_code(call: Callable[..., Result], tmp_path: Path) -> None:
    other = tmp_path / "other" / "src"
    other.mkdir(parents=True)
    (other / "mine.py").write_text(
        MODULE + "midpoint = step\ndef step(problem, y, h, dW):\n"
        "    print('noise on stdout')\n    problem.gradient(y)\n    return midpoint(problem, y, h, dW)\n"
    )
    result = call("bench mine:step --against-ref other --case rigid-body --batches 4", MODULE)
    assert "gradient better  24576 → 16384 (-8192)" in result.output, result.output
    assert "processor time" in result.output
    assert "clock time" in result.output


def test_a_checkout_without_the_target_is_refused(call: Callable[..., Result], tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    for target in ("energy-preserving", "mine:scheme"):
        result = call(f"bench {target} --against-ref empty --case rigid-body", MODULE)
        assert result.exit_code in (2, 3), result.output
        assert "Traceback" not in result.output
        assert "checkout" in result.output


def test_files_that_were_tampered_with_are_refused(base: dict[str, Any], tmp_path: Path) -> None:
    text = json_text(store.document([base]))
    path = tmp_path / "b.json"
    path.write_text(text)
    assert store.load(str(path)) == [base]
    changes = ('"format": 1', '"format": 2'), ('"gradient": ', '"gradient": 0.5'), ('"0x', '"zz')
    for broken in (text[:-20], "[]", *(text.replace(old, new, 1) for old, new in changes)):
        path.write_text(broken)
        with pytest.raises(UsageError, match="sepv bench --save"):
            store.load(str(path))


def test_a_record_of_other_cases_is_refused(base: dict[str, Any]) -> None:
    with pytest.raises(UsageError, match="same cases"):
        gate.check({"target": "t", "cases": []}, base)


# The committed counters


@pytest.mark.parametrize("entry", store.load(str(COUNTERS)), ids=lambda e: e["target"])
def test_the_committed_counters_are_those_of_today(entry: dict[str, Any]) -> None:
    """To change them is a visible act: sepv bench … --portable --save benchmarks/counters.json,
    and say why.

    Collocation with several stages is not among them: LAPACK solves its linear systems, and rounds
    as it likes.
    """
    scheme = schemes.by_name(entry["target"])
    today = store.record(entry["target"], scheme, [c["case"] for c in entry["cases"]])
    for now, then in zip(today["cases"], entry["cases"], strict=True):
        assert now["counters"] == then["counters"], now["case"]["name"]
    assert [c for c in gate.check(today, entry) if c.verdict == "worse"] == []


def test_the_committed_counters_are_portable_and_of_all_schemes_of_the_paper_and_their_rivals() -> None:
    entries = store.load(str(COUNTERS))
    paper = "energy-preserving midpoint discrete-gradient euler-heun milstein euler-maruyama"
    rivals = "explicit-4 explicit-8 projected-4 projected-8"
    assert {*paper.split(), *rivals.split()} <= {e["target"] for e in entries}
    portable = [c["name"] for c in cases.BENCH_CASES if c["portable"]]
    assert all([c["case"]["name"] for c in e["cases"]] == portable for e in entries)
    assert json.loads(COUNTERS.read_text())["environment"]["sepv"] == sepv.__version__


def test_a_crash_on_either_side_is_said(tmp_path: Path) -> None:
    (tmp_path / "broken.py").write_text("import os\ndef step(problem, y, h, dW):\n    os._exit(3)\n")
    with pytest.raises(TargetError, match="no answer"):
        pairs.measured("broken:step", tmp_path, tmp_path, CASE)
