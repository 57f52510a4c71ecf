"""Right schemes are accused in no unit of time, length or noise;
the six schemes' verdicts are the paper's.
"""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pytest
from doors import but_deep, says, verdicts
from drawn import clipping, louder, refusing

import sepv
from benchmarks.right_schemes import RIGHT_SCHEMES
from benchmarks.right_schemes.other_formulas import flow
from benchmarks.right_schemes.solved_otherwise import of_lanes
from benchmarks.units import UNIT_SCALES, UNITS_LAWS, UNITS_PROBLEMS, Scale, findings, scaled, wrong
from sepv import StepFailure, problems, schemes
from sepv.law import NO_NOISE
from sepv.law.units import Units, units_of
from sepv.problem import Array, Problem
from sepv.schemes import Scheme, ask
from sepv.schemes._guard import Refusal
from sepv.simulate import run_chunk, truncate
from sepv.verification import Effort, Verdict, load_laws, verify

# Each run measures *energy* or *invariant:energy* of all, and *symmetry* of every second one and of
# those without an energy claim. The other laws take minutes, and have a deep run and
# `benchmarks.false_alarms`.
QUICK = {
    name: {"energy", "invariant:energy"} & claims or {"symmetry"} & claims or {"contract"}
    if number % 2
    else {"energy", "invariant:energy", "symmetry"} & claims or {"contract"}
    for number, (name, claims) in enumerate(
        (name, set(scheme.claims)) for name, scheme in RIGHT_SCHEMES.items()
    )
}
# A thousand exact flows, which *contract* asks for, take a minute; the others of these take ten
# seconds and more, and differ from schemes that are asked each time in how they solve or sum alone.
SLOW = ("weak-two", "symmetric-projection", "compensated", "clenshaw-curtis")


@pytest.mark.parametrize("name", but_deep(RIGHT_SCHEMES, *SLOW))
def test_energy_and_symmetry_hold_where_they_are_claimed(name: str) -> None:
    assert accused(name, QUICK[name], 2) == []


# A hundred vectors and more each: the other in the deep run.
METICULOUS = pytest.param("lists-and-fsum", marks=pytest.mark.deep)


@pytest.mark.parametrize(
    "name", ["twenty-nodes", "to-an-ulp", "energy-preserving-in-single-precision", METICULOUS]
)
def test_other_quadratures_solvers_and_precisions_meet_the_reference_vectors(name: str) -> None:
    assert accused(name, {"reference"}, 1) == []


@pytest.mark.deep
@pytest.mark.parametrize("name", RIGHT_SCHEMES)
def test_every_claimed_law_holds(name: str) -> None:
    assert accused(name, RIGHT_SCHEMES[name].claims | {"contract"}, 100) == []


def accused(name: str, laws: Iterable[str], examples: int) -> list[tuple[str, Verdict, str]]:
    """What did not hold: law, verdict and message."""
    report = verify(RIGHT_SCHEMES[name], laws=laws, effort=Effort(examples=examples, seed=1))
    return [(f.law, f.verdict, f.message) for f in report.findings if f.verdict is not Verdict.HOLDS]


@pytest.mark.parametrize(
    "error", [ArithmeticError, ZeroDivisionError, FloatingPointError, np.linalg.LinAlgError]
)
def test_an_arithmetic_error_is_a_refusal_and_says_so(error: type[Exception]) -> None:
    problem, scheme = problems.rigid_body(), Scheme("refuses", refusing(error("no solution found")))
    with pytest.raises(StepFailure, match=r"refused the step by .*no solution found") as caught:
        ask(scheme, problem, np.asarray(problem.initial), 0.1, np.array([0.1]))
    assert isinstance(caught.value, Refusal)
    assert caught.value.delta == pytest.approx(0.2)
    ends = run_chunk(scheme, problem, np.asarray(problem.initial), 0.1, np.zeros((2, 1, 3)), None)
    assert np.all(ends.status != 0)


def test_a_refusal_where_a_solution_exists_is_an_error_of_the_law() -> None:
    never = Scheme("never", refusing(ArithmeticError("never")), ("energy",))
    says(never, "energy", "error", "not solved:", "refused the step", examples=3)


def test_a_refusal_of_a_hard_vector_is_counted_and_no_crash() -> None:
    step = refusing(ZeroDivisionError("too long"), lambda p, y, h, dW: abs(p.random_step(h, dW)) > 8)
    refused = "8 steps without a solution or hard to solve refused"
    says(Scheme("short", step, ("reference",)), "reference", "holds", refused, examples=3)


ALWAYS = {"contract", "reproducibility", "truncation"}
KEPT = {
    "energy-preserving": {
        "identity", "energy", "casimir", "midpoint", "reduction", "noise-sum", "random-step", "expansion", "symmetry",
        "equivariance", "reference", "rounding",
    },
    "midpoint": {
        "identity", "casimir", "midpoint", "noise-sum", "random-step", "expansion", "symmetry", "equivariance",
    },
    "discrete-gradient": {"identity", "energy", "noise-sum", "rounding"},
    "euler-heun": {"noise-sum", "equivariance"},
    "milstein": {"noise-sum", "equivariance"},
    "euler-maruyama": {"equivariance"},
}  # fmt: skip
ABOUT_STEPS = KEPT["energy-preserving"] | ALWAYS


@pytest.mark.parametrize("name", schemes.PAPER)
def test_laws_about_steps_hold_exactly_where_theory_says(name: str) -> None:
    """Those that hold are claimed, and measured by the files of `properties`;
    all others are violated.
    """
    scheme, held = schemes.PAPER[name], KEPT[name] | ALWAYS
    assert scheme.claims & ABOUT_STEPS == held & ABOUT_STEPS
    others = ABOUT_STEPS - held
    if others:
        report = verify(name, laws=others, effort=Effort(shrink_checks=0))
        assert {f.law: f.verdict for f in report.findings} == dict.fromkeys(others, Verdict.VIOLATED)
        assert report.exit_code == 0


def test_every_law_has_a_source() -> None:
    assert all(law.source and law.statement and law.unit for law in load_laws())


@pytest.mark.parametrize(("scheme", "seed"), [("euler-heun", 2067189882), ("milstein", 743061144)])
def test_an_exploding_scheme_has_a_verdict_on_rounding(scheme: str, seed: int) -> None:
    """Explicit schemes with long steps of the rigid body: an energy of 1e300 ends in a verdict,
    not in a warning.
    """
    finding = verify(scheme, laws=["rounding"], effort=Effort(seed=seed)).findings[0]
    assert finding.verdict in (Verdict.VIOLATED, Verdict.ERROR)
    assert finding.defect is not None
    assert np.isfinite(finding.defect)


def verlet(problem: Problem, y: np.ndarray, h: float, dW: np.ndarray) -> np.ndarray:
    """A step of length h; any noise is a mistake of the suite."""
    assert problem.noises == 0
    assert dW.shape == (0, *y.shape[1:])
    return schemes.leapfrog.step(problem, y, h, dW)


def test_no_law_asks_for_noise() -> None:
    scheme = sepv.Scheme("verlet", verlet, order=2.0, batched=True)
    families = ["mechanical", "kepler", "noisy-henon-heiles"]
    report = sepv.verify(scheme, problems=families, effort=sepv.Effort(examples=2, shrink_checks=5))
    verdicts = {f.law: f.verdict.text for f in report.findings}
    assert not report.counts["error"], report
    for law in ("contract", "reproducibility", "identity", "poisson-map:constant", "poisson-map", "symmetry"):
        assert verdicts[law] == "holds", report.finding(law).message
    silent = {f.law for f in report.findings if f.message == NO_NOISE}
    assert silent == {
        "noise-sum", "random-step", "expansion", "truncation", "local-mean", "local-mean-square", "local-weak",
        "mean-square-order", "weak-order", "right-limit",
    }  # fmt: skip


def test_a_whole_class_without_noise() -> None:
    def step(problem: Problem, y: np.ndarray, h: float, dW: np.ndarray) -> np.ndarray:
        assert dW.size == 0
        return sepv.schemes.energy_preserving.step(problem, y, h, dW)

    claims = ["energy", "refusal", "reference", "rounding"]
    scheme = sepv.Scheme("avf", step, claims=claims, noise=False, batched=True)
    laws = "contract,identity,energy,casimir,reference,refusal,rounding,reduction,equivariance"
    assert set(verdicts(scheme, laws, examples=2).values()) == {"holds"}


def test_who_is_without_noise() -> None:
    def scheme(**facts: object) -> sepv.Scheme:
        return sepv.Scheme("verlet", verlet, **facts)

    assert scheme(order=2).deterministic
    assert scheme(noise=False).deterministic
    assert not scheme().deterministic
    assert not scheme(order=2, mean_square_order=1.0).deterministic
    assert not scheme(order=2, noise=True).deterministic


SAMPLES = Effort(paths=2048)
FAST = ("truncation", "right-limit")


@pytest.mark.parametrize("name", ["harmonic-oscillator", "quartic-top", "double-well", "kepler"])
def test_the_units_of_a_problem_change_with_it(name: str) -> None:
    problem = UNITS_PROBLEMS[name]()
    own, other = units_of(problem), units_of(scaled(problem, Scale(4.0**9, 2.0**-9, 2.0**-12)))
    assert other == Units(own.time / 4**9, own.length / 2**12)


def test_a_problem_at_the_origin_or_at_rest_has_units() -> None:
    start = UNITS_PROBLEMS["quartic"]()
    moved = replace(start, initial=(0.0, 0.0), data=None, check=False)
    assert units_of(moved).length == 1.0
    assert 0 < units_of(moved).time < np.inf


SMALL, LARGE = Scale(4.0**-8, 2.0**8, 2.0**-18), Scale(4.0**9, 2.0**-9, 2.0**10)


@pytest.mark.parametrize(
    ("name", "scale"),
    but_deep(
        [("quartic", SMALL), ("quartic-top", LARGE), ("quartic", LARGE), ("quartic-top", SMALL)],
        ("quartic", LARGE), ("quartic-top", SMALL),
    ),
)  # fmt: skip
def test_verdicts_are_the_same_in_every_unit(name: str, scale: Scale) -> None:
    """Powers of two change no digit of a state: what differs is the rounding of the exact flow."""
    problem = UNITS_PROBLEMS[name]()
    few = Effort(paths=512)
    usual = findings(schemes.energy_preserving, scaled(problem, Scale()), few)
    other = findings(schemes.energy_preserving, scaled(problem, scale), few)
    for a, b in zip(usual, other, strict=True):
        assert (a.verdict, a.checks) == (b.verdict, b.checks), b
        # Slopes of one step end where errors are some roundings; "rounding" sees nothing else.
        near = 1.0 if a.law == "rounding" else 1e-2 if a.law.startswith("local") else 1e-6
        assert a.defect == pytest.approx(b.defect, rel=near), b


@pytest.mark.parametrize("rate", [1e-4, 80.0, 1e5])
@pytest.mark.parametrize("name", ["energy-preserving", "euler-heun"])
def test_a_fast_oscillator_with_unit_noise_accuses_nobody(name: str, rate: float) -> None:
    """H = ½ω|y|²: steps that are not the problem's own called (2.1) violated from ω = 80 on."""
    oscillator = scaled(problems.harmonic_oscillator(), Scale(rate))
    found = findings(schemes.by_name(name), replace(oscillator, noise=(1.0,), check=False), SAMPLES, FAST)
    assert [f.verdict for f in found] == [Verdict.HOLDS] * len(found), found


OWN = ("energy-preserving", "euler-heun", "milstein")
# Each problem, each scheme and each scale but theirs in every run, all of them with each other in
# the deep one. Exact flows of exponentials and square roots take 16 and 29 s: these two are left to
# the deep run.
DEAR_FLOWS = ("toda", "double-well")
NAMES = list(UNITS_PROBLEMS)
EVERY_RUN = [
    (NAMES[n % len(NAMES)], OWN[n % 3], scale)
    for n, scale in enumerate(UNIT_SCALES)
    if NAMES[n % len(NAMES)] not in DEAR_FLOWS
]


def each() -> Iterator[Any]:
    for case in product(UNITS_PROBLEMS, OWN, UNIT_SCALES):
        marks = [] if case in EVERY_RUN else [pytest.mark.deep]
        yield pytest.param(*case, marks=marks)


@pytest.mark.parametrize(("problem", "scheme", "scale"), list(each()))
def test_no_right_scheme_is_accused_or_left_open_at_any_rate_noise_and_size(problem, scheme, scale):
    found = findings(schemes.by_name(scheme), scaled(UNITS_PROBLEMS[problem](), scale), SAMPLES, UNITS_LAWS)
    assert not [f for f in found if wrong(f)]


@pytest.mark.parametrize("size", [1e-6, 1e6])
def test_a_noise_far_smaller_than_the_error_of_the_step_is_measured(size: float) -> None:
    """Increments of "explicit-4" have weights: a share of the noise is a covariance with weighted
    means.
    """
    small = scaled(UNITS_PROBLEMS["pendulum"](), Scale(1e-6, 1e-6, size))
    (found,) = findings(schemes.by_name("explicit-4"), small, SAMPLES, ("right-limit",))
    assert found.verdict is Verdict.HOLDS, found
    assert found.checks == 512  # decided at the first look


def _clipping(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    """(2.1), which lets a third less of its increments through than k = 2 does,
    in units of the fast problem.
    """
    return schemes.energy_preserving.step(problem, y, h, truncate(dW, h, 1, unit=_TIME))


@pytest.mark.parametrize("rate", [1e-6, 1.0, 1e5])
def test_a_clip_in_seconds_is_not_accused_on_slow_problems(rate: float) -> None:
    """√(4|ln h|) with h in seconds: 30 of them are a small step of a problem that takes 10⁶."""
    problem = scaled(problems.harmonic_oscillator(), Scale(rate))
    scheme = Scheme("clipping", clipping(2), ("truncation",), batched=True, problems=(problem,))
    assert verify(scheme, laws=["truncation"]).findings[0].verdict is Verdict.HOLDS


_FAST = scaled(problems.harmonic_oscillator(), Scale(1000.0))
_TIME = units_of(_FAST).time


def test_a_clip_that_lets_too_little_through_shows_in_fast_units() -> None:
    own = Scheme("clipping", _clipping, ("truncation",), batched=True, problems=(_FAST,))
    assert verify(own, laws=["truncation"]).findings[0].verdict is Verdict.VIOLATED


SINGLY = [Scale(1e6), Scale(1.0, 1e-5), Scale(size=1e6)]


@pytest.mark.parametrize("scale", but_deep([Scale(1e-3, 1e3, 1e6), *SINGLY], *SINGLY))
def test_faults_of_the_noise_show_in_every_unit(scale: Scale) -> None:
    problem = scaled(UNITS_PROBLEMS["quartic"](), scale)
    own = Scheme("louder", louder(1.02), batched=True, problems=(problem,))
    says(own, "right-limit", "violated", "noise of the limit is wrong by", paths=2048)


@pytest.mark.parametrize("name", but_deep(["flow", "explicit-8", "collocation-3"], "flow"))
def test_a_bare_function_that_is_better_than_the_clip_holds(name: str) -> None:
    """Its increments are clipped with k = 2 as no one told otherwise: the clip is the suite's,
    and no fault of it.
    """
    step = of_lanes(flow) if name == "flow" else schemes.by_name(name).step
    laws = ["truncation", "mean-square-order", "weak-order", "right-limit"]
    assert verdicts(louder(1.0, step), laws, paths=512) == dict.fromkeys(laws, "holds")
