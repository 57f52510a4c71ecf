"""The compiled engine: the NumPy batch to a few ulp, the same bits however the paths are divided."""

from __future__ import annotations

import math
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor

import numpy as np
import pytest

import sepv
from sepv import problems, schemes, wiener
from sepv.implicit import Status

pytest.importorskip("numba", reason="the extra `fast` is not installed")

EP = schemes.energy_preserving
STEP = {"lotka-volterra": 1 / 128}


def both(scheme, problem, **arguments):
    """The same ensemble by both engines."""
    return (sepv.ensemble(scheme, problem, engine=engine, **arguments) for engine in ("compiled", "numpy"))


def same(a, b) -> bool:
    keys = ("y", "W", "status", "failed_step", "energy_defect", "casimir_defect", "states")
    return (
        all(np.array_equal(getattr(a, key), getattr(b, key)) for key in keys) and a.iterations == b.iterations
    )


@pytest.mark.parametrize("name", problems.NAMED)
def test_both_engines_agree_to_a_few_ulp(name: str) -> None:
    problem = problems.by_name(name)
    h = STEP.get(name, 1 / 32)
    fast, plain = both(EP, problem, h=h, T=0.5, paths=70, seed=3)
    assert (fast.engine, plain.engine) == ("compiled", "numpy")
    assert np.array_equal(fast.W, plain.W)
    assert np.array_equal(fast.status, plain.status)
    # Each of the steps rounds differently by an ulp or two, and the flow spreads that by its condition.
    assert np.max(np.abs(fast.y - plain.y)) < 64 * 8 * 2.3e-16 * np.max(np.abs(plain.y))
    assert fast.energy_defect.max() < 64 * 8 * 2.3e-16
    assert fast.iterations > 70 * 0.5 / h


def test_bits_depend_neither_on_threads_nor_on_chunks() -> None:
    problem, arguments = problems.rigid_body(), {"h": 1 / 64, "T": 1.0, "seed": 2, "engine": "compiled"}
    one = sepv.ensemble(EP, problem, paths=1500, times=[0.25, 1.0], **arguments)
    two = sepv.ensemble(EP, problem, paths=1500, times=[0.25, 1.0], workers=2, **arguments)
    assert same(one, two)
    few = sepv.ensemble(EP, problem, paths=3, **arguments)  # path by path
    assert np.array_equal(few.y, one.y[:, :3])
    assert np.array_equal(one.states[1], one.y)


def test_given_increments_are_the_drawn_ones() -> None:
    problem = problems.rigid_body()
    drawn = sepv.ensemble(EP, problem, h=1 / 64, T=1.0, paths=100, seed=5, engine="compiled")
    dW = wiener.increments(5, T=1.0, steps=64, noises=1, paths=100)
    given = sepv.ensemble(EP, problem, h=1 / 64, T=1.0, dW=dW, engine="compiled")
    assert same(drawn, given)


def test_failed_paths_have_the_status_of_the_plain_engine() -> None:
    problem = problems.lotka_volterra()
    fast, plain = both(EP, problem, h=1 / 8, T=1.0, paths=100, seed=0)
    assert 10 < np.count_nonzero(plain.status) < 70
    # Where no solution is found, how the search ends may depend on rounding; that it fails may not. NumPy's solve
    # approaches a lane that failed once more, by damped steps, which the compiled one does not.
    lost, both_lost = fast.status != Status.CONVERGED, plain.status != Status.CONVERGED
    assert not np.any(both_lost & ~lost)
    assert np.count_nonzero(lost & ~both_lost) <= 3
    same_step = fast.failed_step == plain.failed_step
    assert np.all(same_step[both_lost] | (fast.failed_step < plain.failed_step)[both_lost])
    assert np.mean(same_step) >= 0.95
    assert np.all(np.isfinite(fast.y))


def test_workers_are_any_map_and_the_bits_stay() -> None:
    problem, arguments = problems.rigid_body(), {"h": 1 / 64, "T": 1.0, "paths": 2100, "engine": "compiled"}
    here = sepv.ensemble(EP, problem, **arguments)
    assert same(here, sepv.ensemble(EP, problem, workers=map, **arguments))
    with ThreadPoolExecutor(2) as pool:
        assert same(here, sepv.ensemble(EP, problem, workers=pool.map, **arguments))
    with ProcessPoolExecutor(2) as pool:
        spread = sepv.ensemble(EP, problem, workers=pool.map, **arguments)
        assert spread.repeated == 0
        assert same(here, spread)


def test_what_a_broken_worker_did_not_finish_is_computed_here() -> None:
    problem, arguments = problems.rigid_body(), {"h": 1 / 64, "T": 1.0, "paths": 2100, "engine": "compiled"}
    here = sepv.ensemble(EP, problem, **arguments)

    def second_fails(function, tasks):
        for number, task in enumerate(tasks):
            yield function(task) if number != 1 else (False, "broken")

    def stops(function, tasks):
        yield function(tasks[0])
        raise ConnectionError("the cluster is gone")

    for workers, repeated in ((second_fails, 1), (stops, 2)):
        result = sepv.ensemble(EP, problem, workers=workers, **arguments)
        assert result.repeated == repeated
        assert same(here, result)


def test_what_cannot_be_compiled_is_said() -> None:
    def step(problem, y, h, dW):
        return y

    own = sepv.Scheme("energy-preserving", step, batched=True)
    result = sepv.ensemble(own, problems.rigid_body(), h=0.5, T=1.0, paths=2)
    assert result.engine == "numpy"
    assert "no code for the scheme" in result.reason
    with pytest.raises(sepv.UsageError, match="no code for the scheme"):
        sepv.ensemble(own, problems.rigid_body(), h=0.5, T=1.0, paths=2, engine="compiled")


def test_compensated_summation_keeps_the_energy_better() -> None:
    problem = problems.rigid_body()
    arguments = {"h": 0.01, "steps": 4000, "paths": 64, "seed": 1}
    plain = sepv.ensemble(EP, problem, engine="compiled", **arguments)
    kept = sepv.ensemble(EP, problem, engine="compiled", compensated=True, **arguments)
    assert np.sqrt(np.mean(kept.energy_defect**2)) < 0.25 * np.sqrt(np.mean(plain.energy_defect**2))
    assert math.isfinite(kept.energy_defect.max())
