"""The references, written out in another way, and their vectors: who made them,
and that the core keeps to them.
"""

import json
import math
from functools import partial
from pathlib import Path

import jsonschema
import mpmath
import numpy as np
import pytest
from hypothesis import given
from sepv.reference.arithmetic import context
from sepv.reference.elliptic import closed_form
from sepv.reference.equations import EQUATIONS
from sepv.reference.flow import flow_series, taylor
from sepv.reference.problem import exact_problem
from sepv.reference.steps import reference_step
from sepv.reference.vector import FLOW, VECTOR_FOLDER, ReferenceVector, digest, load, schemes_with_vectors

from benchmarks.vectors import generate
from benchmarks.vectors.rounding import error_units
from sepv import Scheme, StepFailure, UsageError, exact_flow, problems, schemes
from sepv.core.arrays import EPS, TINY
from sepv.law import strategies
from sepv.problem import PolynomialSystem
from sepv.record import poly
from sepv.verification import Case

energy_preserving = partial(reference_step, "energy-preserving")
midpoint = partial(reference_step, "midpoint")


def test_the_series_of_a_flow_has_the_coefficients_of_known_solutions() -> None:
    """cos t and sin t, and 1/(1 − t) for y1′ = y1² (H = y2, B12 = y1²)."""
    circle = PolynomialSystem(2, poly.squares((1, 1)), ((0, 1, poly.constant(2, -1.0)),))
    for k, (p, q) in enumerate(flow_series(circle, (0.0, 1.0), 8)):
        assert abs(p * math.factorial(k) - (0, -1, 0, 1)[k % 4]) < 1e-38
        assert abs(q * math.factorial(k) - (1, 0, -1, 0)[k % 4]) < 1e-38
    riccati = PolynomialSystem(2, poly.linear((0.0, 1.0)), ((0, 1, poly.polynomial(2, {(2, 0): 1.0})),))
    assert flow_series(riccati, (1.0, 0.5), 8) == [[1, 0.5], *[[1, 0]] * 8]


@given(strategies.any_steps())
def test_the_reference_keeps_energy_and_casimirs_to_its_digits(case: Case) -> None:
    exact = exact_problem(case.problem, 65)
    y0, y1 = exact.state(case.y), energy_preserving(case.problem, case.y, case.h, case.dW).y1
    scale = 1 + abs(exact.hamiltonian(y0)) + max(abs(v) for v in exact.gradient(y0))
    assert abs(exact.hamiltonian(y1) - exact.hamiltonian(y0)) < 1e-45 * scale
    for before, after in zip(exact.casimir_values(y0), exact.casimir_values(y1), strict=True):
        assert abs(after - before) < 1e-45 * (1 + abs(before))


@given(strategies.any_steps())
def test_thirty_digits_agree_with_sixty(case: Case) -> None:
    for solve in (energy_preserving, midpoint):
        coarse, fine = (solve(case.problem, case.y, case.h, case.dW, digits) for digits in (30, 60))
        for a, b in zip(coarse.y1, fine.y1, strict=True):
            assert abs(b - a) < 1e-29 * (1 + abs(b))


SIZES = (5e-324, 1e-310, 1e-200, 1e-100, 1e100, 1e200, 1e300)


@pytest.mark.parametrize("y", [(0.2, 0.1), *((size, 0.0) for size in SIZES)])
def test_oscillator_is_the_printed_formula_to_fifty_digits(y: tuple[float, float]) -> None:
    data, ctx = problems.harmonic_oscillator().data, context(60)
    (p, x), delta = map(ctx.mpf, y), ctx.mpf(0.5) + ctx.mpf(0.25)
    q = 1 + delta**2 / 4
    expected = [(-delta * x + (1 - delta**2 / 4) * p) / q, ((1 - delta**2 / 4) * x + delta * p) / q]
    for solve in (energy_preserving, midpoint):
        for a, b in zip(solve(data, y, 0.5, [0.25]).y1, expected, strict=True):
            assert abs(a - b) <= abs(b) * ctx.mpf(10) ** -50


@pytest.mark.parametrize("stages", range(1, 7))
def test_collocation_is_gauss_for_quadratic_h_and_the_scheme_for_one_stage(stages: int) -> None:
    body, y, h, dW = problems.rigid_body().data, (0.8, 0.6, 0.0), 0.25, (0.125,)
    both = [reference_step(f"{name}-{stages}", body, y, h, dW).y1 for name in ("collocation", "gauss")]
    assert max(abs(a - b) for a, b in zip(*both, strict=True)) < 1e-50
    for name in ("pendulum", "lotka-volterra"):
        problem = problems.by_name(name)
        arguments = (problem.data, tuple(map(float, problem.initial)), 0.05, (0.025,) * problem.noises)
        one, many = (reference_step(n, *arguments).y1 for n in ("energy-preserving", f"collocation-{stages}"))
        flow = taylor(problem.data, arguments[1], 0.05 + 0.025 * float(np.sum(problem.c)), 50)
        if stages == 1:
            assert max(abs(a - b) for a, b in zip(one, many, strict=True)) < 1e-50
        # Order 2s: each further stage brings the step closer to the flow by two orders.
        off = float(max(abs(a - b) for a, b in zip(flow, many, strict=True)))
        assert off < 0.2 * 0.2 ** (2 * stages)


def test_milstein_and_euler_maruyama_are_their_formulas_by_hand() -> None:
    """Oscillator: f′f = −y, so that Milstein is (1 − S²/2)y + Δf and Euler-Maruyama (1 − h/2)y + Δf
    for c = 1.
    """
    data, ctx = problems.harmonic_oscillator().data, context(60)
    p, x, h, S = ctx.mpf(0.2), ctx.mpf(0.1), ctx.mpf(0.125), ctx.mpf(0.25)
    for name, factor in (("milstein", 1 - S * S / 2), ("euler-maruyama", 1 - h / 2)):
        y1 = reference_step(name, data, (0.2, 0.1), 0.125, (0.25,)).y1
        assert abs(y1[0] - (factor * p - (h + S) * x)) < 1e-55
        assert abs(y1[1] - (factor * x + (h + S) * p)) < 1e-55


@pytest.mark.parametrize("digits", [0, -1, 10**5, 2.5, True])
def test_absurd_digits_are_refused(digits) -> None:
    data, y = problems.harmonic_oscillator().data, (0.2, 0.1)
    for call, rest in ((energy_preserving, (0.1, (0.0,))), (taylor, (1.0,)), (closed_form, (1.0,))):
        with pytest.raises(UsageError, match="digits, an integer between 1 and 2000"):
            call(data, y, *rest, digits)


def test_no_global_precision_is_touched() -> None:
    before = mpmath.mp.dps
    energy_preserving(problems.pendulum().data, [0.2, 1.0], 0.1, [0.1, 0.1], 80)
    assert mpmath.mp.dps == before


SCHEMES = schemes_with_vectors()
ALL = [v for scheme in SCHEMES for v in load(scheme)]
SCHEMA = json.loads((VECTOR_FOLDER / "vectors.schema.json").read_text())


def test_every_equation_and_the_flow_have_vectors() -> None:
    of_constant_structures = "averaged-vector-field"  # where B is constant it is (2.1)
    assert sorted({*EQUATIONS, FLOW} - {of_constant_structures}) == SCHEMES


@pytest.mark.parametrize("scheme", SCHEMES)
def test_files_are_as_the_schema_says_and_small(scheme: str) -> None:
    path = VECTOR_FOLDER / f"{scheme}.json"
    jsonschema.Draft202012Validator(SCHEMA).validate(json.loads(path.read_text()))
    assert path.stat().st_size < 1e6
    assert generate.to_text(scheme, generate.source_of(scheme), load(scheme)) == path.read_text()


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
    # Next to a fold Newton's method may end at the other solution there, which solves the equation
    # as well.
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
    data = json.loads((VECTOR_FOLDER / "gauss-1.json").read_text())
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
    monkeypatch.setattr(generate, "VECTOR_FOLDER", tmp_path)
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
