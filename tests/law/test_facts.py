"""Facts about systems: those of a class hold for each of its systems, and laws ask for facts."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest
from sepv.properties import load_laws

import sepv
from sepv import problems
from sepv.law.cases.classes import CLASSES
from sepv.law.cases.of_law import UNDAMPED
from sepv.law.cases.users_problems import items
from sepv.problem import FACTS, Problem, Systems
from sepv.schemes import LAWS

HERE = Path(sepv.__file__).parent


def members(systems: Systems) -> list[Problem]:
    """Systems of the cases of a class's design, and its named problems."""
    own = CLASSES[systems]
    named = [problems.by_name(p) if isinstance(p, str) else p() for p in (*own.named, *own.problems)]
    return [problems.build(case.problem) for _, case in own.space.part().cases(1)[::3]] + named


@pytest.mark.parametrize("systems", Systems)
def test_a_class_states_the_facts_that_all_its_systems_have(systems: Systems) -> None:
    found = members(systems)
    assert systems.facts == {fact for fact in FACTS if all(map(fact, found))}


def test_a_law_says_which_fact_a_class_and_a_problem_lack() -> None:
    asked = (load_laws([name])[0].cases for name in ("energy", "random-step", "poisson-map"))
    energy, step, map_ = (cases for cases in asked if cases is not None)
    assert "does not keep H_0" in str(energy.of_class(Systems.HAMILTONIANS))
    assert "does not keep H_0" in str(energy.of_problems(items("matrix-hamiltonians")))
    assert "there is no random step" in str(step.of_problems(items("commuting-rotations")))
    assert energy.of_problems(items("damped-top")) == UNDAMPED
    # Both noises have B, though each is also a structure times ∇H: the flow is a Poisson map.
    assert not isinstance(map_.of_problems(items("commuting-oscillators")), str)
    assert "one for each noise" in str(map_.of_problems(items("commuting-rotations")))


def test_laws_do_not_ask_for_a_class_where_a_fact_says_it() -> None:
    """A law's cases are restricted by facts (`needs`), and no class is left out by name, but where
    nobody makes cases.
    """
    for law in load_laws(LAWS):
        assert law.cases is None or set(law.cases.needs) <= set(FACTS)
        for systems, why in law.cases.no_cases_of.items() if law.cases else ():
            assert why
            assert systems.facts >= set(law.cases.needs)
    named = [
        (path.name, node.lineno)
        for room in (HERE, HERE.parent / "properties")
        for path in room.rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Compare) and "Systems." in ast.unparse(node)
    ]
    assert len(named) <= 15, named
