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
    "sepv._version sepv.studies._palette sepv.plain_text sepv.widths",
    "sepv.errors",
    "sepv.arguments",
    "sepv.record._quadrature",
    "sepv.record",
    "sepv.problem._derived",
    "sepv.record._polynomial",
    "sepv.problem._nambu",
    "sepv.problem._problem",
    "sepv.problem._json",
    "sepv.problem._checks",
    "sepv.problem._fields sepv.problem._averaged_gradient",
    "sepv.problem._poisson",
    "sepv.problem._structures",
    "sepv.problem._hamiltonians",
    "sepv.schemes._tableaux",
    "sepv.problems",
    "sepv.problems._opaque",
    "sepv.solve._solution",
    "sepv.solve._differences sepv.solve._damped",
    "sepv.solve._implicit",
    "sepv.solve._formula",
    "sepv.solve._linearised",
    "sepv.solve._recorded",
    "sepv.solve._straight",
    "sepv.schemes._point_laws sepv.schemes._orders",
    "sepv.schemes._scheme",
    "sepv.schemes._further",
    "sepv.schemes._one_step",
    "sepv.schemes._explicit_tableaux",
    "sepv.schemes._division",
    "sepv.schemes._continuation",
    "sepv.schemes",
    "sepv.schemes._guard",
    "sepv.schemes._load",
    "sepv.simulate._wiener",
    "sepv.simulate._areas sepv.exact._log_flow",
    "sepv.exact._closed_forms sepv.exact._dense_flow sepv.exact._flow sepv.exact._several_structures",
    "sepv.verification._orders.gaussian",
    "sepv.simulate._results",
    "sepv.exact._clipping",
    "sepv.simulate._paths",
    "sepv.large",
    "sepv.simulate._engine",
    "sepv.verification._orders.convergence sepv.verification._orders.means sepv.verification._orders.tilting",
    "sepv.verification._tolerance",
    "sepv.verification._cases.case",
    "sepv.verification.strategies",
    "sepv.verification._cases.covering sepv.verification._cases.strata sepv.verification._cases.telling sepv.verification._cases.ingredients sepv.verification._cases.content sepv.verification._cases.spaces",
    "sepv.verification._cases.structures",
    "sepv.verification._cases.fixed_cases",
    "sepv.verification._cases.shrink",
    "sepv.verification._cases.families",
    "sepv.verification._cases.given sepv.verification._cases.poisson sepv.verification._cases.hamiltonians",
    "sepv.verification._law",
    "sepv.verification._levels",
    "sepv.verification._corpus",
    "sepv.verification._coverage",
    "sepv.verification._cases.same_draws",
    "sepv.reference",
    "sepv.verification._amplification",
    "sepv.verification._poisson_map",
    "sepv.verification._worst_path",
    "sepv.verification._orders.local_rules sepv.verification._orders.local_moments",
    "sepv.verification._search sepv.verification._sequential sepv.verification._orders.local_errors sepv.verification._orders.local_example sepv.verification._orders.local_orders sepv.verification._orders.weak_trees",
    "sepv.properties",
    "sepv.verification._expected sepv.verification._side_by_side",
    "sepv.verification._laws sepv.verification._outcome sepv.verification._deadline sepv.verification._verify",
    "sepv.verification._worker",
    "sepv.schemas sepv.files",
    "sepv.verification._report",
    "sepv.progress",
    "sepv.studies._evaluation_count sepv.studies._compare sepv.studies._bench",
    "sepv.external sepv.peers sepv.faults._saboteurs",
    "sepv.faults._fault_detection sepv.studies._hard_cases sepv.studies._solvability sepv.studies._ulps",
    "sepv.verification._submission",
    "sepv.studies._reproduce",
    "sepv.page",
    "sepv.commands",
    "sepv.commands._cli sepv.pytest_plugin",
]
# What looks upwards on purpose, inside a function: (module, what it imports there).
UPWARDS = {
    ("sepv.problem._problem", "sepv.problem._checks"),
    ("sepv.verification._outcome", "sepv.verification._report"),
}


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
    allowed = {
        "sepv.errors",
        "sepv.record._polynomial",
        "sepv.problem._problem",
        "sepv.problem._json",
        "sepv.reference",
    }
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
    assert not loaded & {"scipy", "hypothesis", "sepv.schemes", "sepv.solve._implicit"}
