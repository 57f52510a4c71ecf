"""The pytest door: opt-in, on built-in schemes and on others', also from an installed wheel."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from doors import ROOT

from sepv.schemes import midpoint
from sepv.verification import ALL_LAWS, Effort, load_laws, pin, verify

pytest_plugins = ["pytester"]
# What a run in this process imports first, pytester forgets afterwards, and NumPy's extensions load
# once in a process.
load_laws()

DOOR = ("-p", "sepv.pytest_plugin", "-p", "no:cacheprovider", "--sepv-examples", "8", "--sepv-paths", "256")
STEPS = "test_energy or test_casimir or identity"
OTHERS = len(ALL_LAWS) - 3

MINE = """
import sepv
from sepv.schemes._midpoint import step

honest = sepv.Scheme("honest", step, claims=["casimir", "identity"])
liar = sepv.Scheme("liar", step, claims=["energy"])
gained = sepv.Scheme("gained", sepv.schemes.energy_preserving.step)
"""


@pytest.fixture(autouse=True)
def own_modules(monkeypatch: pytest.MonkeyPatch) -> None:
    """Modules of the same names that other tests left behind are not those of these."""
    for name in ("mine", "test_own", "test_mine", "broken"):
        monkeypatch.delitem(sys.modules, name, raising=False)


def laws(pytester: pytest.Pytester, *words: str, k: str = STEPS, alone: bool = False) -> pytest.RunResult:
    """Some laws, in this process, which has imported sepv, or in one of their own."""
    pytester.makepyfile(mine=MINE)
    pytester.syspathinsert()
    run = pytester.runpytest_subprocess if alone else pytester.runpytest_inprocess
    return run(*DOOR, "--pyargs", "sepv.properties", "-k", k, *words)


def test_it_never_loads_itself(pytester: pytest.Pytester) -> None:
    has = "request.config.pluginmanager.hasplugin('sepv.pytest_plugin')"
    pytester.makepyfile(f"def test_nothing(request): assert not {has}")
    pytester.runpytest_subprocess().assert_outcomes(passed=1)


def test_a_scheme_that_keeps_its_claims_passes(pytester: pytest.Pytester) -> None:
    # *contract*, which everybody claims, takes a second, and is asked here alone.
    result = laws(pytester, "--scheme", "mine:honest", k=f"({STEPS}) or contract")
    result.assert_outcomes(passed=3, skipped=1, deselected=OTHERS - 1)
    result.stdout.fnmatch_lines(["*(+ claimed)*", "mine:honest", "*casimir*holds +*", "*energy*violated*"])


def test_a_scheme_that_breaks_a_claim_fails_with_a_counterexample(pytester: pytest.Pytester) -> None:
    result = laws(pytester, "--scheme", "mine:liar", "--scheme", "mine:honest")
    result.assert_outcomes(passed=2, failed=1, skipped=3, deselected=2 * OTHERS)
    shown = result.stdout.str()
    result.stdout.fnmatch_lines(
        [
            "energy (Prop. 3.1) violated: * against * ulp of H",
            "*H(y1) − H(y0)*",
            "replay: sepv verify mine:liar --law energy --replay *",
        ]
    )
    # Verdict, witness and replay; nothing of how sepv is made.
    assert not [words for words in ("search.py", "LawViolated", "def require") if words in shown]


def test_a_second_program_is_compared_and_named_in_the_replay(pytester: pytest.Pytester) -> None:
    asked = ("--scheme", "mine:honest", "--agrees-with")
    laws(pytester, *asked, "midpoint", "--sepv-bits", k="test_agreement").assert_outcomes(
        passed=1, deselected=len(ALL_LAWS) - 1
    )
    other = laws(pytester, *asked, "energy-preserving", k="test_agreement")
    other.assert_outcomes(failed=1, deselected=len(ALL_LAWS) - 1)
    other.stdout.fnmatch_lines(
        ["replay: sepv verify mine:honest --agrees-with energy-preserving --law agreement*"]
    )


def test_what_is_not_claimed_or_does_not_apply_is_skipped_with_what_was_measured(
    pytester,
):
    asked = ("-rs", "--scheme", "mine:honest", "--junitxml", "out.xml")
    result = laws(pytester, *asked, k="test_energy or test_reproducibility")
    result.assert_outcomes(skipped=2, deselected=len(ALL_LAWS) - 2)
    result.stdout.fnmatch_lines_random(
        [
            "SKIPPED*not claimed; energy (Prop. 3.1) violated: * against * ulp of H*",
            "SKIPPED*reproducibility (contract) not applicable: the scheme takes one state at a time*",
        ]
    )
    junit = (pytester.path / "out.xml").read_text()
    assert 'skipped="2"' in junit
    assert 'name="sepv_verdict" value="violated"' in junit


def test_a_pin_is_strict_both_ways_here_too(pytester: pytest.Pytester) -> None:
    finding = verify(midpoint, laws=["energy"], effort=Effort(8, 64, 0, 0)).finding("energy")
    (pytester.path / "pin.toml").write_text(pin("honest", [finding]))
    known = laws(pytester, "--scheme", "mine:honest", "--expected", "pin.toml")
    assert "was written for" not in known.stdout.str()
    known.assert_outcomes(passed=2, xfailed=1, deselected=OTHERS)
    gained = laws(pytester, "--scheme", "mine:gained", "--expected", "pin.toml")
    gained.assert_outcomes(skipped=2, failed=1, deselected=OTHERS)
    gained.stdout.fnmatch_lines(["*expected to be violated*remove the entry*"])


def test_schemes_of_the_ini_file_run_beside_the_own_tests(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(mine=MINE, test_own="def test_own(): pass")
    pytester.makepyprojecttoml(
        '[tool.pytest.ini_options]\naddopts = "-p sepv.pytest_plugin"\nsepv_schemes = ["mine:honest"]\n'
    )
    pytester.syspathinsert()
    few = ("--sepv-examples", "5", "-p", "no:cacheprovider", "-k", "test_own or test_identity")
    pytester.runpytest_inprocess(*few).assert_outcomes(passed=2, deselected=len(ALL_LAWS) - 1)
    # Whoever names a path asks for that alone.
    pytester.runpytest_inprocess(*few, "test_own.py").assert_outcomes(passed=1)


def test_an_error_fails_claimed_or_not(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(broken="def step(problem, y, h, dW):\n    raise RuntimeError('out of order')\n")
    result = laws(pytester, "--scheme", "broken:step")
    result.assert_outcomes(failed=3, deselected=OTHERS)
    result.stdout.fnmatch_lines(["*energy (Prop. 3.1) error*", "*out of order*"])


def test_two_lines_in_a_test_file_do_as_well(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(
        mine=MINE,
        test_mine="from sepv.properties.test_casimir import law, test_casimir\nsepv_schemes = ['mine:honest']\n",
    )
    pytester.syspathinsert()
    pytester.runpytest_inprocess(*DOOR).assert_outcomes(passed=1)


def test_it_works_with_xdist_and_junitxml(pytester: pytest.Pytester) -> None:
    few = "(test_casimir or identity) and not drift"
    result = laws(pytester, "--scheme", "mine:honest", "-n", "1", "--junitxml", "out.xml", k=few, alone=True)
    result.assert_outcomes(passed=2)
    assert 'tests="2"' in (pytester.path / "out.xml").read_text()
    result.stdout.fnmatch_lines(["*laws (+ claimed)*", "  casimir * holds +"])


@pytest.mark.parametrize("name", ["nosuch", "mine:nosuch", "nosuchmodule:step"])
def test_a_wrong_scheme_is_said_once_with_a_remedy(pytester: pytest.Pytester, name: str) -> None:
    result = laws(pytester, "--scheme", name)
    assert result.ret != 0
    assert (result.stdout.str() + result.stderr.str()).count("Remedy") == 1  # not once for each law


def test_a_wrong_seed_is_a_usage_error(pytester: pytest.Pytester) -> None:
    result = laws(pytester, "--sepv-seed", "x")
    assert result.ret == pytest.ExitCode.USAGE_ERROR


def test_a_third_party_package_runs_the_laws_from_an_installed_wheel(tmp_path: Path) -> None:
    """A little package with a scheme of its own, beside sepv,
    built as a wheel and installed in a folder.
    """
    site, source = tmp_path / "site", tmp_path / "source"
    # What a wheel is built from, without build folders of this checkout.
    source.mkdir()
    unread = shutil.ignore_patterns("__pycache__", "*.egg-info")
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, source / name)
    for name in ("sepv", "properties", "reference"):
        shutil.copytree(ROOT / name, source / name, ignore=unread)
    (site / "littlescheme").mkdir(parents=True)
    (site / "littlescheme" / "__init__.py").write_text(MINE)
    # pip builds a wheel and installs it.
    subprocess.run(
        [sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check", "install", "--no-deps", "--no-compile",
         "--target", str(site), str(source)],
        check=True,
    )  # fmt: skip
    code = (
        f"import sys; sys.path[:] = [{str(site)!r}] + [p for p in sys.path if p not in ('', {str(ROOT)!r})]\n"
        "sys.meta_path[:] = [f for f in sys.meta_path if 'editable' not in repr(f).lower()]\n"
        "import pytest, sepv.properties\n"
        f"assert sepv.properties.__file__.startswith({str(site)!r}), sepv.properties.__file__\n"
        "sys.exit(pytest.main(sys.argv[1:]))\n"
    )
    asked = ("-k", "test_casimir or test_energy", "--scheme", "littlescheme:honest")
    done = subprocess.run(
        [sys.executable, "-c", code, *DOOR, "--pyargs", "sepv.properties", *asked],
        # Plugins of other libraries take a second to load.
        cwd=tmp_path, env=os.environ | {"PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    assert "1 passed, 1 skipped" in done.stdout
