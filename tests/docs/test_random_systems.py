"""docs/random-systems.md: its test finds the planted fault, and passes for the scheme without
it.
"""

import re
from pathlib import Path
from typing import Any

import pytest

PAGE = (Path(__file__).parents[2] / "docs" / "random-systems.md").read_text(encoding="utf-8")
CODE = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)[0]
FAULT = "problem.structure(y), y\n"
MENDED = "problem.structure, y\n"


def names_of(code: str) -> dict[str, Any]:
    namespace: dict[str, Any] = {}
    exec(compile(code, "random-systems.md", "exec"), namespace)
    return namespace


def test_the_test_of_the_page_finds_the_planted_fault_and_prints_the_case() -> None:
    with pytest.raises(AssertionError) as found:
        names_of(CODE)["test_casimirs_are_kept"]()
    notes = "\n".join(getattr(found.value, "__notes__", []))
    assert "Case(H(y) = " in notes
    assert len(notes) < 2000


def test_the_test_of_the_page_passes_for_the_midpoint_rule() -> None:
    right = CODE.replace(FAULT, MENDED).replace("delta * B @", "delta * B((y + y1) / 2) @")
    assert right.count("B((y + y1) / 2)") == 1
    names_of(right)["test_casimirs_are_kept"]()


def test_the_strategies_of_the_page_are_those_of_the_module() -> None:
    from sepv import strategies

    for name in re.findall(r"`(\w+)\(", PAGE.split("```python")[0]):
        assert hasattr(strategies, name), name
