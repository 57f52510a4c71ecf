"""Compiled code: its names and caches, the same bits on any workers,
and patches of other packages that are needed.
"""

import gc
import subprocess
import sys
import weakref
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from doors import python
from drawn import EP, backwards, same
from hypothesis.internal.conjecture import providers
from llvmlite import ir

import sepv
from sepv import problems, schemes
from sepv._patches import add_attribute, without_local_constants
from sepv.simulate._compiled.block_run import CompiledChunk
from sepv.simulate._ensembles.task import Task

pytest.importorskip("numba", reason="the extra `fast` is not installed")


def test_any_constant_that_reaches_compiled_code_changes_its_name(monkeypatch) -> None:
    from sepv.simulate._compiled import store

    text = Path(store.__file__).with_name("lanes.py").read_text(encoding="utf-8")
    name, changed = store.name_of(text), set()
    for module in store.linked(text):
        for key, value in list(vars(module).items()):
            if key[:2] != "__" and type(value) in (int, float, bool, np.int64, np.ndarray):
                other = value + np.ones_like(value) if isinstance(value, np.ndarray) else value + 1
                with monkeypatch.context() as patch:
                    patch.setattr(module, key, other)
                    assert store.name_of(text) != name, (module.__name__, key)
                changed.add(key)
    assert {"MIXING", "STREAMS", "_PART_1"} <= changed
    assert store.name_of(text) == name
    for place, value in (
        ("numba.__version__", "0"), ("llvmlite.__version__", "0"),
        ("llvmlite.binding.get_host_cpu_name", lambda: "another"),
    ):  # fmt: skip
        with monkeypatch.context() as patch:
            patch.setattr(place, value)
            store._machine.cache_clear()
            assert store.name_of(text) != name
    store._machine.cache_clear()


def test_workers_are_any_map_and_the_bits_stay() -> None:
    problem, arguments = problems.rigid_body(), {"h": 1 / 64, "T": 1.0, "paths": 2100, "chunk": 1024}
    here = sepv.ensemble(EP, problem, **arguments)
    with ThreadPoolExecutor(2) as threads, ProcessPoolExecutor(2) as processes:
        for workers in (map, backwards, threads.map, processes.map):
            there = sepv.ensemble(EP, problem, workers=workers, **arguments)
            assert there.repeated == 0
            assert same(here, there)


@dataclass
class Step:
    """Equality without a hash, as dataclasses have it."""

    share: float

    def __call__(self, problem, y, h, dW):
        return y + self.share * h * problem.structure(y) @ problem.gradient(y)


def test_what_cannot_be_compiled_is_said() -> None:
    own, run = sepv.Scheme("energy-preserving", Step(1.0)), {"h": 0.5, "T": 1.0, "paths": 2}
    result = sepv.ensemble(own, problems.rigid_body(), **run)
    assert result.engine == "numpy"
    assert "no code for the scheme" in result.reason
    with pytest.raises(sepv.UsageError, match="no code for the scheme"):
        sepv.ensemble(own, problems.rigid_body(), engine="compiled", **run)
    undefined = sepv.ensemble(schemes.several_structures, problems.commuting_oscillators(), **run)
    assert "undefined at critical points" in undefined.reason  # S_j of several Hamiltonians is none there


def test_what_is_raised_while_a_lane_is_solved_is_raised_when_the_compiled_loop_is_back(monkeypatch) -> None:
    from sepv.core import equations

    arguments = {"h": 0.1, "steps": 40, "engine": "compiled", "truncation": None, "seed": 2}
    whole = sepv.long_path(EP, "lotka-volterra", **arguments)
    assert whole.failed_step > 0
    approach, asked = equations.approach, []

    def interrupted(*given):
        asked.append(given)
        if len(asked) == 1:
            raise KeyboardInterrupt
        return approach(*given)

    monkeypatch.setattr(equations, "approach", interrupted)
    path = sepv.long_path(EP, "lotka-volterra", **arguments)
    assert path.interrupted
    assert len(asked) > 1
    # The step was made all the same, so that the path is at the end of a piece.
    assert (path.failed_step, path.status, path.t) == (whole.failed_step, whole.status, whole.t)
    assert np.array_equal(path.y, whole.y)
    asked.clear()
    with pytest.raises(sepv.errors.Interrupted):
        sepv.ensemble(EP, "lotka-volterra", paths=20, **arguments)

    def broken(*given):
        raise ArithmeticError("no such thing")

    monkeypatch.setattr(equations, "approach", broken)
    with pytest.raises(sepv.errors.ChunkFailure, match="no such thing"):
        sepv.ensemble(EP, "lotka-volterra", paths=20, **arguments)


def test_what_a_broken_worker_did_not_finish_is_computed_here() -> None:
    problem, arguments = problems.rigid_body(), {"h": 1 / 64, "T": 1.0, "paths": 2100, "chunk": 1024}
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


def test_compiled_code_that_was_cut_off_is_compiled_again(tmp_path, monkeypatch) -> None:
    from sepv.simulate._compiled import store

    monkeypatch.setenv("SEPV_CACHE_DIR", str(tmp_path))
    text = (
        "from numba import njit\n\n\n@njit('float64(float64)', cache=True)\ndef twice(x):\n    return 2 * x\n"
    )
    store._loaded.__wrapped__(text)
    (compiled,) = tmp_path.glob("engine/__pycache__/*.nbc")
    compiled.write_bytes(compiled.read_bytes()[:50])
    assert store._loaded.__wrapped__(text).twice(1.5) == 3.0


def test_threads_that_ask_for_one_module_wait_for_the_whole_of_it(tmp_path, monkeypatch) -> None:
    from sepv.simulate._compiled import store

    monkeypatch.setenv("SEPV_CACHE_DIR", str(tmp_path))
    inner = store.name_of(text := "import time\n\ntime.sleep(0.2)\nANSWER = 42\n")

    def ask(_: int) -> object:
        store.load(text)
        return store.load(f"from {inner} import ANSWER\n")

    with ThreadPoolExecutor(4) as threads:
        modules = list(threads.map(ask, range(4)))
    assert all(module is modules[0] and module.ANSWER == 42 for module in modules)


def test_the_first_ensemble_leaves_the_import_of_blas_to_code_that_calls_it() -> None:
    code = """if True:
        import sys, numpy as np, sepv
        problem = sepv.problems.rigid_body()
        sepv.ensemble(sepv.schemes.energy_preserving, problem, h=0.01, steps=1, paths=1, engine="compiled")
        assert "scipy.linalg" not in sys.modules
        from numba import njit
        A = np.eye(3) + 1.0
        assert (njit(lambda A, b: A @ b)(A, A[0]) == A @ A[0]).all()
        assert "scipy.linalg" in sys.modules
    """
    subprocess.run([sys.executable, "-c", code], check=True)


def test_a_chunk_is_gone_when_nobody_has_it() -> None:
    """Its arrays are some megabytes, which would otherwise wait for the garbage collector."""
    problem = problems.rigid_body()
    task = Task(EP, problem, np.array(problem.initial), 0.01, 4, 0, 200, 0, None, 2, (), False, True, None)
    chunk = CompiledChunk(task, problem)
    chunk.advance(4)
    known = weakref.ref(chunk)
    gc.disable()
    try:
        del chunk
        assert known() is None
    finally:
        gc.enable()


def test_the_fingerprint_tells_schemes_problems_starts_and_steps_apart() -> None:
    body, other = problems.rigid_body(), problems.rigid_body(inertia=(1.0, 2.0, 4.0))
    asked = {
        "as it is": (EP, body, 0.01, None), "scheme": (schemes.by_name("gauss-2"), body, 0.01, None),
        "problem": (EP, other, 0.01, None), "h": (EP, body, 0.02, None), "y0": (EP, body, 0.01, [0.6, 0.8, 0.0]),
    }  # fmt: skip

    def fingerprint(key: str, engine: str) -> str:
        scheme, problem, h, y0 = asked[key]
        ends = sepv.ensemble(scheme, problem, h=h, steps=2, paths=20, y0=y0, engine=engine)
        return ends.about["fingerprint"]

    found = {key: fingerprint(key, "compiled") for key in asked}
    assert len(set(found.values())) == len(asked)
    assert found == {key: fingerprint(key, "compiled") for key in asked}
    assert found == {key: fingerprint(key, "numpy") for key in asked}


WIDTH = '"prefer-vector-width"="512"'


def test_numba_imports_scipy_linalg_for_a_question_and_the_patch_puts_that_off(tmp_path: Path) -> None:
    say = "import sys, numba.np.arraymath; print('scipy.linalg' in sys.modules)"
    assert python(say, folder=tmp_path) == "True"
    patched = f"from sepv._patches import put_off_blas; put_off_blas(); {say}"
    assert python(patched, folder=tmp_path) == "False"


def test_llvmlite_refuses_an_attribute_that_llvm_knows_and_the_patch_adds_it() -> None:
    function = ir.Function(ir.Module(), ir.FunctionType(ir.VoidType(), ()), "f")
    with pytest.raises(ValueError, match="unknown attr"):
        function.attributes.add(WIDTH)
    add_attribute(function.attributes, WIDTH)
    assert WIDTH in str(function)


def test_hypothesis_reads_constants_of_loaded_modules_and_the_patch_hides_them(tmp_path: Path) -> None:
    (tmp_path / "full_of_constants.py").write_text("SEEN = [0.123, 4.5, 6.75e3]\n")
    say = "from hypothesis.internal.conjecture import providers as p; print(0.123 in p._get_local_constants().floats)"
    assert python(f"import full_of_constants; {say}", folder=tmp_path) == "True"
    before = providers._get_local_constants
    with without_local_constants():
        assert providers._get_local_constants() == providers.Constants()
    assert providers._get_local_constants is before
