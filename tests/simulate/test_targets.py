"""Targets of ensembles: what a card's kernel computes, on the processor;
and how another target is added.
"""

import functools
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from drawn import EP, both, same

import sepv
from sepv import problems, schemes
from sepv.record import EPS
from sepv.schemes import PointLaw
from sepv.simulate import increments
from sepv.simulate._batch import AXES
from sepv.simulate._ensembles.collectors import Reducing
from sepv.simulate._ensembles.task import NumpyChunk, Task
from sepv.simulate._results.reductions import summary
from sepv.simulate._results.sketch import Sketch, sketch
from sepv.simulate.targets import _numba as numba_target
from sepv.simulate.targets import registry
from sepv.simulate.targets._target import CannotCompile, Target
from sepv.simulate.targets.cuda import chunk, devices, text

HOST = "cuda-on-host"
on_host = pytest.mark.skipif(
    devices.compiler() is None, reason="no C compiler: the text of a card's kernel cannot run here"
)


def task(problem: sepv.Problem, steps: int, paths: int, first: int = 0, refine: int | None = None) -> Task:
    return Task(
        scheme=schemes.by_name("euler-heun"), problem=problem, y0=np.full(problem.dimension, 0.3), h=1e-3, steps=steps,
        first=first, count=paths, seed=5, refine=refine, truncation=2, stops=(), compensated=False, engine=HOST,
    )  # fmt: skip


# Grids whose coarse part is drawn at once, or by stream 0 in the order of time; with 0 to 11 levels
# of their own.
GRIDS = [(1, None), (6, None), (7, None), (100, None), (128, None), (130, None), (1024, 3), (4096, None),
         (65 * 64, None), (96, 0), (67 * 2048, None)]  # fmt: skip


@pytest.mark.quick
@on_host
@pytest.mark.parametrize(("steps", "refine"), GRIDS)
def test_increments_have_the_bits_of_numpy(steps: int, refine: int | None) -> None:
    """SFC64, the ziggurat and Lévy's construction, in blocks of a power of two,
    read from any step on.
    """
    for name in ("rigid-body", "pendulum"):
        problem, paths = problems.by_name(name), 5 if steps < 5000 else 1
        wanted = increments(
            5, T=1e-3 * steps, steps=steps, noises=problem.noises, paths=range(7, 7 + paths), refine=refine
        )
        for length in (16, 64):
            drawn, n = (
                chunk.Drawn(task(problem, steps, paths, 7, refine), devices.host(), problem.noises, length),
                0,
            )
            while n < steps:
                count = min(11, steps - n, length - n % length)
                assert np.array_equal(drawn.block(n, count)[:count], wanted[n : n + count]), f"step {n}"
                n += count


@pytest.mark.quick
@on_host
def test_many_normals_have_the_bits_of_numpy() -> None:
    """Of 400,000 normals some 100 come from the tail, and 6,000 from the ziggurat's wedges."""
    problem = problems.rigid_body()
    own = chunk.CudaChunk(task(problem, 100, 4000), problem, devices.host())
    wanted = increments(5, T=0.1, steps=100, noises=1, paths=4000)
    assert np.abs(wanted).max() > 3.66 * np.sqrt(1e-3)
    assert np.array_equal(
        np.concatenate([own.increments.block(n, 64)[: 100 - n].copy() for n in (0, 64)])[:100], wanted
    )


@pytest.mark.quick
@pytest.mark.filterwarnings("ignore:Truncation k = 1 costs")
@on_host
@pytest.mark.parametrize(
    "changes",
    [
        {"times": (0.25, 1.0)}, {"compensated": True}, {"truncation": None}, {"truncation": 1}, {"refine": 2},
        {"increments": "three-point"}, {"increments": PointLaw("own", (-1.5, 0.0, 1.5), (2 / 9, 5 / 9, 2 / 9))},
        {"chunk": 7},
        {"dW": increments(3, T=1.0, steps=32, noises=2, paths=40), "paths": None}, {"workers": 2, "chunk": 16},
    ],
    ids=lambda changes: next(iter(changes)),
)  # fmt: skip
def test_every_argument_means_the_same(changes: dict[str, Any]) -> None:
    arguments = {"h": 1 / 32, "T": 1.0, "paths": 40, "seed": 2} | changes
    if changes.get("dW") is not None:
        del arguments["T"], arguments["paths"]
        arguments["steps"] = 32
    card, plain = both(EP, problems.pendulum(), HOST, **arguments)
    assert (card.engine, card.y.shape, card.states.shape) == (HOST, plain.y.shape, plain.states.shape)
    assert np.array_equal(card.W, plain.W)
    assert not card.status.any()
    for a, b in ((card.y, plain.y), (card.states, plain.states)):
        assert np.max(np.abs(a - b), initial=0.0) <= 32 * 32 * EPS
    assert card.energy_defect.max() <= 3 * plain.energy_defect.max() + 8 * 32**0.5 * EPS


@pytest.mark.quick
@on_host
def test_steps_that_a_kernel_leaves_over_are_the_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    """With no iteration allowed each step waits for the core, and each path catches up from each:
    the bits are NumPy's.

    With three some steps are left, and paths wait at different steps of a block.
    """
    arguments = {"h": 1 / 32, "T": 1.0, "paths": 30, "times": (0.5, 1.0), "compensated": True}
    for iterations in (0, 3):
        monkeypatch.setattr(text, "STRAIGHT_MAXITER", iterations)
        text.kernel_text.cache_clear()
        card, plain = both(EP, problems.pendulum(), HOST, **arguments)
        assert np.array_equal(card.W, plain.W)
        assert not card.status.any()
        assert np.all(card.failed_step == -1)
        assert np.max(np.abs(card.states - plain.states)) <= (0.0 if iterations == 0 else 32 * 32 * EPS)
        assert iterations or card.iterations == plain.iterations
    text.kernel_text.cache_clear()


@on_host
def test_statuses_are_those_of_numpy() -> None:
    """Beyond the fold some paths end; their state, W and the number of the step are kept.

    There Newton's iteration is chaotic, and a last bit may decide which of several solutions it
    finds: in 11 of 1800 paths with six seeds, as in 10 of the compiled engine's. Each was a
    solution, to a residual of 1e-14.
    """
    arguments = {"h": 1 / 8, "T": 1.0, "paths": 300, "seed": 1}
    card, plain = both(EP, problems.lotka_volterra(), HOST, **arguments)
    assert 0 < np.count_nonzero(plain.status) < 300
    alike = (card.status == plain.status) & (card.failed_step == plain.failed_step)
    assert np.count_nonzero(~alike) <= 2  # next to a fold a last bit decides
    assert np.count_nonzero(np.abs(card.y - plain.y).max(axis=0)[alike] > 1e-12) <= 4
    assert card.energy_defect[card.status == 0].max() <= 1e-13
    assert np.array_equal(card.W, plain.W)
    explicit = list(both(schemes.euler_heun, problems.lotka_volterra(), HOST, h=0.9, T=9.0, paths=50))
    assert explicit[0].status.any()
    assert np.array_equal(explicit[0].status, explicit[1].status)
    assert np.array_equal(explicit[0].failed_step, explicit[1].failed_step)


@on_host
def test_more_unknowns_than_are_written_out_are_eliminated_in_loops() -> None:
    for d in (5, 9, 16):
        A = np.triu(np.fromfunction(lambda i, j: 1 / (1 + i + 2 * j), (d, d)), 1)
        problem = sepv.Problem(
            dimension=d, structure=lambda y, J=A - A.T: J, hamiltonian=lambda y: 0.5 * np.sum(y * y) + 0.1 * y[0] ** 4,
            noise=(0.3,), initial=tuple(0.5 / (1 + k) for k in range(d)), name=f"chain of {d}",
        )  # fmt: skip
        card, plain = both(EP, problem, HOST, h=1 / 16, T=0.5, paths=9)
        assert not card.status.any()
        assert np.max(np.abs(card.y - plain.y)) <= 8 * 64 * EPS


@on_host
def test_reduced_and_stored_ensembles_are_those_of_the_paths(tmp_path: Path) -> None:
    pytest.importorskip("zarr", reason="the extra `store` is not installed")
    arguments = {"h": 1 / 32, "T": 1.0, "paths": 5000, "engine": HOST, "chunk": 2048}
    functionals = {"q": lambda ends: ends.y[0], "loss": lambda ends: ends.energy_defect}
    whole = sepv.ensemble(EP, "pendulum", **arguments)
    reduced = sepv.ensemble(EP, "pendulum", reduce=functionals, **arguments)
    assert reduced.y.shape == (2, 0)
    assert reduced.reduced["q"].count == 5000
    assert reduced.reduced["q"].mean == pytest.approx(whole.y[0].mean(), rel=1e-13)
    assert reduced.iterations == whole.iterations
    stored = sepv.ensemble(EP, "pendulum", store=tmp_path / "paths", **arguments)
    assert same(whole, stored)
    early = sepv.ensemble(EP, "pendulum", reduce=functionals, until={"q": 1.0}, **arguments)
    assert early.reduced["q"].count == 2048


class Elsewhere(np.lib.mixins.NDArrayOperatorsMixin):
    """An array with NumPy's interface that is not converted silently, as CuPy's arrays are not."""

    def __init__(self, array: Any) -> None:
        self.inner = np.asarray(array)

    shape, dtype, size = (
        property(lambda self, key=key: getattr(self.inner, key)) for key in ("shape", "dtype", "size")
    )

    def __array__(self, *_: Any, **__: Any) -> Any:
        raise TypeError("Implicit conversion to a NumPy array is not allowed")

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **more: Any) -> Any:
        return Elsewhere(getattr(ufunc, method)(*map(inside, inputs), **more))

    def __array_function__(self, function: Any, _types: Any, arguments: Any, more: Any) -> Any:
        found = function(*[inside(a) for a in arguments], **more)
        return tuple(map(Elsewhere, found)) if isinstance(found, tuple) else Elsewhere(found)

    def __getitem__(self, key: Any) -> Any:
        return Elsewhere(self.inner[tuple(map(inside, key)) if isinstance(key, tuple) else inside(key)])

    def __float__(self) -> float:
        return float(self.inner)

    def __int__(self) -> int:
        return int(self.inner)

    def astype(self, kind: Any) -> Any:
        return Elsewhere(self.inner.astype(kind))

    def min(self) -> Any:
        return Elsewhere(self.inner.min())

    def max(self) -> Any:
        return Elsewhere(self.inner.max())

    def get(self) -> Any:
        return self.inner


def inside(value: Any) -> Any:
    return value.inner if isinstance(value, Elsewhere) else value


@pytest.mark.quick
def test_a_summary_of_another_librarys_array_is_that_of_numpys() -> None:
    values, status = np.random.default_rng(1).standard_normal(999), np.arange(999) % 50 // 49
    values[[3, 98]] = np.inf
    plain, other = summary(values, status), summary(Elsewhere(values), Elsewhere(status))
    for key in ("count", "mean", "sums", "minimum", "maximum", "failed", "not_finite"):
        assert getattr(plain, key) == getattr(other, key)
    assert np.array_equal(plain.sketch.counts, other.sketch.counts)
    assert (type(other.mean), type(other.sketch.keys)) == (float, np.ndarray)


@pytest.mark.quick
def test_a_sketch_counts_many_keys_as_it_counts_few() -> None:
    values = np.random.default_rng(2).lognormal(size=50_000)
    parts = [sketch(values[n : n + 100]) for n in range(0, 50_000, 100)]  # sorted
    merged, whole = functools.reduce(Sketch.merge, parts), sketch(values)  # by a table
    assert np.array_equal(merged.keys, whole.keys)
    assert np.array_equal(merged.counts, whole.counts)
    assert whole.counts.sum() == 50_000


@pytest.mark.quick
def test_a_functional_that_takes_no_array_of_a_card_runs_on_the_host_and_a_note_says_so(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    class There(NumpyChunk):
        def result(self, kept: Any) -> Any:
            ends = super().result(kept)
            return replace(ends, **{key: Elsewhere(getattr(ends, key)) for key in AXES})

    monkeypatch.setitem(registry.TARGETS, "there", replace(registry.NUMPY, name="there", chunk=There))
    functionals = {"q": lambda ends: ends.y[0], "p": lambda ends: np.asarray(ends.y[1])}
    ends = sepv.ensemble(EP, "pendulum", h=1 / 8, T=1.0, paths=50, engine="there", reduce=functionals)
    plain = sepv.ensemble(EP, "pendulum", h=1 / 8, T=1.0, paths=50, engine="numpy", reduce=functionals)
    assert re.search(
        r"'p' ran on the host \(TypeError: Implicit.*took .* s of the .* s of a chunk", ends.reason
    )
    assert ends.reduced["q"].mean == plain.reduced["q"].mean
    assert ends.reduced["p"].mean == plain.reduced["p"].mean
    assert Reducing({"q": functionals["q"]}, keep=True)(
        replace(task(problems.pendulum(), 2, 3), engine="there")
    )[0].y.shape == (2, 3)


@pytest.mark.quick
def test_a_target_is_added_in_one_file(monkeypatch: pytest.MonkeyPatch) -> None:
    """A toy: one step of the scheme for one path after the other. It takes no compensated sums,
    and auto skips it.
    """

    class Toy:
        def __init__(self, task: Task, problem: sepv.Problem) -> None:
            self.task, self.done, self.inner = task, 0, NumpyChunk(task, problem)
            self.paths = [
                NumpyChunk(replace(task, first=task.first + k, count=1), problem) for k in range(task.count)
            ]

        def advance(self, steps: int) -> None:
            for path in self.paths:
                path.advance(steps)
            self.done += steps

        def failed(self) -> bool:
            return all(path.failed() for path in self.paths)

        def states(self) -> Any:
            return np.concatenate([path.states() for path in self.paths], axis=1)

        def result(self, kept: Any) -> Any:
            parts = [path.result(kept[..., :1]) for path in self.paths]
            arrays = {key: np.concatenate([getattr(p, key) for p in parts], axis=-1) for key in AXES}
            return replace(parts[0], **arrays | {"states": kept}, iterations=sum(p.iterations for p in parts))

    def prepare(_scheme: Any, _problem: Any, _paths: int, compensated: bool, _here: bool) -> None:
        if compensated:
            raise CannotCompile("a toy loses the roundings of its sums")

    toy = Target(
        "toy", prepare, Toy, lambda *_: 3, piece=64, threads=True, recorded=False, packages=("numpy",)
    )
    monkeypatch.setitem(registry.TARGETS, "toy", toy)
    arguments = {"h": 1 / 16, "T": 0.5, "paths": 8, "times": (0.25,)}
    ends, plain = both(EP, problems.rigid_body(), "toy", **arguments)
    assert (ends.engine, plain.engine) == ("toy", "numpy")
    assert same(ends, plain)
    with pytest.raises(sepv.UsageError, match="a toy loses the roundings"):
        sepv.ensemble(EP, "rigid-body", engine="toy", compensated=True, **arguments)


@pytest.mark.quick
def test_what_a_machine_lacks_for_a_card_is_one_clear_error(monkeypatch: pytest.MonkeyPatch) -> None:
    devices.card.cache_clear()
    monkeypatch.setattr(devices, "find_spec", lambda _name: None)
    with pytest.raises(sepv.UsageError, match=r"Expected CuPy(.|\n)*sepv\[cuda\]"):
        sepv.ensemble(EP, "rigid-body", h=0.1, T=1.0, paths=9, engine="cuda")
    monkeypatch.setattr(devices, "find_spec", lambda _name: object())

    def no_driver() -> Any:
        raise RuntimeError("cudaErrorInsufficientDriver")

    monkeypatch.setattr(devices, "Card", no_driver)
    with pytest.raises(sepv.UsageError, match=r"a card of NVIDIA(.|\n)*InsufficientDriver(.|\n)*nvidia-smi"):
        sepv.ensemble(EP, "rigid-body", h=0.1, T=1.0, paths=9, engine="cuda")
    with pytest.raises(sepv.UsageError, match="a card runs many paths"):
        sepv.long_path(EP, "rigid-body", h=0.1, steps=9, engine="cuda")


@pytest.mark.quick
def test_what_a_card_cannot_run_is_refused_with_the_reason() -> None:
    for scheme, problem in (
        (sepv.Scheme("own", lambda p, y, h, dW: y), "rigid-body"),
        (EP, "random-inertia"),
    ):
        with pytest.raises(sepv.UsageError, match="engine='cuda-on-host' takes"):
            sepv.ensemble(scheme, problem, h=0.1, T=1.0, paths=9, engine=HOST)


@on_host
@pytest.mark.deep
@pytest.mark.parametrize(
    "problem", sorted(problems.PAPER | problems.EXTENSIONS | problems.SEVERAL | problems.HAMILTONIANS)
)
def test_every_scheme_and_problem_agrees_with_numpy(problem: str) -> None:
    """All that the text takes; eight steps of a hundredth of the problem's own reach."""
    system = problems.by_name(problem)
    families = [f"{family}-{s}" for family in schemes.FAMILIES for s in range(1, schemes.MAX_STAGES + 1)]
    for name in [*schemes.PAPER, *schemes.EXTENSIONS, *schemes.HAMILTONIANS, *families]:
        scheme = schemes.by_name(name)
        try:
            text.kernel_text(scheme, system, False)
        except CannotCompile:
            continue
        y0 = (
            {}
            if system.initial is not None
            else {"y0": tuple(0.3 / (1 + k) for k in range(system.dimension))}
        )
        card, plain = both(scheme, system, HOST, h=2.0**-7, steps=8, paths=20, **y0)
        assert np.array_equal(card.status, plain.status), name
        assert np.array_equal(card.W, plain.W), name
        solved = plain.status == 0
        bound = 64 * 8 * EPS * np.max(np.abs(plain.y), initial=1.0)
        assert np.max(np.abs(card.y - plain.y)[:, solved], initial=0.0) <= bound, name


@pytest.mark.parametrize("workers", [2, 3])
def test_each_thread_has_a_few_chunks_of_an_ensemble(workers: int) -> None:
    """One alone has as few as memory allows, because nothing is gained by more."""
    whole = task(problems.pendulum(), 2**13, 4096)
    chunks = -(-whole.count // numba_target._size(whole, workers, False))
    assert workers < chunks <= numba_target.CHUNKS_PER_WORKER * workers
    assert numba_target._size(whole, 1, False) == whole.count
