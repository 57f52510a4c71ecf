"""Ends on disk: the bits of memory, resumed after a crash, and never written over."""

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from drawn import EP, PENDULUM, position, same

import sepv
from sepv import problems, schemes
from sepv.simulate._batch import AXES
from sepv.simulate._results.code_hash import code_of

pytest.importorskip("zarr")

SMALL: dict[str, Any] = {"h": 1 / 16, "T": 0.5, "paths": 1000, "chunk": 256, "seed": 5, "times": [0.25, 0.5]}


class Counted:
    """A map that counts its tasks."""

    def __init__(self) -> None:
        self.tasks = 0

    def __call__(self, function: Any, tasks: Any) -> Any:
        self.tasks += len(tasks)
        return map(function, tasks)


def computed(place: Path, **more: Any) -> tuple[int, Any]:
    """How many chunks were computed, and the ensemble."""
    counted = Counted()
    found = sepv.ensemble(EP, PENDULUM, store=place, workers=counted, **SMALL | more)
    return counted.tasks, found


def test_what_is_on_disk_has_the_bits_of_memory(tmp_path: Path) -> None:
    whole = sepv.ensemble(EP, PENDULUM, **SMALL)
    for workers in (1, 2):
        there = sepv.ensemble(EP, PENDULUM, store=tmp_path / f"{workers}.zarr", workers=workers, **SMALL)
        assert same(whole, there)
        assert type(there.y).__module__.startswith("zarr")


@pytest.mark.parametrize(
    ("file", "harm"),
    [
        ("y/c/0/2", lambda p: p.write_bytes(p.read_bytes()[:100])),
        ("states/c/0/0/2", lambda p: p.write_bytes(bytes(len(p.read_bytes())))),
        ("W/c/0/2", lambda p: p.write_bytes(bytes([p.read_bytes()[0] ^ 1]) + p.read_bytes()[1:])),
        ("status/c/2", lambda p: p.write_bytes(b"")),
        ("work/c/2/0", lambda p: p.unlink()),
    ],
)
def test_a_torn_chunk_is_computed_again(tmp_path: Path, file: str, harm: Any) -> None:
    place = tmp_path / "paths.zarr"
    whole = computed(place)[1]
    kept = [getattr(whole, key)[...] for key in AXES]
    assert (place / file).is_file(), sorted(str(p.relative_to(place)) for p in place.rglob("*"))
    harm(place / file)
    count, again = computed(place)
    assert count == 1
    assert all(np.array_equal(getattr(again, key)[...], old) for key, old in zip(AXES, kept, strict=True))


CRASH = """
import os, signal, sys
import sepv
def die(done, paths):
    if done >= 512: os.kill(os.getpid(), signal.SIGKILL)
sepv.ensemble(sepv.schemes.energy_preserving, sepv.problems.pendulum(), h=1/16, T=0.5, paths=1000, chunk=256,
              seed=5, times=[0.25, 0.5], store=sys.argv[1], progress=die)
"""


def test_a_run_that_was_killed_is_resumed(tmp_path: Path) -> None:
    place = tmp_path / "paths.zarr"
    killed = subprocess.run([sys.executable, "-c", CRASH, str(place)], timeout=120, check=False)
    assert killed.returncode == -9
    count, again = computed(place)
    assert count == 2
    assert same(again, sepv.ensemble(EP, PENDULUM, **SMALL))


def test_reductions_of_a_resumed_store_have_the_same_bits(tmp_path: Path) -> None:
    place, functionals = tmp_path / "paths.zarr", {"q": position}
    whole = sepv.ensemble(EP, PENDULUM, reduce=functionals, **SMALL).reduced["q"]
    computed(place)
    (place / "y/c/0/1").unlink()
    count, again = computed(place, reduce=functionals)
    assert count == 1
    assert (again.reduced["q"].mean, again.reduced["q"].sums) == (whole.mean, whole.sums)
    assert same(again, sepv.ensemble(EP, PENDULUM, **SMALL))


def test_a_store_can_stop_at_an_error_and_go_on_later(tmp_path: Path) -> None:
    place, more = tmp_path / "paths.zarr", {"paths": 10_000, "reduce": {"q": position}}
    reached = computed(place, until={"q": 0.02}, **more)[1].reduced["q"]
    assert 1024 <= reached.count < 9_000
    assert computed(place, until={"q": 0.02}, **more)[0] == 0
    assert computed(place, **more)[1].reduced["q"].count == 10_000


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({"seed": 6}, "seed is 5 there and 6 here"),
        (
            {"h": 1 / 32},
            "h is 0.0625 there and 0.03125 here (and steps, steps from drawn states, fingerprint)",
        ),
        ({"chunk": 128}, "chunk is 256 there and 128 here"),
        ({"paths": 1001}, "paths is 1000 there"),
        ({"y0": [0.5, 0.5]}, "y0 is"),
    ],
)
def test_other_paths_are_not_written_over_these(tmp_path: Path, more: dict[str, Any], words: str) -> None:
    place = tmp_path / "paths.zarr"
    sepv.ensemble(EP, PENDULUM, store=place, **SMALL | {"times": None})
    with pytest.raises(sepv.UsageError, match=re.escape(words)):
        sepv.ensemble(EP, PENDULUM, store=place, **SMALL | {"times": None} | more)


def test_another_scheme_or_problem_of_the_same_name_is_seen(tmp_path: Path) -> None:
    def step(problem: Any, y: Any, h: float, dW: Any) -> Any:
        return schemes.midpoint.step(problem, y, h, dW)

    place = tmp_path / "paths.zarr"
    sepv.ensemble(EP, PENDULUM, store=place, engine="numpy", **SMALL)
    other = sepv.Scheme(EP.name, step, batched=True, truncation=EP.truncation)
    with pytest.raises(sepv.UsageError, match="made by other code"):
        sepv.ensemble(other, PENDULUM, store=place, engine="numpy", **SMALL)


STEP = """
import numpy as np
LIMIT = {limit}
def shift(y):
    return np.where(np.abs(y) > LIMIT, 1e-3, 0.0)
def step(problem, y, h, dW):
    {body}
    delta = problem.random_step(h, dW)
    return y + delta * np.einsum("ij...,j...->i...", problem.structure(y), problem.gradient(y)) + shift(y)
"""


def _own(limit: float = 50.0, body: str = "pass") -> Any:
    """A scheme of a user's module; what it does far from y0 depends on a constant that another
    function names.
    """
    space: dict[str, Any] = {"__name__": "own"}
    exec(STEP.format(limit=limit, body=body), space)
    return sepv.Scheme("own", space["step"])


@pytest.mark.parametrize(("changed", "words"), [
    ({"limit": 60.0}, "made by other code .own.shift: "),
    ({"body": "h = h if np.all(abs(y) < 70.0) else 2 * h"}, "made by other code .own.step: "),
])  # fmt: skip
def test_a_scheme_that_changed_far_from_y0_does_not_continue_a_store(tmp_path: Path, changed, words) -> None:
    """101 of 512 paths were the old scheme's: the steps at y0 and near it are the same."""
    place = tmp_path / "paths.zarr"
    before = _own()
    sepv.ensemble(before, PENDULUM, store=place, **SMALL)
    again = sepv.ensemble(_own(), PENDULUM, store=place, **SMALL)  # the same code, loaded anew
    assert again.y.shape == (2, 1000)
    with pytest.raises(sepv.UsageError, match=words):
        sepv.ensemble(_own(**changed), PENDULUM, store=place, **SMALL)


def test_caches_and_work_arrays_of_a_scheme_are_not_its_code() -> None:
    """A store must be continued after they have changed, and in another process,
    where sets have other orders.
    """
    work, cache = np.zeros(3), dict[int, int]()

    def step(problem: Any, y: Any, h: float, dW: Any) -> Any:
        cache[len(cache)] = 1
        work[:] = y[0] if str(h) in {"a", "b", "c"} else 0.0
        return y

    before = code_of(step)
    step(None, np.ones(3), 0.1, None)
    assert code_of(step) == before


def test_libraries_and_programs_are_known_by_their_bytes(tmp_path: Path) -> None:
    program = tmp_path / "program"
    program.write_bytes(b"one")

    class Program:
        argv = (str(program), "--fast")

    first = code_of(Program())
    program.write_bytes(b"two")
    assert code_of(Program()) != first


def test_a_refusal_names_the_versions_that_differ(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    place = tmp_path / "paths.zarr"
    sepv.ensemble(EP, PENDULUM, store=place, **SMALL)
    monkeypatch.setattr("platform.python_version", lambda: "3.99.0")
    with pytest.raises(sepv.UsageError, match=r"made by other versions \(python: .* there and 3.99.0 here\)"):
        sepv.ensemble(EP, PENDULUM, store=place, **SMALL)


def test_what_sepv_did_not_write_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine/thesis.txt").write_text("years of work")
    with pytest.raises(sepv.UsageError, match="it is no Zarr group"):
        sepv.ensemble(EP, PENDULUM, store=tmp_path / "mine", **SMALL)
    assert (tmp_path / "mine/thesis.txt").read_text() == "years of work"
    import zarr

    zarr.create_group(str(tmp_path / "other.zarr"))
    with pytest.raises(sepv.UsageError, match="not written by sepv"):
        sepv.ensemble(EP, PENDULUM, store=str(tmp_path / "other.zarr"), **SMALL)


def _entry(key: str, value: Any) -> Any:
    """Change, or take away, an entry of a description of an array."""

    def harm(file: Path) -> None:
        described = json.loads(file.read_text())
        described.pop(key) if value is None else described.update({key: value})
        file.write_text(json.dumps(described))

    return harm


@pytest.mark.parametrize(("file", "harm"), [
    ("zarr.json", lambda p: p.write_text("no JSON")),
    ("zarr.json", lambda p: p.write_text("")),
    ("y/zarr.json", lambda p: p.write_text("{")),
    ("work/zarr.json", lambda p: p.write_bytes(b"\xff\xfe")),
    ("work/zarr.json", lambda p: p.write_text((p.parents[1] / "zarr.json").read_text())),
    ("y/zarr.json", _entry("shape", [2, 7])),
    ("y/zarr.json", _entry("shape", None)),
    ("y/zarr.json", _entry("data_type", "int32")),
    ("y/zarr.json", _entry("codecs", [{"name": "unheard of"}])),
    ("y/zarr.json", _entry("chunk_grid", {"name": "regular", "configuration": {"chunk_shape": [2, 33]}})),
])  # fmt: skip
def test_a_store_whose_descriptions_are_damaged_is_refused_in_words(
    tmp_path: Path, file: str, harm: Any
) -> None:
    place = tmp_path / "paths.zarr"
    computed(place)
    harm(place / file)
    with pytest.raises(sepv.UsageError, match=r"no Zarr group|damaged description|an array 'y' of"):
        computed(place)


def test_arrays_without_entries_need_no_place(tmp_path: Path) -> None:
    """No kept states, and no noise."""
    still, place = problems.rigid_body(noise=()), tmp_path / "a.zarr"
    arguments: dict[str, Any] = {**SMALL, "times": None, "paths": 300}
    there = sepv.ensemble(EP, still, store=place, **arguments)
    again = sepv.ensemble(EP, still, store=place, reduce={"q": position}, **arguments)
    assert again.reduced["q"].count == 300
    assert there.W.shape == (0, 300)
    assert not (place / "states").exists()
    assert not (place / "W").exists()
    assert again.to_xarray().sizes["path"] == 300


def test_labelled_arrays_from_memory_and_from_disk_agree(tmp_path: Path) -> None:
    xarray = pytest.importorskip("xarray")
    place = tmp_path / "paths.zarr"
    one = sepv.ensemble(EP, PENDULUM, **SMALL).to_xarray()
    other = sepv.ensemble(EP, PENDULUM, store=place, **SMALL).to_xarray()
    xarray.testing.assert_equal(one.drop_vars("energy"), other.compute())
    assert dict(one.sizes) == {"component": 2, "path": 1000, "noise": 2, "time": 2}
    assert one.states.dims == ("component", "time", "path")
    assert one.time.values.tolist() == [0.25, 0.5]
    known = {"problem": "pendulum", "scheme": EP.name, "h": 1 / 16, "seed": 5}
    for found in (one, other):
        assert found.attrs.items() >= known.items()
        assert found.attrs["sepv_version"] == sepv.__version__
    plain = xarray.open_zarr(place, consolidated=False)
    assert np.array_equal(plain.y.values, one.y.values)
    shutil.rmtree(place)


def test_reduced_paths_cannot_be_labelled() -> None:
    pytest.importorskip("xarray")
    with pytest.raises(sepv.UsageError, match="its paths are gone"):
        sepv.ensemble(EP, PENDULUM, reduce={"q": position}, **SMALL).to_xarray()


def test_states_are_component_first_at_chosen_times_from_the_start() -> None:
    times = [0.0, 0.25, 0.5]
    ends = sepv.ensemble(EP, PENDULUM, **{**SMALL, "times": times})
    assert ends.states.shape == (2, 3, 1000)
    start = np.asarray(PENDULUM.initial)
    assert np.array_equal(ends.states[:, 0], np.repeat(start[:, None], 1000, axis=1))
    assert np.array_equal(ends.states[:, -1], ends.y)
    # H is kept to rounding, which an exchange of axes would not show as such: the spread was 1.97
    # once.
    assert np.ptp(PENDULUM.hamiltonian(ends.states)) < 1e-14
    assert np.array_equal(ends.energy(), PENDULUM.hamiltonian(ends.states))
    labelled = ends.to_xarray()
    assert labelled.energy.dims == ("time", "path")
    body = sepv.ensemble(EP, problems.rigid_body(), h=1 / 16, T=0.5, paths=10, times=[0.0, 0.5])
    assert body.casimirs().shape == (1, 2, 10)
    assert np.ptp(body.casimirs()) < 1e-14
    assert sepv.ensemble(EP, problems.rigid_body(), h=1 / 16, T=0.5, paths=10).energy().shape == (10,)


def test_an_ensemble_prints_as_one_line() -> None:
    text = repr(sepv.ensemble(EP, PENDULUM, **SMALL))
    assert len(text) < 200
    assert "1000 paths" in text
    assert "pendulum" in text
