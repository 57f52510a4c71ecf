"""`help` of what `import sepv` gives: every argument is there, and every example runs."""

from __future__ import annotations

import doctest
import importlib
import inspect
import re
from dataclasses import fields

import pytest
from click.testing import CliRunner

import sepv
from sepv.commands._cli import main

FUNCTIONS = ("verify", "integrate", "ensemble", "exact_flow")
RECORDS = ("Problem", "Scheme", "Report", "Trajectory", "Ensemble", "Effort")
WITH_EXAMPLES = ("Problem", "Scheme", "verify", "integrate", "ensemble", "exact_flow", "peers.posing:pose",
                 "peers.posing:field_in")  # fmt: skip


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_functions_help_names_every_argument_and_what_it_returns(name: str) -> None:
    function = getattr(sepv, name)
    text = inspect.getdoc(function) or ""
    for argument in inspect.signature(function).parameters:
        assert argument in text.split("Returns\n")[0].replace(",", " ").split(), argument
    assert "Returns\n-------\n" in text


@pytest.mark.parametrize("name", RECORDS)
def test_a_records_help_names_every_field(name: str) -> None:
    record = getattr(sepv, name)
    words = (inspect.getdoc(record) or "").replace(",", " ").split()
    for field in inspect.signature(record).parameters:
        assert field in words, field


@pytest.mark.parametrize("name", WITH_EXAMPLES)
def test_examples_run(name: str) -> None:
    module, _, attribute = name.rpartition(":")
    value = getattr(importlib.import_module(f"sepv.{module}") if module else sepv, attribute)
    found = [t for t in doctest.DocTestFinder(recurse=False).find(value, attribute) if t.examples]
    assert found, "no example"
    for example in found:
        assert doctest.DocTestRunner().run(example).failed == 0


def test_the_help_of_verify_states_the_usual_effort() -> None:
    asked = CliRunner().invoke(main, ["verify", "--help"], terminal_width=200).output
    said = dict(re.findall(r"--([a-z-]+) .*\[default: (\d+)\]", asked))
    usual = {field.name.replace("_", "-"): str(field.default) for field in fields(sepv.Effort)}
    assert all(said[name] == usual[name] for name in ("examples", "paths", "shrink-checks"))
