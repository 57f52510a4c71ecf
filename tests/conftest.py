"""Hypothesis profiles for these tests: the same examples in every run by default, never a deadline.

And two fixtures: an alarm, and a reader who types what documents show.

``--hypothesis-profile fresh`` draws new ones, ``--hypothesis-profile deep`` many of them.
"""

import gc
import os
import shlex
import signal
import sys
import sysconfig
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result
from doors import ROOT, Reader
from hypothesis import HealthCheck, settings

from sepv import _kept
from sepv.commands._cli import main

# Cases are large by nature: too slow a draw is no finding here.
_COMMON = {"deadline": None, "database": None, "suppress_health_check": [HealthCheck.too_slow]}

settings.register_profile("ci", derandomize=True, max_examples=40, **_COMMON)
settings.register_profile("fresh", derandomize=False, print_blob=True, **_COMMON)
settings.register_profile("deep", derandomize=False, print_blob=True, max_examples=2000, **_COMMON)
settings.load_profile("ci")

# Folders of the checkout that are installed as subpackages of sepv.
SHIPPED = ("properties", "reference")


# Hundreds of processes are started here. Where an environment forbids bytecode, each would compile
# sepv, its laws and the plugins of pytest again, which is a third of its time.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False
# Workers and children share the cores: threads of BLAS in each would wait for one another, which
# takes processor time.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def pytest_configure() -> None:
    """Stop where the installed sepv is another than the checkout's.

    Tests import sepv from the checkout, the current folder. Processes that they start in other
    folders import the installed one. After `pip install .` both are the same until a file changes.
    """
    installed = Path(sysconfig.get_path("purelib"), "sepv")
    if not (installed / "__init__.py").exists():
        return  # an editable installation is the checkout itself
    for folder, place in ((ROOT / "sepv", installed), *((ROOT / name, installed / name) for name in SHIPPED)):
        for file in folder.rglob("*.py"):
            copy = place / file.relative_to(folder)
            if not copy.exists() or copy.read_bytes() != file.read_bytes():
                raise pytest.UsageError(
                    f"Expected the installed sepv to be that of the checkout.\nReceived another {copy}.\n"
                    "Remedy: pip install . again, or pip install -e . once"
                )


# Where these tests run as a job of GitHub Actions, the schemes that they break are not annotated
# there.
for _variable in ("GITHUB_ACTIONS", "GITHUB_STEP_SUMMARY"):
    os.environ.pop(_variable, None)


# Each has something costly that its tests share: a site, a cluster, a report of all laws, a copy of
# the tree, figures, the cases of all laws.
TOGETHER = {
    "tests/workers/test_clusters.py", "tests/commands/test_same_verdicts_at_every_door.py",
    "tests/docs/test_extending.py", "tests/verification/test_files.py", "tests/docs/test_site.py",
    "tests/paper/test_reproduce.py", "tests/faults/test_saboteurs.py", "tests/verification/test_right_schemes.py",
}  # fmt: skip


# What begins so has the marker `quick`: a look at each floor of the core, in less than a minute of
# one core. Compiled code is in `tests/core`, a search of all cases of a law in the two tests of
# test_search.py.
SEARCHES = ("test_a_fault_of_a_pair_of_strata_is_found_in_that_pair[single", "test_a_wrong_term_is_named")
QUICK = (
    "tests/record/", "tests/core/", "tests/problem/test_problems.py", "tests/problem/test_structures.py",
    "tests/law/test_tolerance.py", "tests/test_imports.py", "tests/docs/test_names.py",
    *(f"tests/law/test_search.py::{name}" for name in SEARCHES),
)  # fmt: skip


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """With ``-m quick`` no file is read that has no such test:
    to read all takes longer than to run these.
    """
    if (
        config.option.markexpr != "quick"
        or collection_path.is_dir()
        or not collection_path.is_relative_to(ROOT)
    ):
        return None
    name = collection_path.relative_to(ROOT).as_posix()
    return None if name.startswith(tuple(begin.partition("::")[0] for begin in QUICK)) else True


@pytest.fixture(autouse=True, scope="session")
def _no_changed_case_is_kept(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Tests that change how cases are drawn leave none of them to a user's runs."""
    folder = tmp_path_factory.mktemp("kept")
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(_kept, "_path", lambda kind: folder / f"{kind}.pickle")
        yield


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """With ``-n`` the tests of these files go to one worker each;
    of the others each goes to the first that is free.

    ``--dist loadgroup`` would do, but cannot stand in ``addopts``, where it is an error without
    workers.
    """
    if config.option.dist != "load":
        return None
    from xdist.scheduler import LoadScopeScheduling

    class Scheduling(LoadScopeScheduling):
        def _split_scope(self, nodeid: str) -> str:
            file = nodeid.partition("::")[0]
            return file if file in TOGETHER else nodeid

    return Scheduling(config, log)


# With an adaptive quadrature in each step these laws take a quarter of a minute and more for this
# scheme. *Contract* is measured on all other schemes of the paper; tests/core/test_implicit.py asks
# *reproducibility* of smaller batches.
DEEP = {
    "properties/test_contract.py::test_contract[discrete-gradient]",
    "properties/test_reproducibility.py::test_reproducibility[discrete-gradient]",
}


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark what ships without marks: laws that take long, and tests of `QUICK` that are not
    deep.
    """
    for item in items:
        if item.nodeid in DEEP:
            item.add_marker(pytest.mark.deep)
        elif item.nodeid.startswith(QUICK) and not item.get_closest_marker("deep"):
            item.add_marker(pytest.mark.quick)


def pytest_collection_finish() -> None:
    """Half a million objects of modules and tests live to the end:
    no collection of garbage visits them.
    """
    gc.freeze()


# What comes in badly must not hang: far above what any such test takes.
SECONDS = 30


@pytest.fixture
def alarm() -> Iterator[None]:
    """Whatever hangs is a failure, not a wait."""

    def ring(*_: Any) -> None:
        raise AssertionError(f"did not come back within {SECONDS} s")

    # Not SIGALRM, which sepv itself uses for its time limits.
    before = signal.signal(signal.SIGUSR1, ring)
    timer = threading.Timer(SECONDS, signal.pthread_kill, (threading.main_thread().ident, signal.SIGUSR1))
    timer.start()
    yield
    timer.cancel()
    signal.signal(signal.SIGUSR1, before)


@pytest.fixture
def reader(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Reader:
    """In a folder that is empty."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    # A module that is written twice in a second would be taken for the first.
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    # Of the run that we are in, and not of those that a reader begins.
    monkeypatch.delenv("PYTEST_ADDOPTS", raising=False)
    return Reader(tmp_path)


@pytest.fixture
def call(reader: Reader) -> Callable[..., Result]:
    """A function that runs a command line in an empty folder, where `code` is the module `mine`."""

    def run(arguments: str, code: str = "") -> Result:
        head = (
            "import numpy as np\nimport sepv\nfrom sepv.schemes._energy_preserving import step as correct\n"
        )
        (reader.folder / "mine.py").write_text(head + code)
        sys.modules.pop("mine", None)
        return CliRunner().invoke(main, shlex.split(arguments))

    return run
