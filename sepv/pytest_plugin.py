"""The pytest door. Opt-in: ``pytest -p sepv.pytest_plugin``; it never loads itself.

``pytest -p sepv.pytest_plugin --pyargs sepv.properties --scheme mypkg.mymodule:step`` runs the laws on a scheme
of yours; without ``--scheme`` (or ini ``sepv_schemes``, or a list of that name in a test module) on the
built-in ones. Claimed laws must hold. Others are
measured; the matrix at the end shows both.
"""

from __future__ import annotations

import secrets
from typing import Any

import pytest

from sepv.errors import SepvError
from sepv.law import Effort, Finding
from sepv.scheme import Scheme

_FINDINGS = pytest.StashKey[list[tuple[Scheme, Finding]]]()
_EFFORT = pytest.StashKey[Effort]()


def pytest_addoption(parser: pytest.Parser) -> None:
    """--scheme, --sepv-examples, --sepv-paths, --sepv-seed, and ini sepv_schemes."""
    group = parser.getgroup("sepv", "verification of energy-preserving integrators")
    group.addoption(
        "--scheme", action="append", default=[], metavar="MODULE:ATTR", help="scheme to verify; repeatable"
    )
    group.addoption("--sepv-examples", type=int, default=None, help="examples for each law (default 100)")
    group.addoption("--sepv-paths", type=int, default=None, help="most paths for a law (default 8192)")
    group.addoption("--sepv-seed", default="0", help="seed of examples and paths, or 'fresh' for a new one")
    parser.addini("sepv_schemes", "schemes to verify, one a line", type="linelist")


def pytest_configure(config: pytest.Config) -> None:
    """Read the effort once."""
    given = config.getoption("--sepv-seed")
    if given != "fresh" and not given.isdigit():
        raise pytest.UsageError(f"--sepv-seed: expected an integer ≥ 0 or 'fresh', received {given!r}")
    seed = secrets.randbits(32) if given == "fresh" else int(given)
    default = Effort()
    config.stash[_EFFORT] = Effort(
        examples=config.getoption("--sepv-examples") or default.examples,
        paths=config.getoption("--sepv-paths") or default.paths,
        seed=seed,
    )
    config.stash[_FINDINGS] = []


def pytest_report_header(config: pytest.Config) -> str:
    """The seed, so that a run can be repeated."""
    return f"sepv: --sepv-seed {config.stash[_EFFORT].seed}"


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """One test for each law and scheme."""
    if "scheme" not in metafunc.fixturenames or not _is_law(metafunc.module):
        return
    from sepv.schemes import ALL
    from sepv.target import load_scheme

    asked = metafunc.config.getoption("--scheme") or getattr(metafunc.module, "sepv_schemes", None)
    names = asked or metafunc.config.getini("sepv_schemes") or list(ALL)
    try:
        schemes = [load_scheme(name) for name in names]
    except SepvError as error:
        raise pytest.UsageError(str(error)) from error
    metafunc.parametrize("scheme", schemes, ids=names, scope="session")


def _is_law(module: Any) -> bool:
    from sepv.law import Law

    return isinstance(getattr(module, "law", None), Law)


@pytest.fixture(scope="session")
def effort(request: pytest.FixtureRequest) -> Effort:
    """How hard the laws look; it also keeps sampled paths for the laws that share them."""
    return request.config.stash[_EFFORT]


@pytest.hookimpl(wrapper=True)
def pytest_pyfunc_call(pyfuncitem: pytest.Function) -> Any:
    """Collect what the laws found, for the matrix."""
    if not _is_law(pyfuncitem.module):
        return (yield)
    from sepv import law

    found: list[Finding] = []
    with law.collecting(found):
        try:
            return (yield)
        finally:
            scheme: Any = pyfuncitem.funcargs["scheme"]
            pyfuncitem.config.stash[_FINDINGS].extend((scheme, finding) for finding in found)


def pytest_terminal_summary(terminalreporter: Any, config: pytest.Config) -> None:
    """Scheme × law."""
    found = config.stash[_FINDINGS]
    if not found:
        return
    laws = list(dict.fromkeys(f.law for _, f in found))
    terminalreporter.section("laws (+ claimed)")
    for name in dict.fromkeys(s.name for s, _ in found):
        terminalreporter.write_line(name)
        row = {f.law: f for s, f in found if s.name == name}
        for law in laws:
            if law in row:
                terminalreporter.write_line(
                    f"  {law:<20}{row[law].verdict.text}{' +' if row[law].claimed else ''}"
                )
