"""Cost grows as the work does: exact counts, because seconds on a shared machine cannot be
gated.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from drawn import EP, PENDULUM, position

import sepv
from sepv import problems
from sepv.errors import SlowDerivation
from sepv.problem import _json
from sepv.record import _symbols, poly
from sepv.simulate._ensembles import collectors


class Touched(np.ndarray):
    """An array that counts the elements that are read, written or summed,
    in all arrays of this kind together.
    """

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
    """How many elements of its own arrays a collector touches from one chunk of 64 paths to the
    next.
    """
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


def chain(d: int, count: dict[str, int] | None = None) -> dict[str, Any]:
    """Parts of a problem with B(y) of degree one and a quartic H of neighbours;
    `count` gets the calls of B and H.
    """
    counted = {} if count is None else count
    coupling = np.random.default_rng(1).uniform(-1, 1, d - 1)

    def structure(y: Any) -> Any:
        counted["B"] = counted.get("B", 0) + 1
        B = np.zeros((d, d, *np.shape(y)[1:]), dtype=np.result_type(y))
        for i in range(d - 1):
            B[i, i + 1] = coupling[i] * y[i]
            B[i + 1, i] = -B[i, i + 1]
        return B

    def hamiltonian(y: Any) -> Any:
        counted["H"] = counted.get("H", 0) + 1
        return 0.25 * (y**4).sum(axis=0) + (y[1:] * y[:-1]).sum(axis=0)

    def gradient(y: Any) -> Any:
        g = y**3
        g[1:] += y[:-1]
        g[:-1] += y[1:]
        return g

    def hessian(y: Any) -> Any:
        A = np.zeros((d, d, *np.shape(y)[1:]), dtype=np.result_type(y))
        for i in range(d):
            A[i, i] = 3 * y[i] ** 2
        for i in range(d - 1):
            A[i, i + 1] = A[i + 1, i] = 1 + 0 * y[i]
        return A

    def structure_derivative(y: Any) -> Any:
        D = np.zeros((d, d, d, *np.shape(y)[1:]), dtype=np.result_type(y))
        for i in range(d - 1):
            D[i, i + 1, i], D[i + 1, i, i] = coupling[i], -coupling[i]
        return D

    return {
        "dimension": d, "structure": structure, "hamiltonian": hamiltonian, "gradient": gradient, "hessian": hessian,
        "structure_derivative": structure_derivative, "initial": np.linspace(0.5, 1, d), "degree": 4,
    }  # fmt: skip


def test_the_check_of_a_problem_evaluates_b_and_h_equally_often_in_every_dimension() -> None:
    calls = []
    for d in (6, 40):
        calls.append({})
        sepv.Problem(**chain(d, calls[-1]))
    assert calls[0] == calls[1]
    assert max(calls[1].values()) <= 60  # at five states


@pytest.mark.parametrize(
    ("part", "place"),
    [
        ("gradient", (17,)),
        ("hessian", (3, 29)),
        ("structure_derivative", (5, 31, 12)),
        ("structure", (7, 22)),
    ],
)
@pytest.mark.parametrize("error", [1e-6, -1.0])
def test_one_wrong_entry_among_thousands_is_found_and_named(part: str, place: Any, error: float) -> None:
    """One error δ changes the sum along the direction by more than δ/2: it is seen for certain,
    not by luck.
    """
    parts = chain(40)
    right = parts[part]

    def wrong(y: Any) -> Any:
        values = right(y)
        values[place] += error
        return values

    shown = ", ".join(map(str, place))
    with pytest.raises(sepv.ProblemError, match=rf"{part}\(y\)\[{shown}\] = "):
        sepv.Problem(**parts | {part: wrong})


def test_entries_that_are_all_wrong_by_less_than_is_allowed_are_accepted() -> None:
    """A gradient of finite differences, say: what one entry may lack, all may lack together."""
    parts = chain(40)
    sepv.Problem(**parts | {"gradient": lambda y: parts["gradient"](y) * (1 + 0.9e-9)})


def test_derivatives_that_take_long_say_so_and_what_to_give(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_symbols, "SLOW_TAPE_OPERATIONS", 1000)
    parts = chain(40)
    with pytest.warns(SlowDerivation, match="give gradient="):
        sepv.Problem(**{key: parts[key] for key in ("dimension", "hamiltonian", "initial")}, structure=_J(40))


def _J(d: int) -> Any:
    J = np.kron(np.array([[0, -1], [1, 0]]), np.eye(d // 2))
    return lambda y: np.multiply.outer(J, np.ones_like(y[0]))


def problem_file(terms: int, d: int = 3) -> dict[str, Any]:
    """A problem with a Hamiltonian of so many terms y₁ᵃy₂ᵇ,
    of which one entry of H″ has nearly all.
    """
    hamiltonian = [[[2 + k % 300, k // 300, *[0] * (d - 2)], 1e-3] for k in range(terms)]
    return {"dimension": d, "hamiltonian": hamiltonian, "structure": [[0, 1, [[[0] * d, 1.0]]]]}


def test_tables_of_a_polynomial_hold_its_terms_and_no_padding() -> None:
    """Bytes per term: H″ of d variables has d² sums, which one long sum must not make all as
    long.
    """
    problem = problems.build(problems.from_json(problem_file(1200, d=8)))
    problem.hessian(np.full((8, 100), 0.5))
    sums = problem.hessian._sums
    _, layers = sums._layers
    tables = sums.places, sums.coefficients, *(table for layer in layers for table in layer)
    assert len(sums.places) > 2000  # terms of ∂²H/∂y₁², ∂²H/∂y₁∂y₂ and ∂²H/∂y₂²
    assert sum(table.nbytes for table in tables) == 32 * len(sums.places)  # a number and a coefficient, twice


def test_a_validator_of_schemas_sees_no_terms(monkeypatch: pytest.MonkeyPatch) -> None:
    """It takes a tenth of a millisecond for each number: 90,000 terms took 27 s."""
    seen = []
    monkeypatch.setattr(_json, "fault", lambda data, _schema: seen.append(len(json.dumps(data))) or "")
    for terms in (10, 1000):
        problems.from_json(problem_file(terms))
    assert seen[0] == seen[1]


@pytest.mark.parametrize(("data", "words"), [
    (problem_file(100_001), "more than 100000 terms"),
    ({"dimension": 64, "hamiltonian": [[[0] * 64, 1.0]] * 20_000, "structure": []}, "more than 1000000 exponents"),
    ({"name": "pendulum", "parameters": {f"p{n}": [1.0] for n in range(10**5)}}, "more than 131072 numbers"),
    ({"name": "pendulum", "parameters": {f"p{n}": [1.0] for n in range(100)}}, "parameters"),
    ({"name": "p" * 10**6}, "name"),
    (problem_file(3) | {"hamiltonian": [[[2, 0, 0], 1.0], [[0, -1, 0], 1.0]]}, r"hamiltonian\[1\]\[0\]\[1\]: -1"),
    (problem_file(3) | {"structure": [[0, 1, [[[0, 0, 0], "one"]]]]}, r"structure\[0\]\[2\]\[0\]\[1\]"),
    (problem_file(3) | {"structure": [[[0, 0, 0], 1.0]]}, r"structure\[0\]"),
    (problem_file(3) | {"hamiltonian": "y1"}, "hamiltonian"),
])  # fmt: skip
def test_a_description_beyond_the_bounds_is_refused_and_the_place_of_a_fault_is_said(
    data: Any, words: str
) -> None:
    with pytest.raises(sepv.ProblemError, match=words) as caught:
        problems.from_json(data)
    assert len(str(caught.value)) < 2000


def test_what_an_error_echoes_has_a_bound() -> None:
    error = sepv.UsageError(expected="a name", received="x" * 60_000_000, remedy="a shorter one")
    assert len(str(error)) < 10_000
    assert "59996000 more characters" in str(error)


def test_a_product_of_long_polynomials_is_refused() -> None:
    long = poly.polynomial(2, {(k % 300, k // 300): 1.0 for k in range(3000)})
    with pytest.raises(sepv.UsageError, match="products of terms"):
        poly.multiply(long, long)
