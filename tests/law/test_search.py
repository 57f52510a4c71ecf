"""Searches find what chance alone would miss and name the part that makes it;
witnesses of the corpus come first.
"""

import json
from collections.abc import Callable
from dataclasses import replace
from random import Random
from typing import Any

import numpy as np
import pytest
from doors import ROOT, but_deep, command, says
from hypothesis import strategies as st
from sepv.reference.vector import digest

from benchmarks import witnesses as maker
from benchmarks.power import POWER_FAULTS, FaultOfLaw, measured, power
from benchmarks.right_schemes import RIGHT_SCHEMES
from sepv import Scheme, problems, schemes
from sepv.faults import detection as fault_detection
from sepv.faults.saboteurs import SABOTEURS
from sepv.faults.saboteurs.noise import _with
from sepv.files import fault
from sepv.law import corpus, search
from sepv.law.cases.case import from_json, to_json, to_token
from sepv.law.cases.shrink import size
from sepv.problem import Array, Problem, Systems
from sepv.verification import Case, Cases, Effort, Law, Measurement, Run, Verdict, load_laws, searched, verify
from sepv.verification._verify import replay

# A violation lies in a thousandth of the states, on a slope of the defect that is seen from all of
# them.
MOST, BEST, NEAR = 10**4, 6_543, 4


def states() -> st.SearchStrategy[Case]:
    data = problems.harmonic_oscillator().data
    assert data is not None
    return st.integers(0, MOST).map(lambda n: Case(data, (float(n), 0.0), 0.5, (0.0,)))


def slope(_: Scheme, case: Case) -> Measurement:
    away = abs(case.y[0] - BEST)
    return Measurement(1.0 + 1.0 / MOST if away <= NEAR else 1.0 - away / MOST, 1.0)


def law() -> Law:
    cases = Cases(instead={Systems.SINGLE: states})
    return searched(name="slope", statement="", source="", unit="1", cases=cases, check=slope)


def verdicts() -> list[Verdict]:
    tried = [Run(Effort(examples=25, seed=seed, shrink_checks=0)) for seed in range(8)]
    return [law().run(law(), schemes.energy_preserving, run).verdict for run in tried]


def test_a_violation_at_the_top_of_a_slope_is_climbed_to() -> None:
    """A hundred examples of chance alone would meet it with one seed of ten."""
    assert verdicts() == [Verdict.VIOLATED] * 8


def test_without_the_target_it_is_missed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(search, "target", lambda *_, **__: None)
    assert verdicts().count(Verdict.VIOLATED) <= 2


def test_a_defect_that_is_not_a_number_is_no_tolerance() -> None:
    log, case = search.SearchLog(), Case(problems.rigid_body().data, (0.8, 0.6, 0.0), 0.125, (0.25,))

    def check(*_: object) -> Measurement:
        return Measurement(float("nan"), 1.0)

    with pytest.raises(search._Violation):
        search._measure(log, schemes.midpoint, case, check, False)
    (energy,) = load_laws(["energy"])
    assert "tolerance" not in search.conclude(energy, schemes.midpoint, log, check).message


@pytest.mark.parametrize("checks", [0, 3, 10, 30])
def test_a_defect_is_that_of_the_witness_wherever_simplifying_ends(checks: int) -> None:
    """The midpoint rule does not keep the energy of the pendulum, by more the longer the step."""
    found = says("midpoint", "energy", "violated", problems="pendulum", shrink_checks=checks, corpus=False)
    again = replay("midpoint", "energy", found.witness)
    assert (found.verdict, found.defect, found.bound) == (again.verdict, again.defect, again.bound)


def test_steps_longer_than_a_scheme_takes_are_left_out_and_their_share_is_said() -> None:
    refused = []

    def step(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        if abs(h) + np.abs(problem.c * dW).sum() > 1.0:
            refused.append(h)
        return schemes.energy_preserving.step(problem, y, h, dW)

    limited = Scheme("limited", step, claims=["energy"], longest_step=1.0)
    report = verify(limited, laws="energy")
    found = report.finding("energy")
    assert not refused
    assert found.share is not None
    assert 0.7 < found.share < 0.9
    assert f"holds on {int(100 * found.share)} %" in str(report)
    assert report.exit_code == 0


def test_a_law_of_which_few_cases_are_left_does_not_hold() -> None:
    some = replace(schemes.energy_preserving, longest_step=lambda problem, y, h, dW: len(y) == 7)
    report = verify(some, laws="energy")
    assert report.findings[0].verdict is Verdict.INCONCLUSIVE
    assert "% of the cases were measured: a law holds on 25 % at least" in report.findings[0].message
    assert report.exit_code == 1
    (law,), log = load_laws(["energy"]), search.SearchLog()
    log.checks = 1
    for share, verdict in ((0.25, Verdict.HOLDS), (0.249, Verdict.INCONCLUSIVE)):
        log.share = share
        assert search.conclude(law, some, log, lambda *_: Measurement(0.0, 1.0)).verdict is verdict


def test_skipped_cases_are_counted_by_their_reason() -> None:
    log = search.SearchLog()
    log.checks = 4
    for reason, may in (("too long", True), ("too long", False), ("extreme", True)):
        log.skip(reason, may=may)
    assert (log.skipped, log.refused, log.lacking, log.checks) == ({"too long": 2, "extreme": 1}, 3, 1, 1)


# Of the subtler faults, those that err by a power of the step: their cases have to be made for
# them.
BROKEN = ("one-point-quadrature", "b-at-y0", "(2.1)")
SUBTLE = [f for f in POWER_FAULTS if f.broken in BROKEN and f.law != "reference"]


@pytest.mark.parametrize("fault", SUBTLE, ids=lambda f: f"{f.systems}-{f.law}-{f.broken}")
def test_a_fault_of_a_pair_of_strata_is_found_in_that_pair(fault: FaultOfLaw) -> None:
    strata, of_strata, pairs, of_pairs, missed = power(fault, measured(fault, 29))
    assert strata == of_strata
    # H = (y1 y3)^n is kept by one node too: a case of a few hundred pairs in several hundred may be
    # of that kind.
    assert pairs >= 0.97 * of_pairs, missed
    assert of_pairs > 500


@pytest.mark.parametrize(
    ("delta", "named"),
    [
        (lambda c, h, w: 1.001 * h + np.sum(c * w, axis=0), "nearly all of it is in h: alone it makes"),
        (lambda c, h, w: h + np.sum(c * w, axis=0) + 0.01 * np.sum((c * w)[1:2], axis=0),
         "nearly all of it is in c2 ΔW2: alone it makes"),
        (lambda c, h, w: h + (1 + 1e-3 * h) * np.sum(c * w, axis=0),
         "nearly all of it is in the product of h and c1 ΔW1, each of which alone makes none"),
    ],
)  # fmt: skip
def test_a_wrong_term_is_named(delta: Callable[..., Any], named: str) -> None:
    says(_with(delta)(), "reference", "violated", named, examples=8, corpus=False)


@pytest.mark.parametrize(("name", "law"), [("b-at-y0", "reference"), ("one-point-quadrature", "energy")])
def test_a_fault_of_every_part_has_no_name(name: str, law: str) -> None:
    found = says(SABOTEURS[name].scheme, law, "violated", examples=8, corpus=False)
    assert "nearly all of it" not in found.message


FOLDER = ROOT / "reference" / "witnesses"
SCHEMA = json.loads((FOLDER / "witnesses.schema.json").read_text())
FILES = {p.name for p in FOLDER.glob("*.json")} - {"witnesses.schema.json"}
LAWS = sorted(maker.searched_laws())


def test_every_searched_law_has_witnesses() -> None:
    assert {corpus.file_of(law) for law in LAWS} == FILES


@pytest.mark.parametrize("law", LAWS)
def test_files_are_as_the_schema_says_and_small(law: str) -> None:
    path = FOLDER / corpus.file_of(law)
    data = json.loads(path.read_text(encoding="utf-8"))
    assert fault(data, SCHEMA) == ""
    assert path.stat().st_size < 20_000
    assert maker.text_of(data) == path.read_text(encoding="utf-8")
    assert data["law"] == law
    for number, witness in enumerate(data["witnesses"], 1):
        assert witness["id"] == f"{law}/{number:02}"
        assert witness["hash"] == digest({k: v for k, v in witness.items() if k != "hash"})
        assert witness["found"] in witness["caught"]
        assert set(witness["caught"]) <= {*SABOTEURS, *schemes.PAPER, *schemes.EXTENSIONS, *schemes.DAMPED}
    per_class = [w["systems"] for w in data["witnesses"]]
    assert all(per_class.count(systems) <= maker.WITNESSES_MAX for systems in per_class)


# *Contract* makes thousands of steps of each scheme: of each class it asks three of them each time.
ASKED = [(law, 3 if law == "contract" else None) for law in LAWS]


@pytest.mark.parametrize(("law", "most"), but_deep([*ASKED, ("contract", None)], ("contract", None)))
def test_right_schemes_pass_every_witness_and_the_scheme_it_came_from_does_not(law, most):
    (asked,) = load_laws([law])
    for witness in corpus.witnesses(law):
        for scheme in maker.right(asked, witness.systems)[:most]:
            finding = asked.replay(asked, scheme, to_json(witness.case))
            good = (Verdict.HOLDS, Verdict.NOT_APPLICABLE)
            assert finding.verdict in good, (witness.id, scheme.name, finding.message)
        assert maker.accused(asked, maker.suspects_of(asked, witness.systems)[witness.found], witness.case), (
            witness.id
        )


@pytest.mark.parametrize("name", ["fixed-point", "python-loop", "line-search"])
def test_a_right_scheme_may_refuse_what_is_far_beyond_a_step(name: str) -> None:
    """Δ = 1000 for the oscillator, 3.5 for the rigid body:
    witnesses that were shrunk from long steps.
    """
    for law in ("reference", "energy"):
        (asked,) = load_laws([law])
        for witness in corpus.witnesses(law, Systems.SINGLE):
            finding = asked.replay(asked, RIGHT_SCHEMES[name], to_json(witness.case))
            assert finding.verdict in (Verdict.HOLDS, Verdict.NOT_APPLICABLE), (witness.id, finding.message)


def test_a_fault_that_is_known_is_found_at_once_and_simplified_from_there() -> None:
    scheme = SABOTEURS["b-at-y0"].scheme
    with_it = verify(scheme, laws=["casimir"]).findings[0]
    without = verify(scheme, laws=["casimir"], effort=Effort(corpus=False)).findings[0]
    assert with_it.verdict is without.verdict is Verdict.VIOLATED
    quick = verify(scheme, laws=["casimir"], effort=Effort(shrink_checks=0)).findings[0]
    assert quick.checks == 1
    known = corpus.witnesses("casimir", Systems.SINGLE)[0].case
    assert quick.replay.endswith(to_token(known))
    # Simplified from there: never to a larger one.
    assert size(from_json(with_it.witness)) <= size(known)


def test_teeth_leave_the_corpus_out_unless_asked() -> None:
    (found,) = fault_detection.detect("four-nodes", 0, ["energy"], 12)
    (known,) = fault_detection.detect("four-nodes", 0, ["energy"], 12, corpus=True)
    assert known.kills
    assert known.examples <= 2 * maker.WITNESSES_MAX < found.examples


def test_where_a_user_names_problems_only_these_are_asked() -> None:
    report = verify("midpoint", laws=["energy"], problems=["pendulum"], effort=Effort(shrink_checks=0))
    assert report.finding("energy").witness["problem"]["name"] == "pendulum"


def test_no_corpus_is_an_option_of_verify() -> None:
    shown = [command(f"verify energy-preserving --law noise-sum -q {o}").output for o in ("", "--no-corpus")]
    counts = [int(text.split("; ")[1].split(" check")[0]) for text in shown]
    assert counts[0] - counts[1] == len(corpus.cases("noise-sum", Systems.SINGLE))


def test_what_is_remembered_by_address_is_seen_wherever_records_lie() -> None:
    """Which address a new record gets depends on all that the process did before:
    9 of 100 were missed once.
    """
    (asked,) = load_laws(["contract"])
    (witness,) = (w for w in corpus.witnesses("contract") if w.found == "remembers-by-id")
    scheme, shuffled, kept = SABOTEURS["remembers-by-id"].scheme, Random(1), []
    for _ in range(40):
        gone = [[None] * shuffled.randrange(60) for _ in range(shuffled.randrange(2000))]
        shuffled.shuffle(gone)
        kept += gone[::2]
        del gone
        assert maker.accused(asked, scheme, witness.case)
