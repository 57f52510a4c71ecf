"""The suite detections: every saboteur is killed, every law is needed, and the matrix tells the truth about both."""

from __future__ import annotations

from io import StringIO

import pytest
from click.testing import CliRunner
from sepv.reference.faults import detection as fault_detection
from sepv.reference.faults.saboteurs import _BY_FAMILY, SABOTEURS, historical

from sepv.commands._cli import main
from sepv.console import console
from sepv.errors import UsageError
from sepv.problem import Systems
from sepv.schemes import (
    area_midpoint,
    both_invariants,
    by_name,
    collocation,
    conformal,
    darboux_lie,
    drift_preserving,
    energy_preserving,
    isospectral_midpoint,
    midpoint,
    modified_weak_two,
    several_structures,
    splitting,
    stochastic_midpoint,
    stochastic_splitting,
    weakly,
)
from sepv.verification import LAWS, Effort, Verdict, load_laws
from sepv.verification._cases.fixed_cases import fixed_cases, for_energy

# What these claim is what is wrong with them; all others claim exactly what (2.1) claims.
ORIGINALS = {
    Systems.SINGLE: collocation(2),
    Systems.NAMBU: both_invariants,
    Systems.SEVERAL: several_structures,
}
WRONG_CLAIMS = {"ito-limit", "half-claimed-as-one", "averaged-and-symplectic"}
IMITATED = {
    "off-the-middle": midpoint,
    "time-of-place": splitting,
    "triple-jump-in-digits": by_name("yoshida-4"),
    "force-of-first-kick": by_name("leapfrog"),
    "tangent-of-first": splitting,
    "scaled-a-little": splitting,
    "second-noise-louder": stochastic_midpoint,
    "away-from-the-origin": stochastic_midpoint,
    "areas-of-other-sign": area_midpoint,
    "lie-and-trotter": stochastic_splitting,
    "midpoint-as-isospectral": isospectral_midpoint,
    "damped-midpoint": conformal,
    "damped-rationally": conformal,
    "damped-at-once": conformal,
    "arithmetic-middle": darboux_lie,
    "halves-alike": drift_preserving,
    "pushed-too-far": drift_preserving,
    "structure-before-the-step": drift_preserving,
}


def expected(name: str) -> list[str]:
    return [law for law in LAWS if law in SABOTEURS[name].caught_by]


@pytest.mark.parametrize("name", SABOTEURS)
def test_each_saboteur_is_killed_by_a_law_that_theory_names(name: str) -> None:
    # By one of the laws that theory names with one of two seeds; the deep run below asks for each of ten.
    assert any(
        b.kills for seed in range(2) for b in fault_detection.detect(name, seed, expected(name), first=True)
    )


@pytest.mark.deep
@pytest.mark.parametrize("seed", fault_detection.SEEDS)
@pytest.mark.parametrize("name", SABOTEURS)
def test_each_saboteur_is_killed_with_every_seed(name: str, seed: int) -> None:
    assert any(b.kills for b in fault_detection.detect(name, seed, LAWS, first=True))


@pytest.mark.parametrize("law", LAWS)
def test_each_law_has_a_saboteur_that_it_must_catch(law: str) -> None:
    assert any(law in s.caught_by for s in SABOTEURS.values())


def test_no_name_stands_twice_and_each_saboteur_is_of_its_family() -> None:
    assert sum(map(len, _BY_FAMILY)) == len(SABOTEURS)
    assert all(s.family == family.name for family in _BY_FAMILY for s in family)


@pytest.mark.parametrize("name", SABOTEURS)
def test_each_saboteur_claims_what_the_scheme_claims(name: str) -> None:
    saboteur = SABOTEURS[name]
    assert set(saboteur.caught_by) <= set(LAWS)
    assert saboteur.scheme.name == name
    if saboteur.scheme.increments is not None:
        assert saboteur.scheme.claims == weakly(modified_weak_two, "three-point").claims
    elif saboteur.family == "higher order" and name not in IMITATED:
        assert saboteur.scheme.claims == ORIGINALS[saboteur.scheme.systems].claims
    elif saboteur.family == "historical":
        assert saboteur.scheme.claims == historical.RIGHT[name].claims
    elif name in IMITATED:
        assert saboteur.scheme.claims == IMITATED[name].claims
    elif name not in WRONG_CLAIMS:
        assert saboteur.scheme.claims == energy_preserving.claims


@pytest.mark.parametrize("name", [s.name for s in SABOTEURS.values() if s.family == "interface"])
def test_what_a_saboteur_remembers_ends_with_it(name: str) -> None:
    assert SABOTEURS[name].scheme.step is not SABOTEURS[name].scheme.step


def test_workers_find_what_one_process_finds() -> None:
    names, laws, effort = (
        ["b-at-y0", "two-half-steps"],
        ["casimir", "midpoint"],
        Effort(examples=4, corpus=False),
    )
    seen: list[int] = []
    found = fault_detection.run(
        names, [0], lambda done, total, _: seen.append(total - done), laws=laws, effort=effort
    )
    alone = [b for name in names for b in fault_detection.detect(name, 0, laws, 4)]
    assert [(b.saboteur, b.law, b.verdict, b.examples) for b in found] == [
        (b.saboteur, b.law, b.verdict, b.examples) for b in alone
    ]
    assert seen == [1, 0]


def test_the_first_kill_ends_a_saboteur_when_asked() -> None:
    (only,) = fault_detection.detect("relative-error-1e-10", 0, LAWS, first=True)
    assert only.kills
    assert only.law == "identity"


def test_examples_end_with_the_first_violation() -> None:
    (violated,) = fault_detection.detect("b-doubled", 0, ["midpoint"])
    (holding,) = fault_detection.detect("b-doubled", 0, ["energy"], examples=7)
    assert violated.examples < 20
    (energy,) = load_laws(["energy"])
    space = energy.cases.space(Systems.SINGLE)  # type: ignore[union-attr]
    assert space is not None
    designed = len(space.design().rows) + len(space.kinds)
    assert holding.examples == designed + 7 + len((*fixed_cases(), *for_energy()))


def test_an_unknown_name_is_an_error() -> None:
    with pytest.raises(UsageError, match="a saboteur, one of"):
        fault_detection.run(["b-at-y2"], [0])


def detect(
    name: str, law: str, seed: int, verdict: Verdict, examples: int, claimed: bool = True
) -> fault_detection.Detection:
    saboteur = SABOTEURS[name]
    return fault_detection.Detection(
        name, saboteur.family, law, seed, verdict, claimed, law in saboteur.caught_by, examples, 0.1
    )


DETECTIONS = [
    detect("b-at-y0", "energy", 0, Verdict.HOLDS, 100),
    detect("b-at-y0", "energy", 1, Verdict.HOLDS, 100),
    detect("b-at-y0", "casimir", 0, Verdict.VIOLATED, 4),
    detect("b-at-y0", "casimir", 1, Verdict.HOLDS, 100),
    detect("changes-y", "energy", 0, Verdict.ERROR, 1),
    detect("changes-y", "energy", 1, Verdict.ERROR, 1),
    detect("silent-cap", "rounding", 0, Verdict.ERROR, 3),
    detect("silent-cap", "rounding", 1, Verdict.VIOLATED, 9, claimed=False),
]


def test_an_error_kills_only_where_the_interface_is_at_fault() -> None:
    assert fault_detection.survivors(DETECTIONS) == {"b-at-y0": [1], "silent-cap": [0, 1]}
    assert fault_detection.examples_to_kill(DETECTIONS) == {
        ("b-at-y0", 0): 4,
        ("changes-y", 0): 1,
        ("changes-y", 1): 1,
    }
    assert fault_detection.found_by_one_law(DETECTIONS) == {"casimir": ["b-at-y0"], "energy": ["changes-y"]}
    assert fault_detection.missed(DETECTIONS) == [("silent-cap", "rounding")]


def test_the_matrix_names_what_survives() -> None:
    text = StringIO()
    fault_detection.show(DETECTIONS, console(text))
    lines = text.getvalue().splitlines()
    assert lines[0].split() == ["saboteur", "ene", "cas", "rou", "killed"]
    assert lines[1].split() == ["b-at-y0", "·", "(4)", "1/2"]
    assert lines[2].split() == ["changes-y", "e", "2/2"]
    assert "1 of 3 saboteurs killed with each of 2 seeds" in text.getvalue()
    assert "survives: b-at-y0, seed 1: B is taken at y0 and not at the midpoint" in text.getvalue()


def test_both_counts_are_printed_without_and_with_known_witnesses() -> None:
    asked = [
        "teeth",
        "unmoved-where-unsolved",
        "--law",
        "refusal",
        "--seeds",
        "1",
        "--workers",
        "1",
        "--corpus",
        "-q",
    ]
    done = CliRunner().invoke(main, asked)
    alone, known = (line for line in done.output.splitlines() if "killed with each of 1 seeds" in line)
    assert done.exit_code == 0
    assert alone.startswith("1 of 1 saboteurs")
    assert known.startswith("with known witnesses: 1 of 1 saboteurs")
