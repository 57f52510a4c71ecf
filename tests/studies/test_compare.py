"""Error beside its price: the numbers of a comparison, its table, picture and files,
and what is refused.
"""

import csv
import io
import json
import os
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from click.testing import Result
from doors import obeys
from sepv.properties._orders.convergence import strong_errors

import sepv
from sepv import problems, schemes
from sepv.pictures import content
from sepv.problem import Array, Problem
from sepv.simulate import _wiener as wiener
from sepv.statistics import Estimate
from sepv.studies._compare import method as methods_of
from sepv.studies._compare import table
from sepv.studies._compare.comparison import Comparison
from sepv.studies._compare.method import Followed, Method, MethodEnds, exact_time_change, from_scheme
from sepv.studies._compare.record import Point, Seconds, time_to_error
from sepv.studies._compare.run import compare, one_core
from sepv.studies._evaluation_count import Work, counted

STEPS = (4, 8, 16)


def in_batches(scheme: sepv.Scheme) -> Method:
    return from_scheme(scheme, problems.rigid_body(), "numpy")


@pytest.fixture(scope="module")
def found() -> Comparison:
    body = problems.rigid_body()
    methods = [in_batches(schemes.energy_preserving), in_batches(schemes.euler_heun), exact_time_change()]
    return compare(methods, body, steps=STEPS, paths=64, repeats=2, targets=[1e-1, 1e-3])


def test_the_errors_are_those_of_the_convergence_laws(found: Comparison) -> None:
    body = problems.rigid_body()
    theirs = strong_errors(schemes.energy_preserving, body, T=1.0, steps=STEPS, paths=range(64))
    ours = [p.strong.value for p in found.of("energy-preserving")]
    # With 4 steps some increments are clipped: users pay for the clip, and the laws do not judge
    # it.
    assert np.allclose(ours[1:], theirs.rms()[1:], rtol=1e-12, atol=0)
    assert ours[0] > theirs.rms()[0]
    weak = [p.weak.value for p in found.of("energy-preserving")]
    assert np.allclose(weak[1:], np.linalg.norm(theirs.errors.mean(axis=2), axis=1)[1:], rtol=1e-12, atol=0)


def test_invariants_are_kept_by_the_one_and_lost_by_the_other(found: Comparison) -> None:
    for kept, lost in zip(found.of("energy-preserving"), found.of("euler-heun"), strict=True):
        assert max(kept.energy_defect, kept.casimir_defect) < 1e-14
        assert min(lost.energy_defect, lost.casimir_defect) > 1e-2


def test_the_exact_time_change_has_one_point_and_the_error_it_states(found: Comparison) -> None:
    (point,) = found.of("exact-flow")
    assert not point.steps_matter
    assert 0 < point.strong.value < 1e-13


@pytest.mark.parametrize(("name", "steps"), [("rigid-body", 16), ("pendulum", 16), ("lotka-volterra", 128)])
def test_the_compiled_engine_is_taken_where_it_can_be_and_agrees(name: str, steps: int) -> None:
    pytest.importorskip("numba", reason="the extra `fast`")
    problem = problems.by_name(name)
    fast = from_scheme(schemes.energy_preserving, problem)
    assert "compiled engine" in fast.source
    assert "NumPy batch" in from_scheme(schemes.splitting, problem).source  # which the engine does not take
    slow = replace(in_batches(schemes.energy_preserving), name="numpy")
    found = compare([fast, slow], problem, steps=[steps], paths=32, repeats=1)
    for ours, theirs in zip(found.of("energy-preserving"), found.of("numpy"), strict=True):
        assert ours.strong.value == pytest.approx(theirs.strong.value, rel=1e-9)
        assert ours.energy_defect < 1e-13
        assert ours.iterations is not None
        assert ours.evaluations["gradient"] > 0


def test_explicit_schemes_are_counted_too_by_each_engine(found: Comparison) -> None:
    pytest.importorskip("numba", reason="the extra `fast`")
    method = from_scheme(schemes.euler_heun, problems.rigid_body())
    assert "compiled" in method.source
    compiled = compare([method], problems.rigid_body(), steps=[4], paths=32, repeats=1).points
    for point in (*found.of("euler-heun"), *compiled):
        assert point.evaluations["gradient"] == point.evaluations["structure"] == 2.0
    assert {point.iterations for point in found.of("euler-heun")} == {None}
    for point in found.of("energy-preserving"):
        # Newton's matrix serves once more where the last correction was small.
        assert 0 < point.evaluations["hessian"] <= point.iterations


def test_work_is_counted_state_by_state() -> None:
    work = Work()
    problem = counted(problems.pendulum(), work)
    problem.gradient(np.zeros((2, 3, 5)))
    problem.structure(np.zeros(2))
    assert problem.mean_gradient is not None
    problem.mean_gradient(np.zeros((2, 7)), np.ones((2, 7)))
    assert work.evaluations["gradient"] == 15 + 7
    assert work.evaluations["structure"] == 1
    assert work.evaluations["hamiltonian"] == 0


def test_the_document_matches_its_schema_and_the_csv_has_a_line_for_each_point(found: Comparison) -> None:
    document = json.loads(json.dumps(found.to_json(), allow_nan=False))
    obeys(document, "comparison")
    assert len(document["points"]) == 2 * len(STEPS) + 1
    rows = list(csv.DictReader(io.StringIO(table.to_csv(found))))
    assert [float(r["strong_error"]) for r in rows] == [p.strong.value for p in found.points]
    assert all(r["iterations_per_step"] == "" for r in rows if r["method"] == "euler-heun")


def test_equal_comparisons_give_the_same_errors_counts_and_picture(found: Comparison) -> None:
    only = [in_batches(schemes.energy_preserving)]
    again = compare(only, problems.rigid_body(), steps=STEPS, paths=64, repeats=1)
    for ours, theirs in zip(again.points, found.of("energy-preserving"), strict=True):
        assert replace(ours, seconds=theirs.seconds) == theirs
    pytest.importorskip("matplotlib")
    drawn = content(found.plot(), ".svg")
    assert drawn == content(found.plot(), ".svg")
    words = " ".join(ElementTree.fromstring(drawn).itertext())
    for word in (*found.sources, "strong error at T", "processor time of one path"):
        assert word in words
    assert content(found.plot(), ".png").startswith(b"\x89PNG")


def point(steps: int, error: float, microseconds: float, failures: int = 0) -> Point:
    seconds = Seconds(microseconds * 1e-4, 0.0, 0.0, 0.0, 0.0)
    sure = Estimate(error, 0.0, 0.05)
    return Point("m", 1 / steps, steps, 100, failures, sure, sure, 0.0, 0.0, seconds, {}, None)


def test_the_time_to_an_error_follows_the_slope() -> None:
    points = [point(8, 1e-1, 8.0), point(16, 5e-2, 16.0), point(32, 2.5e-2, 32.0)]
    between = time_to_error(points, 4e-2)
    assert between.how == "between"
    assert between.microseconds == pytest.approx(20.0)
    beyond = time_to_error(points, 1e-3)
    assert beyond.how == "beyond"
    assert beyond.microseconds == pytest.approx(32.0 * 25)
    assert time_to_error(points, 0.5).how == "coarsest"
    assert time_to_error(points, 0.5).microseconds == pytest.approx(8.0)
    stalled = [point(8, 1e-3, 8.0), point(16, 9.9e-4, 16.0)]
    assert time_to_error(stalled, 1e-5).how == "never"
    # Step sizes that lose paths reach no target.
    lost = point(8, 1e-3, 8.0, failures=1)
    assert time_to_error([lost, *points[1:]], 4e-2).how == "between"
    assert time_to_error([lost], 1e-1).how == "never"


def test_what_clipped_increments_cost_counts_in_the_time_to_an_error_and_is_said() -> None:
    """Four stages with k = 8 and 8 steps: 9e-7 in a sample, and 1.5e-5 by clipping."""
    body = problems.rigid_body()
    four = schemes.collocation(4)
    old, new = (replace(in_batches(replace(four, truncation=k)), name=f"k = {k}") for k in (8, 16))
    found = compare([old, new], body, T=1.0, steps=(8, 16), paths=64, repeats=1, targets=(1e-6,))
    (coarse, _), (sure, _) = found.of("k = 8"), found.of("k = 16")
    assert coarse.strong.value == sure.strong.value < 3e-6
    assert coarse.clipping == pytest.approx(1.5e-5, rel=0.1)
    assert coarse.error > 1e-5 > 10 * sure.clipping
    times, notes = {t.method: t for t in found.times_to_error()}, "\n".join(table.notes(found))
    assert times["k = 8"].how == "between"
    assert "k = 8: truncated increments alone cost 1.5e-05 at 8 steps" in notes
    assert "k = 16: truncated" not in notes


def test_methods_take_turns_and_every_job_runs_in_every_round() -> None:
    order: list[str] = []

    def method(name: str) -> Method:
        def prepare(problem: Problem, y0: Array, h: float, dW: Array) -> Callable[[], MethodEnds]:
            def job() -> MethodEnds:
                order.append(f"{name}{len(dW)}")
                # Longer than the shortest reading of the clock, so that one round is one call.
                time.sleep(3e-3)
                return methods_of.finite_ends(problem, np.repeat(y0[:, None], dW.shape[2], axis=1))

            return job

        def follow(problem: Problem, y0: Array, h: float, dW: Array) -> Followed:
            states = np.repeat(y0[:, None], dW.shape[2], axis=1)[None]
            defects = methods_of.invariant_defects(problem, states)
            return Followed(methods_of.finite_ends(problem, states[0]), *defects, None)

        return Method(name, prepare, follow)

    found = compare([method("a"), method("b")], problems.rigid_body(), steps=[1, 2], paths=32, repeats=2)
    jobs = ["a1", "a2", "b1", "b2"]
    assert order[:8] == [*jobs, *jobs]  # first calls, then the look at how long one takes
    assert order[8:] == [*jobs, "b1", "b2", "a1", "a2"]
    assert all(p.evaluations == {} and p.energy_defect == 0 for p in found.points)


def test_a_path_that_fails_counts_in_no_error_and_is_counted() -> None:
    def step(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        y1 = schemes.euler_heun.step(problem, y, h, dW)
        y1[:, np.abs(dW[0]) > 2.5 * np.sqrt(h)] = np.nan
        return y1

    broken = replace(schemes.euler_heun, name="broken", step=step, truncation=None)
    methods = [in_batches(broken), in_batches(replace(schemes.euler_heun, truncation=None))]
    found = compare(methods, problems.rigid_body(), steps=[8], paths=128, repeats=1)
    bad, good = found.points
    dW = wiener.increments(0, T=1.0, steps=8, noises=1, paths=128)
    assert bad.failures == np.count_nonzero(np.any(np.abs(dW[:, 0]) > 2.5 * np.sqrt(1 / 8), axis=0)) > 0
    assert good.failures == 0
    assert np.isfinite(bad.strong.value)
    assert any("failed count in no error" in note for note in table.notes(found))


def test_a_driver_that_waits_for_something_is_said_to_wait(found: Comparison) -> None:
    for wall, waits in ((2.0, 0), (200.0, 1)):
        walls = {p.method: 2.0 for p in found.points} | {"euler-heun": wall}
        timed = (replace(p, seconds=Seconds(1.0, 1.0, 1.0, walls[p.method], 0.0)) for p in found.points)
        notes = table.notes(replace(found, points=tuple(timed)))
        assert sum("waits" in note and "euler-heun" in note for note in notes) == waits


def test_one_core_is_given_back() -> None:
    if not hasattr(os, "sched_getaffinity"):
        pytest.skip("no affinity on this system")
    before = os.sched_getaffinity(0)
    with one_core() as alone:
        assert alone
        assert len(os.sched_getaffinity(0)) == 1
    assert os.sched_getaffinity(0) == before


# The command


def test_times_of_python_beside_those_of_a_compiled_loop_are_said_to_be_so(found: Comparison) -> None:
    first, second = [name for name in found.sources if found.of(name)[0].steps_matter][:2]

    def said(*called: str) -> list[str]:
        return [n for n in table.notes(replace(found, called_each_step=called)) if "once a step" in n]

    (note,) = said(first)
    assert note.startswith(f"{first}: called from Python once a step, where ")
    assert second in note
    assert said() == said(*found.sources) == []


QUICK = "--steps 4,8 --paths 32 --repeats 1"


def test_the_command_prints_and_writes(call: Callable[..., Result], tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    code = "from sepv.schemes._midpoint import step as mine\n"
    files = "--json c.json --csv c.csv --picture c.svg"
    result = call(f"compare energy-preserving mine:mine {QUICK} {files}", code)
    assert result.exit_code == 0, result.output
    for word in ("rigid-body", "energy-preserving", "mine:mine", "strong error", "ns/step", "1e-02"):
        assert word in result.output
    document = json.loads((tmp_path / "c.json").read_text())
    assert [m["name"] for m in document["methods"]] == ["energy-preserving", "mine:mine"]
    assert len((tmp_path / "c.csv").read_text().splitlines()) == 5
    assert (tmp_path / "c.svg").read_bytes().startswith(b"<?xml")


def test_a_problem_of_a_file_needs_an_initial_state(call: Callable[..., Result], tmp_path: Path) -> None:
    H, B = [[[2, 0], 0.5], [[0, 4], 0.25]], [[0, 1, [[[0, 0], 1.0]]]]
    (tmp_path / "p.json").write_text(json.dumps({"dimension": 2, "hamiltonian": H, "structure": B}))
    assert call(f"compare euler-heun {QUICK} -p p.json --y 0.5,0.25").exit_code == 0
    refused = call(f"compare euler-heun {QUICK} -p p.json")
    assert refused.exit_code == 2
    assert "initial" in refused.output


def test_an_absent_library_is_named_with_its_remedy(call, monkeypatch):
    def absent(name: str) -> None:
        raise ModuleNotFoundError("No module named 'diffrax'", name="diffrax")

    monkeypatch.setattr("sepv._arguments.import_module", absent)
    result = call("compare diffrax-heun")
    assert result.exit_code == 3
    assert "pip install diffrax" in result.output


def test_it_says_how_far_it_is_from_the_first_method_on(found: Comparison) -> None:
    said: list[tuple[str, float]] = []
    methods = [in_batches(schemes.energy_preserving), exact_time_change()]
    compare(
        methods, problems.rigid_body(), steps=(4, 8), paths=32, repeats=2,
        progress=lambda text, share: said.append((text, share)),
    )  # fmt: skip
    shares = [share for _, share in said]
    assert shares == sorted(shares)
    assert (shares[0], said[0][0]) == (0.0, "energy-preserving, 4 steps")
    assert shares[-1] < 1
    # A first call and an errors' run for each of three cells, and three calls in each of two
    # rounds.
    assert len(said) == 3 + 3 + 6


def test_one_round_has_no_spread_and_the_caption_says_so(found: Comparison) -> None:
    rounds = (found, replace(found, repeats=1))
    several, once = ([c.heading for c in table.point_tables(of)[0].columns] for of in rounds)
    assert "median of 2 rounds ± half the distance of the quartiles" in table.heading(rounds[0])
    assert "±%" in several
    assert table.heading(rounds[1]).endswith("of one round")
    assert "±%" not in once


def test_without_noise_there_is_one_trajectory_with_two_prices() -> None:
    names = ("leapfrog", "yoshida-4", "energy-preserving")
    methods = [from_scheme(schemes.by_name(name), problems.henon_heiles(), "numpy") for name in names]
    quiet = replace(methods[0], name="for c = ()", deterministic=True)
    run = {"steps": (16, 32, 64), "repeats": 1, "targets": (1e-3,), "T": 4.0}
    found = compare([*methods, quiet], problems.henon_heiles(), **run)
    assert found.deterministic
    assert {p.paths for p in found.points} == {1}
    errors = {name: [p.strong.value for p in found.of(name)] for name in names}
    assert 3.5 < errors["leapfrog"][-2] / errors["leapfrog"][-1] < 4.5
    assert 14 < errors["yoshida-4"][-2] / errors["yoshida-4"][-1] < 18
    assert [p.evaluations["gradient"] for p in found.of("yoshida-4")] == [4, 4, 4]
    assert [t.how for t in found.times_to_energy_error()] == ["between", "coarsest", "coarsest", "between"]
    heads = "µs a path to an error at T, and |ΔH| there", "µs a path to |ΔH| up to T, and |ΔH| there"
    assert tuple(t.title for t in table.target_tables(found)) == heads
    obeys(found.to_json(), "comparison")


def test_a_clock_that_does_not_tick_gives_times_of_a_tick(monkeypatch: pytest.MonkeyPatch) -> None:
    """A profiler, or a clock of sixty ticks a second, may count no processor time at all."""
    monkeypatch.setattr("sepv.studies._compare.run.process_time", lambda: 0.0)
    method = from_scheme(schemes.euler_heun, problems.pendulum(), "numpy")
    found = compare([method], problems.pendulum(), steps=[4], paths=32, repeats=1)
    assert all(0 < p.seconds.median < 1e-3 for p in found.points)
    assert len(table.point_tables(found)) > 0
