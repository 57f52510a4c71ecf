"""Right schemes that look unusual, or are without noise, are not accused; the six schemes' verdicts are the paper's."""

from collections.abc import Iterable

import numpy as np
import pytest
from doors import finding, verdicts

import sepv
from benchmarks.right_schemes import RIGHT
from sepv import StepFailure, problems, schemes
from sepv.errors import UsageError
from sepv.problem import Problem, Systems
from sepv.schemes import Scheme, ask
from sepv.schemes._guard import Refusal
from sepv.simulate._batch import run_chunk
from sepv.verification import Effort, Verdict, load_laws, verify
from sepv.verification._law import NO_NOISE

# Laws over paths have budgets of their own and are run by `benchmarks.false_alarms`.
PATHS = {"mean-square-order", "weak-order", "right-limit", "rounding"}
# What each run asks: *energy* of all, and *symmetry* of every other one and of those that claim no energy. The others
# cost minutes, and have a deep run and `benchmarks.false_alarms`.
QUICK = {
    name: {"energy"} & claims or {"symmetry"} & claims or {"contract"}
    if number % 2
    else {"energy", "symmetry"} & claims or {"contract"}
    for number, (name, claims) in enumerate((name, set(scheme.claims)) for name, scheme in RIGHT.items())
}
# A thousand exact flows, which *contract* asks for, take a minute.
SLOW = ("weak-two",)


@pytest.mark.parametrize("name", [pytest.param(n, marks=[pytest.mark.deep] * (n in SLOW)) for n in RIGHT])
def test_energy_and_symmetry_hold_where_they_are_claimed(name: str) -> None:
    assert accused(name, QUICK[name], 2) == []


@pytest.mark.deep
@pytest.mark.parametrize("name", RIGHT)
def test_every_claimed_law_about_steps_holds(name: str) -> None:
    assert accused(name, (RIGHT[name].claims | {"contract"}) - PATHS - {"reference"}, 4) == []


# A hundred vectors and more each: the other in the deep run.
@pytest.mark.parametrize(
    "name",
    [
        "twenty-nodes",
        "energy-preserving-in-single-precision",
        pytest.param("lists-and-fsum", marks=pytest.mark.deep),
    ],
)
def test_other_quadratures_solvers_and_precisions_meet_the_reference_vectors(name: str) -> None:
    assert accused(name, {"reference"}, 1) == []


@pytest.mark.deep
@pytest.mark.parametrize("name", RIGHT)
def test_every_claimed_law_holds(name: str) -> None:
    assert accused(name, RIGHT[name].claims | {"contract"}, 100) == []


def accused(name: str, laws: Iterable[str], examples: int) -> list[tuple[str, Verdict, str]]:
    """What did not hold: law, verdict and message."""
    report = verify(RIGHT[name], laws=laws, effort=Effort(examples=examples, seed=1))
    return [(f.law, f.verdict, f.message) for f in report.findings if f.verdict is not Verdict.HOLDS]


@pytest.mark.parametrize(
    "error", [ArithmeticError, ZeroDivisionError, FloatingPointError, np.linalg.LinAlgError]
)
def test_an_arithmetic_error_is_a_refusal_and_says_so(error: type[Exception]) -> None:
    def step(problem, y, h, dW):
        raise error("no solution found")

    problem = problems.rigid_body()
    scheme = Scheme("refuses", step)
    with pytest.raises(StepFailure, match=r"refused the step by .*no solution found") as caught:
        ask(scheme, problem, np.asarray(problem.initial), 0.1, np.array([0.1]))
    assert isinstance(caught.value, Refusal)
    assert caught.value.delta == pytest.approx(0.2)
    ends = run_chunk(scheme, problem, np.asarray(problem.initial), 0.1, np.zeros((2, 1, 3)), None)
    assert np.all(ends.status != 0)


def test_a_refusal_where_a_solution_exists_is_an_error_of_the_law() -> None:
    def step(problem, y, h, dW):
        raise ArithmeticError("never")

    found = finding(Scheme("never", step, ("energy",)), "energy", examples=3)
    assert found.verdict is Verdict.ERROR
    assert found.message.startswith("not solved:")
    assert "refused the step" in found.message


def test_a_refusal_of_a_hard_vector_is_counted_and_no_crash() -> None:
    def step(problem, y, h, dW):
        if abs(problem.random_step(h, dW)) > 8:
            raise ZeroDivisionError("too long for this solver")
        return schemes.energy_preserving.step(problem, y, h, dW)

    found = finding(Scheme("short", step, ("reference",)), "reference", examples=3)
    assert found.verdict is Verdict.HOLDS, found.message
    assert "8 steps without a solution or hard to solve refused" in found.message


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
    """Those that hold are claimed, and measured by the files of `properties`; all others are violated."""
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
    """Explicit schemes with long steps of the rigid body: an energy of 1e300 ends in a verdict, not in a warning."""
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
    report = sepv.verify(scheme, problems=families, effort=sepv.Effort(examples=8, shrink_checks=5))
    verdicts = {f.law: f.verdict.text for f in report.findings}
    assert not report.counts["error"], report
    for law in ("contract", "reproducibility", "identity", "symplecticity", "poisson-map", "symmetry"):
        assert verdicts[law] == "holds", report.finding(law).message
    silent = {f.law for f in report.findings if f.message == NO_NOISE}
    assert silent == {
        "noise-sum", "random-step", "expansion", "truncation", "local-mean", "local-mean-square", "local-weak",
        "mean-square-order", "weak-order", "right-limit", "commutation",
    }  # fmt: skip


def test_a_whole_class_without_noise() -> None:
    def step(problem: Problem, y: np.ndarray, h: float, dW: np.ndarray) -> np.ndarray:
        assert dW.size == 0
        return sepv.schemes.energy_preserving.step(problem, y, h, dW)

    claims = ["energy", "refusal", "reference", "rounding"]
    scheme = sepv.Scheme("avf", step, claims=claims, noise=False, batched=True)
    laws = "contract,identity,energy,casimir,reference,refusal,rounding,reduction,equivariance"
    assert set(verdicts(scheme, laws, examples=8).values()) == {"holds"}


def test_who_is_without_noise() -> None:
    def scheme(**facts: object) -> sepv.Scheme:
        return sepv.Scheme("verlet", verlet, **facts)

    assert scheme(order=2).deterministic
    assert scheme(noise=False).deterministic
    assert not scheme().deterministic
    assert not scheme(order=2, mean_square_order=1.0).deterministic
    assert not scheme(order=2, noise=True).deterministic
    for facts in ({"mean_square_order": 1.0}, {"systems": Systems.ADDITIVE}):
        with pytest.raises(UsageError, match="without noise"):
            scheme(noise=False, **facts)
    with pytest.raises(UsageError, match="order, a number"):
        scheme(order=-1)
