"""Imports run one way, and nothing heavy is loaded before it is used."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]

# Lowest first: a module imports only from lines above its own (or, within a line, from those named before).
LAYERS = [
    "sepv._version sepv.palette sepv.plain_text sepv.widths",
    "sepv.errors",
    "sepv.arguments",
    "sepv.quadrature",
    "sepv.record",
    "sepv.derived",
    "sepv.polynomial",
    "sepv.nambu",
    "sepv.problem",
    "sepv.description",
    "sepv.checks",
    "sepv.fields sepv.average",
    "sepv.poisson",
    "sepv.structures",
    "sepv.hamiltonians",
    "sepv.tableaux",
    "sepv.problems",
    "sepv.opaque",
    "sepv.solution",
    "sepv.differences sepv.damped",
    "sepv.implicit",
    "sepv.formula",
    "sepv.linearised",
    "sepv.recorded",
    "sepv.straight",
    "sepv.point_laws sepv.orders",
    "sepv.scheme",
    "sepv.further",
    "sepv.one_step",
    "sepv.explicit_tableaux",
    "sepv.division",
    "sepv.continuation",
    "sepv.schemes",
    "sepv.candidate",
    "sepv.target",
    "sepv.wiener",
    "sepv.areas sepv.log_flow",
    "sepv.closed_forms sepv.dense sepv.exact sepv.exact_structures",
    "sepv.gaussian",
    "sepv.results",
    "sepv.clipping",
    "sepv.simulation",
    "sepv.large",
    "sepv.engine",
    "sepv.convergence sepv.means sepv.tilting",
    "sepv.tolerance",
    "sepv.case",
    "sepv.strategies",
    "sepv.covering sepv.strata sepv.telling sepv.ingredients sepv.content sepv.spaces",
    "sepv.strategies_structures",
    "sepv.corners",
    "sepv.shrink",
    "sepv.families",
    "sepv.given sepv.strategies_poisson sepv.strategies_hamiltonians",
    "sepv.law",
    "sepv.levels",
    "sepv.corpus",
    "sepv.coverage",
    "sepv.same_draws",
    "sepv.reference",
    "sepv.amplification",
    "sepv.poisson_map",
    "sepv.worst_path",
    "sepv.local_rules sepv.local_moments",
    "sepv.search sepv.sequential sepv.local_errors sepv.local_example sepv.local_orders sepv.weak_trees",
    "sepv.properties",
    "sepv.expected sepv.side_by_side",
    "sepv.laws sepv.outcome sepv.deadline sepv.suite",
    "sepv.worker",
    "sepv.schemas sepv.files",
    "sepv.report",
    "sepv.progress",
    "sepv.work sepv.compare sepv.bench",
    "sepv.external sepv.adapters sepv.saboteurs",
    "sepv.teeth sepv.stability sepv.solvability sepv.ulps",
    "sepv.submission",
    "sepv.reproduce",
    "sepv.page",
    "sepv.commands",
    "sepv.cli sepv.pytest_plugin",
]
# What looks upwards on purpose, inside a function: (module, what it imports there).
UPWARDS = {("sepv.problem", "sepv.checks"), ("sepv.outcome", "sepv.report")}


def layer_of(module: str) -> int:
    for number, line in enumerate(LAYERS):
        if any(module == name or module.startswith(name + ".") for name in line.split()):
            return number
    raise AssertionError(f"{module} has no layer: add it to LAYERS")


def modules() -> dict[str, Path]:
    found = {}
    for folder, prefix in (
        ("sepv", "sepv"),
        ("properties", "sepv.properties"),
        ("reference", "sepv.reference"),
    ):
        for path in sorted((ROOT / folder).rglob("*.py")):
            parts = path.relative_to(ROOT / folder).with_suffix("").parts
            name = ".".join((prefix, *(p for p in parts if p != "__init__")))
            if name not in ("sepv", "sepv.__main__", "sepv.properties"):
                found[name] = path
    return found


def imports(path: Path) -> set[str]:
    names = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names |= {f"{node.module}.{a.name}" if node.module == "sepv" else node.module for a in node.names}
    return {n for n in names if n.startswith("sepv.")}


@pytest.mark.parametrize("module", modules())
def test_arrows_point_one_way(module: str) -> None:
    own = layer_of(module)
    for name in imports(modules()[module]):
        assert layer_of(name) <= own or (module, name) in UPWARDS, (
            f"{module} imports {name}, which is above it"
        )


def test_the_oracle_imports_no_suspect() -> None:
    allowed = {"sepv.errors", "sepv.polynomial", "sepv.problem", "sepv.description", "sepv.reference"}
    for module, path in modules().items():
        if module.startswith("sepv.reference"):
            for name in imports(path):
                assert any(name == a or name.startswith(a + ".") for a in allowed), f"{module} imports {name}"


def test_laws_do_not_import_their_neighbours() -> None:
    for module, path in modules().items():
        if module.startswith("sepv.properties"):
            assert not any(name.startswith("sepv.properties") for name in imports(path)), module


def loaded_by(statement: str) -> set[str]:
    code = f"import sys; {statement}; print(' '.join(sys.modules))"
    return set(
        subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True
        ).stdout.split()
    )


def test_import_sepv_loads_nothing_heavy() -> None:
    loaded = loaded_by("import sepv")
    assert not loaded & {"numpy", "scipy", "hypothesis", "mpmath", "rich", "click"}


def test_schemes_and_problems_need_numpy_only() -> None:
    loaded = loaded_by("from sepv import schemes, problems; schemes.energy_preserving, problems.pendulum()")
    assert "numpy" in loaded
    assert not loaded & {"scipy", "hypothesis", "mpmath", "rich", "click", "pytest"}


def test_the_references_need_no_numpy_algebra() -> None:
    loaded = loaded_by("import sepv.reference.implicit")
    assert not loaded & {"scipy", "hypothesis", "sepv.schemes", "sepv.implicit"}
