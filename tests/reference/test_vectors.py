"""The reference vectors: what is in the files, who may have made them, and that the float64 core keeps to them."""

import json
import math
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from sepv.reference.arithmetic import context
from sepv.reference.rounding import error_units
from sepv.reference.steps import reference_step
from sepv.reference.vector import FLOW, FOLDER, ReferenceVector, digest, load, schemes_with_vectors, to_text

from benchmarks.vectors import generate
from benchmarks.vectors.selection import SCHEMES
from sepv import exact_flow, problems, schemes
from sepv.errors import StepFailure, UsageError
from sepv.record._binary64 import EPS, TINY
from sepv.schemes import Scheme
from sepv.verification import Case

ALL = [v for scheme in SCHEMES for v in load(scheme)]
SCHEMA = json.loads((FOLDER / "vectors.schema.json").read_text())


@pytest.mark.deep  # every candidate is drawn again
def test_the_files_are_those_of_the_selection() -> None:
    assert schemes_with_vectors() == sorted(SCHEMES)
    for scheme in SCHEMES:
        assert [v.id for v in load(scheme)] == [name for name, _ in generate.named_candidates(scheme)]


@pytest.mark.parametrize("scheme", SCHEMES)
def test_files_are_as_the_schema_says_and_small(scheme: str) -> None:
    path = FOLDER / f"{scheme}.json"
    jsonschema.Draft202012Validator(SCHEMA).validate(json.loads(path.read_text()))
    assert path.stat().st_size < 1e6
    assert to_text(scheme, generate.source_of(scheme), load(scheme)) == path.read_text()


def test_the_vectors_cover_what_they_should() -> None:
    assert len(ALL) >= 500
    assert len({v.id for v in ALL}) == len(ALL)
    assert all(v.proof in ("krawczyk", "balls") for v in ALL)
    systems = [v.problem for v in ALL if not hasattr(v.problem, "parameters")]
    assert {s.dimension for s in systems} == set(range(1, 13))
    assert {s.hamiltonian.degree for s in systems} == set(range(1, 9))
    assert {max((p.degree for _, _, p in s.structure), default=0) for s in systems} >= {0, 1, 2, 3}
    assert {len(s.noise) for s in systems} == {0, 1, 2, 3, 4}
    deltas = [step_of(v) for v in ALL if v.scheme == "energy-preserving"]
    assert min(map(abs, filter(None, deltas))) < 1e-299
    assert max(deltas) >= 1e7
    assert min(deltas) <= -1e14
    flags = {flag for v in ALL for flag in v.flags}
    assert flags == set(SCHEMA["$defs"]["case"]["properties"]["flags"]["items"]["enum"])
    assert max(v.condition for v in ALL) > 1e3


def step_of(v: ReferenceVector) -> float:
    return float(problems.build(v.problem).random_step(v.h, np.array(v.dW)))


def test_decimal_and_hexadecimal_answers_agree() -> None:
    ctx = context(60)
    for v in ALL:
        for text, value in zip(v.y1, v.y1_hex, strict=True):
            # Half a unit in the last place, or half the least subnormal.
            assert abs(ctx.mpf(text) - value) <= max(EPS / 2 * abs(value), ctx.mpf(2) ** -1075), v.id


def shares(scheme: Scheme, vectors: tuple[ReferenceVector, ...]) -> tuple[dict[str, float], list[str]]:
    """error / bound of each vector's worst component, and which were refused."""
    ctx, found, refused = context(60), {}, []
    for v in vectors:
        problem, y, h, dW = Case(v.problem, v.y, v.h, v.dW).build()
        if "overflow" in v.flags:
            continue
        try:
            y1 = scheme.step(problem, y, h, dW)
        except StepFailure:
            refused.append(v.id)
            assert v.hard, v.id
            continue
        floor = EPS * EPS * max(map(abs, (*v.y, *v.y1_hex))) + TINY
        found[v.id] = max(
            abs(float(ctx.mpf(a) - float(b))) / (4 * r + floor)
            for a, b, r in zip(v.y1, y1, v.rounding, strict=True)
        )
    return found, refused


def solves_the_equation(scheme: Scheme, v: ReferenceVector) -> bool:
    problem, y, h, dW = Case(v.problem, v.y, v.h, v.dW).build()
    y1 = scheme.step(problem, y, h, dW)
    exact = reference_step(scheme.name, v.problem, v.y, h, v.dW, start=y1.tolist())
    units = error_units(v.problem, list(v.y), h, list(v.dW), exact)
    return all(abs(float(a - float(b))) <= 4 * u for a, b, u in zip(exact.y1, y1, units, strict=True))


@pytest.mark.parametrize("name", [n for n in schemes.PAPER if n in SCHEMES])
def test_the_core_is_within_the_bound_on_every_vector(name: str) -> None:
    found, refused = shares(schemes.PAPER[name], load(name))
    # Next to a fold Newton's method may end at the other solution there, which solves the equation as well.
    off = [v for v in load(name) if not found.get(v.id, 0.0) <= 1]
    assert [v.id for v in off if not solves_the_equation(schemes.PAPER[name], v)] == []
    assert all("near-fold" in v.flags for v in off)
    # Refusals are for steps next to a fold; everything else is solved.
    assert all("/fold-" in k for k in refused)
    assert len(found) + len(refused) >= 0.95 * len(load(name))


def test_the_exact_flow_is_within_its_own_error_on_every_vector() -> None:
    ctx = context(60)
    for v in load(FLOW):
        flow = exact_flow(problems.build(v.problem), v.h, np.array(v.y))
        worst = max(abs(float(ctx.mpf(a) - float(b))) for a, b in zip(v.y1, flow.y, strict=True))
        assert worst <= max(flow.error, 1e-15 * max(map(abs, v.y1_hex))), v.id


def test_a_relative_error_of_1e_10_is_seen_by_nearly_every_vector() -> None:
    off = Scheme("off", lambda *a: schemes.energy_preserving.step(*a) * (1 + 1e-10))
    found, _ = shares(off, load("energy-preserving"))
    unseen = [k for k, share in found.items() if share <= 1]
    # What is at rest at 0, subnormal, or amplifies rounding by a fold, hides an error of 1e-10.
    assert len(unseen) < 0.1 * len(found)


@pytest.mark.parametrize("every", [47, pytest.param(1, marks=pytest.mark.deep)])
@pytest.mark.parametrize("scheme", SCHEMES)
def test_a_share_of_the_vectors_is_made_again(scheme: str, every: int) -> None:
    count, wrong = generate.check([scheme], every=every)
    assert wrong == []
    assert count >= (1 if every > 1 else len(load(scheme)))


def spoilt(tmp_path: Path, change) -> Path:
    data = json.loads((FOLDER / "gauss-1.json").read_text())
    change(data)
    (tmp_path / "gauss-1.json").write_text(json.dumps(data))
    load.cache_clear()
    return tmp_path


def rehash(case: dict) -> None:
    case["hash"] = digest(case)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda d: d["cases"][2].update(h="0x1.0p-3"), "the case was changed"),
        (lambda d: d["cases"][1].update(hash="0" * 16), "the case was changed"),
        (lambda d: d["cases"].append(d["cases"][0]), "twice"),
        (lambda d: d["cases"][0].update(id="midpoint/paper-01") or rehash(d["cases"][0]), "ids gauss-1/"),
        (lambda d: d["cases"][0].pop("note"), "note"),
        (lambda d: d["cases"][0].update(extra=1), "extra"),
        (lambda d: d["cases"].append(3), "int"),
        (lambda d: d.update(format="sepv-vectors-2"), "sepv-vectors-1"),
        (lambda d: d["cases"][0].update(y1=["0.5"]) or rehash(d["cases"][0]), "as many components"),
        (lambda d: d["cases"][0].update(y=["half"]) or rehash(d["cases"][0]), "ValueError"),
    ],
)
def test_a_spoilt_file_is_refused_by_name(tmp_path: Path, change, words: str) -> None:
    with pytest.raises(UsageError, match=words):
        load("gauss-1", spoilt(tmp_path, change))


def test_a_file_that_is_not_there_or_no_json_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="there are: none"):
        load("midpoint", tmp_path)
    (tmp_path / "midpoint.json").write_text('{"format"')
    with pytest.raises(UsageError, match=r"midpoint\.json"):
        load("midpoint", tmp_path)


def test_a_failed_generation_leaves_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "gauss-1.json").write_text("old")
    monkeypatch.setattr(generate, "FOLDER", tmp_path)
    monkeypatch.setattr(generate, "certify", lambda *_: 1 / 0)
    assert generate.main(["gauss-1"]) == 1
    assert (tmp_path / "gauss-1.json").read_text() == "old"
    assert list(tmp_path.iterdir()) == [tmp_path / "gauss-1.json"]


def test_the_check_sees_a_changed_answer(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def change(d: dict) -> None:
        last = d["cases"][0]["y1"][0]
        d["cases"][0]["y1"][0] = last[:-1] + str((int(last[-1]) + 1) % 10)
        rehash(d["cases"][0])

    count, wrong = generate.check(["gauss-1"], every=50, folder=spoilt(tmp_path, change))
    assert count == 1
    assert wrong == ["gauss-1/paper-01: y1 differ"]
    assert generate.main(["--check", "gauss-1"]) == 0
    assert "0 differ" in capsys.readouterr().out


def test_binary64_is_rounded_to_nearest_also_below_the_normal_range() -> None:
    ctx = context(400)
    assert generate.to_binary64(ctx.mpf(2) ** -1074 * 1.5) == 1e-323
    assert generate.to_binary64(ctx.mpf(2) ** -1075) == 0.0
    assert generate.to_binary64(ctx.mpf(2) ** -1075 + ctx.mpf(2) ** -2000) == 5e-324
    assert generate.to_binary64(1 + ctx.mpf(2) ** -53) == 1.0
    assert generate.to_binary64(1 + ctx.mpf(2) ** -53 + ctx.mpf(2) ** -300) == math.nextafter(1.0, 2.0)
