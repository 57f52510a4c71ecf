"""The pytest plugin. It never loads itself: ``pytest -p sepv.pytest_plugin`` loads it.

``pytest -p sepv.pytest_plugin --pyargs sepv.properties --scheme mypkg.mymodule:step`` runs the laws
on your scheme. If pytest is called without a path, the laws run, beside your own tests, on the
schemes in the ini file's list ``sepv_schemes``. A test module may have such a list too. If no
scheme is named, the laws run on the built-in schemes.

A claimed law must hold. The test of an unclaimed law, or of a law that does not apply, is skipped
and shows the measurement. A law that ends in an error fails, claimed or not. ``--expected FILE``
takes a file that ``sepv verify --pin`` wrote: a violation that the file does not list fails, and so
does a listed violation that no longer occurs.
"""

from __future__ import annotations

import secrets
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from sepv.errors import SepvError, UsageError
from sepv.law import Effort, Finding, Law, LawViolated, Run, Verdict, has_words
from sepv.schemes import Scheme
from sepv.verification import Expectations

# The findings of this run. They are properties of tests, because pytest-xdist and JUnit files carry
# properties.
_FINDINGS = pytest.StashKey[list[dict[str, str]]]()
_RUNS = pytest.StashKey[dict[tuple[str, Effort], Run]]()
_PROPERTY_KEYS = ("sepv_scheme", "sepv_law", "sepv_verdict", "sepv_claimed", "sepv_name")
_EFFORT = pytest.StashKey[Effort]()
_EXPECTED = pytest.StashKey[Expectations]()


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the options --scheme, --sepv-… and --expected, and the ini value sepv_schemes."""
    group = parser.getgroup("sepv", "verification of energy-preserving integrators")
    group.addoption(
        "--scheme", action="append", default=[], metavar="MODULE:ATTR", help="scheme to verify; repeatable"
    )
    group.addoption(
        "--sepv-examples", type=int, default=None,
        help=f"examples for each law (default {Effort.examples}, after its design)",
    )  # fmt: skip
    group.addoption(
        "--sepv-paths", type=int, default=None, help=f"most paths for a law (default {Effort.paths})"
    )
    group.addoption(
        "--sepv-shrink-checks", type=int, default=None,
        help=f"checks to simplify a counterexample with; 0 leaves it as found (default {Effort.shrink_checks})",
    )  # fmt: skip
    group.addoption("--sepv-seed", default="0", help="seed of examples and paths, or 'fresh' for a new one")
    group.addoption(
        "--expected", "--sepv-expected", dest="sepv_expected", default=None, metavar="FILE",
        help="claims and known violations of one scheme, as sepv verify --pin writes them",
    )  # fmt: skip
    group.addoption(
        "--agrees-with", dest="sepv_twin", default=None, metavar="MODULE:ATTR",
        help="a second program that should make the steps of each scheme (law agreement)",
    )  # fmt: skip
    group.addoption("--sepv-bits", action="store_true", help="with --agrees-with: steps of equal bits")
    parser.addini("sepv_schemes", "schemes to verify, one a line", type="linelist")
    parser.addini("sepv_expected", "the same as --expected, relative to the ini file")


def pytest_configure(config: pytest.Config) -> None:
    """Read the options: the effort, the expectations, and the laws to run for schemes of the ini
    file.
    """
    given = config.getoption("--sepv-seed")
    if given != "fresh" and not given.isdigit():
        raise pytest.UsageError(f"--sepv-seed: expected an integer ≥ 0 or 'fresh', received {given!r}")
    seed = secrets.randbits(32) if given == "fresh" else int(given)
    default, shrink = Effort(), config.getoption("--sepv-shrink-checks")
    config.stash[_EFFORT] = Effort(
        examples=config.getoption("--sepv-examples") or default.examples,
        paths=config.getoption("--sepv-paths") or default.paths,
        seed=seed,
        shrink_checks=default.shrink_checks if shrink is None else shrink,
    )
    config.stash[_FINDINGS], config.stash[_RUNS] = [], {}
    config.pluginmanager.register(_Collector(config))
    config.stash[_EXPECTED] = _expectations(config)
    # Schemes of the ini file are for runs of all tests; a run with a path does not use them.
    if config.getini("sepv_schemes") and config.args_source is not pytest.Config.ArgsSource.ARGS:
        from sepv import properties

        laws = str(Path(properties.__file__).parent)
        if laws not in config.args:
            config.args.append(laws)


def _expectations(config: pytest.Config) -> Expectations:
    """Read the expectations from the file that --expected or the ini value names;
    empty if neither names one.
    """
    from sepv.verification import ALL_LAWS
    from sepv.verification import load_expectations as load

    file = config.getoption("sepv_expected") or config.getini("sepv_expected")
    if not file:
        return Expectations()
    base = config.invocation_params.dir if config.getoption("sepv_expected") else config.rootpath
    try:
        return load(base / file, ALL_LAWS)
    except UsageError as error:
        raise pytest.UsageError(str(error)) from error


def pytest_report_header(config: pytest.Config) -> str:
    """Report the seed, so that a run can be repeated."""
    return f"sepv: --sepv-seed {config.stash[_EFFORT].seed}"


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Make one test for each law and scheme."""
    if "scheme" not in metafunc.fixturenames or not _is_law(metafunc.module):
        return
    from sepv.schemes import PAPER
    from sepv.verification import load_candidate

    targets = metafunc.config.getoption("--scheme") or getattr(metafunc.module, "sepv_schemes", None)
    names = targets or metafunc.config.getini("sepv_schemes") or list(PAPER)
    try:
        twin, claims = _twin(metafunc.config), metafunc.config.stash[_EXPECTED].claims or ()
        schemes = [load_candidate(name, claims, twin=twin) for name in names]
    except SepvError as error:
        # One error, without the frames of pytest; the remaining tests would only repeat the error.
        metafunc.definition.session.shouldfail = "there is no scheme to verify"
        raise pytest.Collector.CollectError(str(error)) from None
    if len(names) > 1 and metafunc.config.stash[_EXPECTED] != Expectations():
        raise pytest.UsageError(
            f"--expected is about one scheme, and there are {len(names)}: name it with --scheme"
        )
    metafunc.parametrize("scheme", schemes, ids=names, scope="session")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out the laws about two programs, unless --agrees-with names the second."""
    from sepv.schemes import OF_TWINS

    if config.getoption("sepv_twin"):
        return
    of_twins = [item for item in items if _law_of(item) in OF_TWINS]
    config.hook.pytest_deselected(items=of_twins)
    items[:] = [item for item in items if _law_of(item) not in OF_TWINS]


def _law_of(item: pytest.Item) -> str | None:
    module = getattr(item, "module", None)
    return module.law.name if module is not None and _is_law(module) else None


def _twin(config: pytest.Config) -> Any:
    """The `sepv.schemes.Twin` of --agrees-with, or None."""
    from sepv.schemes import as_twin

    return as_twin(config.getoption("sepv_twin"), config.getoption("--sepv-bits"))


def _is_law(module: Any) -> bool:
    return isinstance(getattr(module, "law", None), Law)


@pytest.fixture(scope="session")
def effort(request: pytest.FixtureRequest) -> Effort:
    """The effort of the laws."""
    return request.config.stash[_EFFORT]


@pytest.hookimpl(wrapper=True)
def pytest_pyfunc_call(pyfuncitem: pytest.Function) -> Any:
    """Make a law's finding the outcome of its test, with the finding's text and without the frames
    of sepv.
    """
    if not _is_law(pyfuncitem.module):
        return (yield)
    from sepv import verification
    from sepv.law import collecting, require_named

    listed, runs = pyfuncitem.config.stash[_EXPECTED], pyfuncitem.config.stash[_RUNS]
    target = pyfuncitem.callspec.id if hasattr(pyfuncitem, "callspec") else "TARGET"

    def measure(chosen: Law, scheme: Scheme, this_run: Run) -> Finding:
        run = runs.setdefault((target, this_run.effort), this_run)
        failure = listed.failures.get(chosen.name)
        if failure is not None:
            require_named(failure.witness, scheme)
        if not chosen.claimed_by(scheme) and not listed.is_pin:
            # The violation of an unclaimed law is shown as one line, so its counterexample is not
            # simplified. An error is shown in full, so the law is measured again with the full
            # effort.
            finding = verification.measure(
                chosen, scheme, replace(run, effort=replace(run.effort, shrink_checks=0)), failure=failure
            )
            if finding.verdict is not Verdict.ERROR:
                return finding
        return verification.measure(chosen, scheme, run, failure=failure)

    findings: list[Finding] = []
    result: Any = None
    with collecting(findings, measure):
        try:
            result = yield
        except LawViolated:
            pass  # `_conclude` below judges the finding, with a shorter text
        except SepvError as error:
            pytest.fail(str(error), pytrace=False)
    for finding in findings:
        # The name of the scheme in reports and pins: that of a `Scheme` record, else the target.
        given = pyfuncitem.callspec.params if hasattr(pyfuncitem, "callspec") else {}
        name = getattr(given.get("scheme"), "name", target)
        row = (target, finding.law, finding.verdict.text, "yes" if finding.claimed else "no", name)
        pyfuncitem.user_properties.extend(zip(_PROPERTY_KEYS, row, strict=True))
        twin = _twin(pyfuncitem.config)
        _conclude(finding, target + (twin.options if twin else ""), listed.claims)
    return result


def _conclude(finding: Finding, target: str, pinned: frozenset[str] | None) -> None:
    """End a law's test: it passes, fails, is skipped, or is an expected failure (xfail)."""
    from sepv.verification import fails

    __tracebackhide__ = True
    named = finding.replay and has_words(finding.witness)
    replay = f"replay: sepv verify {target} {finding.replay}" if named else ""
    text = "\n".join(part for part in (finding.words, finding.message, replay) if part)
    if finding.waived:
        pytest.xfail(finding.words)
    if fails(finding, pinned) or finding.verdict is Verdict.ERROR:
        unlisted = not finding.claimed and finding.expected is None and finding.verdict is not Verdict.ERROR
        pytest.fail(text + ("\nneither claimed nor in the pin" if unlisted else ""), pytrace=False)
    if finding.verdict is Verdict.NOT_APPLICABLE:
        pytest.skip(f"{finding.words}: {' '.join(finding.message.split())}")
    if not finding.claimed:
        pytest.skip(f"not claimed; {finding.words}")


class _Collector:
    """The collector of findings for the table at the end,
    from this process or the workers of pytest-xdist.
    """

    def __init__(self, config: pytest.Config) -> None:
        self.config = config

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        row = {key: str(value) for key, value in report.user_properties if key in _PROPERTY_KEYS}
        if report.when == "call" and row:
            self.config.stash[_FINDINGS].append(row)


def pytest_terminal_summary(terminalreporter: Any, config: pytest.Config) -> None:
    """Print a table of laws for each scheme after the tests."""
    findings = config.stash[_FINDINGS]
    if not findings:
        return
    terminalreporter.section("laws (+ claimed)")
    width = max(20, *(len(row["sepv_law"]) + 1 for row in findings))
    for scheme in dict.fromkeys(row["sepv_scheme"] for row in findings):
        terminalreporter.write_line(scheme)
        for row in findings:
            if row["sepv_scheme"] == scheme:
                claimed = " +" if row["sepv_claimed"] == "yes" else ""
                terminalreporter.write_line(f"  {row['sepv_law']:<{width}}{row['sepv_verdict']}{claimed}")
    # --expected is about one scheme.
    for gap in config.stash[_EXPECTED].gaps(
        dict.fromkeys(row["sepv_law"] for row in findings), findings[0]["sepv_name"]
    ):
        terminalreporter.write_line(gap, yellow=True)
