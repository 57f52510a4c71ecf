"""Cost grows as the work does: exact counts, because seconds on a shared machine cannot be gated."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from drawn import EP, PENDULUM, position

import sepv
from sepv.simulate._ensembles import collectors


class Touched(np.ndarray):
    """An array that counts the elements that are read, written or summed, in all arrays of this kind together."""

    elements = 0

    def __setitem__(self, place: Any, value: Any) -> None:
        Touched.elements += np.size(np.asarray(self)[place])
        np.asarray(self)[place] = value

    def __getitem__(self, place: Any) -> Any:
        found = np.asarray(self)[place]
        Touched.elements += np.size(found)
        return found

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **more: Any) -> Any:
        Touched.elements += sum(np.size(a) for a in inputs)
        return getattr(ufunc, method)(*(np.asarray(a) for a in inputs), **more)

    def __array_function__(self, function: Any, _types: Any, inputs: Any, more: Any) -> Any:
        Touched.elements += sum(a.size for a in inputs if isinstance(a, Touched))
        return function(*(np.asarray(a) if isinstance(a, Touched) else a for a in inputs), **more)


def test_an_array_that_counts_sees_sums_and_entries() -> None:
    array, before = np.zeros(100).view(Touched), Touched.elements
    array[2:5] = 1
    assert Touched.elements == before + 3
    assert array.sum() == 3
    assert Touched.elements == before + 103
    assert np.count_nonzero(array) == 3
    assert Touched.elements == before + 203


KINDS: dict[str, dict[str, Any]] = {
    "InMemory": {}, "Reduced": {"reduce": {"q": position}}, "OnDisk": {"store": "paths.zarr"},
}  # fmt: skip


def touched(kind: str, paths: int, place: Path, monkeypatch: pytest.MonkeyPatch) -> set[int]:
    """How many elements of its own arrays a collector touches from one chunk of 64 paths to the next."""
    counts, collector = list[int](), getattr(collectors, kind)
    original = collector.take

    def take(self: Any, number: int, task: Any, result: Any) -> Any:
        found = original(self, number, task, result)
        counts.append(Touched.elements)
        for holder in (self, self.ensemble):
            for name, value in vars(holder).items():
                if type(value) is np.ndarray:
                    object.__setattr__(holder, name, value.view(Touched))
        return found

    with monkeypatch.context() as patched:
        patched.setattr(collector, "take", take)
        more = {key: place / f"{paths}.zarr" if key == "store" else v for key, v in KINDS[kind].items()}
        sepv.ensemble(EP, PENDULUM, h=1 / 16, steps=1, paths=paths, chunk=64, **more)
    assert len(counts) == paths // 64
    return set(np.diff(counts))


@pytest.mark.parametrize("kind", KINDS)
def test_a_chunk_costs_the_same_among_few_and_many_paths(kind: str, tmp_path: Path, monkeypatch) -> None:
    if kind == "OnDisk":
        pytest.importorskip("zarr")
    few, many = (touched(kind, paths, tmp_path, monkeypatch) for paths in (128, 2048))
    assert few == many
    assert max(many) <= 64 * 16  # at most the ends of its own paths, and a mark for each
