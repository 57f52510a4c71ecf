"""The corpus of witnesses: what is in the files, that right schemes pass them, and that they are asked first."""

import json
from random import Random

import pytest
from doors import ROOT, command
from sepv.reference.faults import detection as fault_detection
from sepv.reference.faults.saboteurs import SABOTEURS
from sepv.reference.vector import digest

from benchmarks import witnesses as maker
from benchmarks.right_schemes import RIGHT
from sepv import schemes
from sepv.files import fault
from sepv.problem import Systems
from sepv.verification import Effort, Verdict, load_laws, verify
from sepv.verification import _corpus as corpus
from sepv.verification._cases.case import to_json, to_token

FOLDER = ROOT / "reference" / "witnesses"
SCHEMA = json.loads((FOLDER / "witnesses.schema.json").read_text())
LAWS = sorted(p.stem for p in FOLDER.glob("*.json") if p.name != "witnesses.schema.json")


def test_every_searched_law_has_witnesses() -> None:
    assert sorted(maker.searched_laws()) == LAWS


@pytest.mark.parametrize("law", LAWS)
def test_files_are_as_the_schema_says_and_small(law: str) -> None:
    path = FOLDER / f"{law}.json"
    data = json.loads(path.read_text(encoding="utf-8"))
    assert fault(data, SCHEMA) == ""
    assert path.stat().st_size < 20_000
    assert maker.text_of(data) == path.read_text(encoding="utf-8")
    assert data["law"] == law
    for number, witness in enumerate(data["witnesses"], 1):
        assert witness["id"] == f"{law}/{number:02}"
        assert witness["hash"] == digest({k: v for k, v in witness.items() if k != "hash"})
        assert witness["found"] in witness["caught"]
        assert set(witness["caught"]) <= {*SABOTEURS, *schemes.PAPER, *schemes.EXTENSIONS}
    per_class = [w["systems"] for w in data["witnesses"]]
    assert all(per_class.count(systems) <= maker.MOST for systems in per_class)


@pytest.mark.parametrize("law", LAWS)
def test_right_schemes_pass_every_witness_and_the_scheme_it_came_from_does_not(law: str) -> None:
    (asked,) = load_laws([law])
    for witness in corpus.witnesses(law):
        for scheme in maker.right(asked, witness.systems):
            finding = asked.replay(asked, scheme, to_json(witness.case))
            # What may be refused is left out.
            good = (Verdict.HOLDS, Verdict.NOT_APPLICABLE)
            assert finding.verdict in good, (witness.id, scheme.name, finding.message)
        assert maker.accused(asked, maker.suspects_of(asked, witness.systems)[witness.found], witness.case), (
            witness.id
        )


@pytest.mark.parametrize("name", ["fixed-point", "python-loop", "line-search"])
def test_a_right_scheme_may_refuse_what_is_far_beyond_a_step(name: str) -> None:
    """Δ = 1000 for the oscillator, 3.5 for the rigid body: witnesses that were shrunk from long steps."""
    for law in ("reference", "energy"):
        (asked,) = load_laws([law])
        for witness in corpus.witnesses(law, Systems.SINGLE):
            finding = asked.replay(asked, RIGHT[name], to_json(witness.case))
            assert finding.verdict in (Verdict.HOLDS, Verdict.NOT_APPLICABLE), (witness.id, finding.message)


def test_a_fault_that_is_known_is_found_at_once_and_simplified_from_there() -> None:
    scheme = SABOTEURS["b-at-y0"].scheme
    with_it = verify(scheme, laws=["casimir"]).findings[0]
    without = verify(scheme, laws=["casimir"], effort=Effort(corpus=False)).findings[0]
    assert with_it.verdict is without.verdict is Verdict.VIOLATED
    quick = verify(scheme, laws=["casimir"], effort=Effort(shrink_checks=0)).findings[0]
    assert quick.checks == 1
    assert quick.replay.endswith(to_token(corpus.witnesses("casimir", Systems.SINGLE)[0].case))
    # Simplified from there: never to a longer one.
    assert len(with_it.replay) <= len(quick.replay)


def test_teeth_leave_the_corpus_out_unless_asked() -> None:
    (found,) = fault_detection.detect("four-nodes", 0, ["energy"], 12)
    (known,) = fault_detection.detect("four-nodes", 0, ["energy"], 12, corpus=True)
    assert known.kills
    assert known.examples <= 2 * maker.MOST < found.examples


def test_where_a_user_names_problems_only_these_are_asked() -> None:
    report = verify("midpoint", laws=["energy"], problems=["pendulum"], effort=Effort(shrink_checks=0))
    assert report.finding("energy").witness["problem"]["name"] == "pendulum"


def test_no_corpus_is_an_option_of_verify() -> None:
    shown = [command(f"verify energy-preserving --law noise-sum -q {o}").output for o in ("", "--no-corpus")]
    counts = [int(text.split("; ")[1].split(" check")[0]) for text in shown]
    assert counts[0] - counts[1] == len(corpus.cases("noise-sum", Systems.SINGLE))


def test_what_is_remembered_by_address_is_seen_wherever_records_lie() -> None:
    """Which address a new record gets depends on all that the process did before: 9 of 100 were missed once."""
    (asked,) = load_laws(["contract"])
    (witness,) = (w for w in corpus.witnesses("contract") if w.found == "remembers-by-id")
    scheme, shuffled, kept = SABOTEURS["remembers-by-id"].scheme, Random(1), []
    for _ in range(40):
        gone = [[None] * shuffled.randrange(60) for _ in range(shuffled.randrange(2000))]
        shuffled.shuffle(gone)
        kept += gone[::2]
        del gone
        assert maker.accused(asked, scheme, witness.case)
