"""Files, tokens, programs and names from others: each is refused in words,
and nothing that they name runs.

A row is a file's content. A module called canary leaves a file when it is imported. No command ends
in 70 or in a traceback, each message has its words (the file, the place in it, the reason), and no
control character from outside reaches a terminal.
"""

import base64
import json
import os
import re
import shlex
import sys
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from doors import Reader, command

import sepv
from sepv import Verdict, problems
from sepv._arguments import double, hex_float
from sepv.console import printable
from sepv.files import cache_folder
from sepv.law.cases import case as cases
from sepv.law.corpus import witnesses
from sepv.verification._verify import replay

CANARY = "import pathlib, sepv\npathlib.Path('ran').touch()\nproblem = sepv.problems.pendulum\n"
RED, BELL = "\x1b[31mred", "\x1b]0;title\x07"
SYSTEM: dict[str, Any] = {
    "dimension": 2, "hamiltonian": [[[2, 0], 0.5], [[0, 2], 0.5]], "structure": [[0, 1, [[[0, 0], -1.0]]]],
}  # fmt: skip
CASE: dict[str, Any] = {"problem": SYSTEM, "y": [1, 0.5], "h": 0.1, "dW": [0.1]}


def token(data: Any) -> str:
    raw = data if isinstance(data, bytes) else json.dumps(data).encode()
    return base64.urlsafe_b64encode(zlib.compress(raw)).decode().rstrip("=")


# What a problem file says in place of what it should, and the place and the reason in the message.
PROBLEMS: dict[str, tuple[Any, str]] = {
    "exponent 2.5": ({"hamiltonian": [[[2.5, 0], 1]]}, r"\$\.hamiltonian\[0\]\[0\]\[0\]: 2\.5 is not .*integer"),
    "decimal text": ({"noise": ["0.5"]}, r"\$\.noise\[0\]: '0\.5' is neither a JSON number .* nor a hex float"),
    "digits that are hex too": ({"noise": [1, "10"]}, r"\$\.noise\[1\]: '10' is neither"),
    "an exponent that is hex too": ({"noise": ["1e5"]}, r"\$\.noise\[0\]: '1e5' is neither"),
    "true for one": ({"noise": [True]}, r"\$\.noise\[0\]: true or false"),
    "null": ({"hamiltonian": [[[2, 0], None]]}, r"\$\.hamiltonian\[0\]\[1\]: null"),
    "dimension in text": ({"dimension": "2"}, r"\$\.dimension: '2' is not of type 'integer'"),
    "beyond binary64, in hex": ({"noise": ["0x1p+999999"]}, r"\$\.noise\[0\]: .* beyond the largest"),
    "beyond binary64, as a number": ({"noise": [10**400]}, "0000 is beyond binary64"),
    "nan in text": ({"initial": [1, "nan"]}, r"\$\.initial\[1\]: 'nan' is not finite"),
    "initial a number": ({"initial": 5}, r"\$\.initial: 5 is not of type 'array'"),
    "initial too short": ({"initial": [1]}, r"shape \(1,\)"),
    "unknown key": ({"hamiltonain": []}, r"'hamiltonain' was unexpected"),
    "entry without terms": ({"structure": [[0, 1]]}, r"\$\.structure\[0\]: \[0, 1\] is too short"),
    "one exponent for two variables": ({"structure": [[0, 1, [[[1], 1]]]]}, r"\$\.structure\[0\]\[2\]: \(1,\)"),
    "Casimir of another shape": ({"casimirs": [[[1]]]}, r"rows of \[1\] numbers"),
    "linear Casimir too short": ({"linear_casimirs": [[1]]}, r"linear_casimirs\[0\], a row of 2 numbers"),
    "negative noise": ({"noise": [-1]}, "coefficients c_j ≥ 0"),
    "a million variables": ({"dimension": 10**6}, r"\$\.dimension: 1000000 is greater"),
    "a key twice": ('{"dimension": 2, "dimension": 3}', "the key 'dimension' stands twice"),
    "NaN": ('{"dimension": NaN}', "NaN is not JSON"),
    "infinity": ('{"dimension": -Infinity}', "-Infinity is not JSON"),
    "1e999": ('{"noise": [1e999]}', "1e999 is beyond binary64"),
    "a number of 5000 digits": ('{"dimension": ' + "9" * 5000 + "}", "9999 is beyond binary64"),
    "brackets without end": ("[" * 100_000, "too deep"),
    "empty": ("", "line 1 column 1"),
    "binary": (b"\xff\xfe\x00", "can't decode byte 0xff"),
    "a list": ("[1]", r"\$: \[1\] is not of type 'object'"),
    "an unknown name": ({"name": RED}, r"Received p\.json: '\\x1b\[31mred'"),
    "a lone surrogate for a name": ('{"name": "\\ud800"}', "ud800"),
    "an unknown parameter": ({"name": "pendulum", "parameters": {"length": [1]}}, "'length'"),
    "a parameter of another kind": ({"name": "kepler", "parameters": {"eccentricity": [1, 2]}}, "eccentricity"),
    "a billion particles": ({"name": "toda", "parameters": {"particles": [1e9]}}, "from 2 to 64"),
}  # fmt: skip

TOKENS: dict[str, tuple[Any, str]] = {
    "cut": (token(CASE)[:-9], "token"),
    "not of this alphabet": ("größe!", "token"),
    "corrupt deflate": (base64.urlsafe_b64encode(b"\x78\x9c" + b"\xff" * 40).decode(), "token"),
    "wrong checksum": (base64.urlsafe_b64encode(zlib.compress(b"x" * 300)[:-4] + b"abcd").decode(), "token"),
    "a gigabyte of blanks": (token(b" " * 2**25), "token"),
    "a list": (token([1]), r"\$: \[1\] is not of type 'object'"),
    "decimal text": (token(CASE | {"h": "0.1"}), r"\$\.h: '0\.1' is neither"),
    "y too short": (token(CASE | {"y": [1]}), "1 in y and 1 in dW"),
    "a batch of a billion": (token(CASE | {"batch": 10**9}), r"\$\.batch"),
    "a module": (token(CASE | {"problem": {"given": "canary:problem", "noise": [1]}}), "-p canary:problem"),
    "a function that ends the process": (token(CASE | {"problem": {"given": "os:abort", "noise": []}}), "os:abort"),
    "an object": (token(CASE | {"problem": {"given": "", "object": RED, "noise": []}}), "handed over as an object"),
}  # fmt: skip
WITNESS = "{ problem = { given = 'canary:problem', noise = [1] }, y = [1], h = 0.1, dW = [] }"
ENTRY = '[[expected]]\nlaw = "{}"\nreason = "known"\nwitness = {}\n'
EXPECTED: dict[str, tuple[str, str]] = {
    "a module in a witness": (ENTRY.format("identity", WITNESS), "-p canary:problem"),
    "a module among problems": ('claims = []\nproblems = ["canary:problem"]', "-p canary:problem"),
    "a billion paths": (ENTRY.format("identity", "{ seed = 1, paths = 1000000000 }"), "paths ≤"),
    "a negative seed": (ENTRY.format("identity", "{ seed = -1 }"), "e.toml, entry 1"),
    "a seed in text": (ENTRY.format("identity", '{ seed = "1" }'), "e.toml, entry 1"),
    "the witness of another law": (ENTRY.format("identity", f'"{token(CASE)}"'), "case of which it says nothing"),
    "a law that is a table": ('[[expected]]\nlaw = { a = 1 }\nreason = "r"\nwitness = "w"', "e.toml, entry 1"),
    "claims that are a text": ('claims = "energy"', "e.toml, a list"),
    "brackets without end": ("a = " + "[" * 5000, "TOML in e.toml"),
    "an escape in a key": ('"\\u001b[31m" = 1', r"\\x1b\[31m"),
    "half a head": ("[[expected]", "TOML"),
    "a number": ("expected = 3", r"\[\[expected\]\]"),
    "another table": ("[other]\n", r"\[\[expected\]\]"),
    "neither reason nor witness": ('[[expected]]\nlaw = "energy"', "law, reason and witness"),
    "an unknown law": (ENTRY.format("nosuch", '"w"'), "nosuch"),
    "no reason": (ENTRY.format("energy", '"w"').replace("known", " "), "a reason"),
    "no token": (ENTRY.format("energy", '"w"'), "token"),
    "a number for a witness": (ENTRY.format("energy", "3"), "a witness"),
    "a seed for a case": (ENTRY.format("energy", "{ seed = 0 }"), "a witness"),
    "a law twice": (ENTRY.format("energy", f'"{token(CASE)}"') * 2, "twice"),
}  # fmt: skip


def run(line: str, words: str, code: int = 2) -> str:
    shown = command(line, code).output
    assert "Traceback" not in shown
    assert re.search(words, shown, re.DOTALL), shown
    assert not {"\x1b", "\x07"} & set(shown)
    return shown


@pytest.fixture(autouse=True)
def canary(reader: Reader) -> Any:
    """In a folder with a module that nobody may import."""
    (reader.folder / "canary.py").write_text(CANARY)
    yield
    ran = (reader.folder / "ran").exists()
    sys.modules.pop("canary", None)
    assert not ran, "a module was imported that nobody named"


@pytest.mark.parametrize("line", ["verify midpoint --law identity", "run midpoint --steps 4"])
@pytest.mark.parametrize(
    "make", [os.mkfifo, lambda name: os.symlink("/dev/zero", name)], ids=["pipe", "zero"]
)
def test_a_problem_file_that_never_ends_is_refused(line: str, make: Any) -> None:
    make("p.json")
    run(f"{line} -p p.json", r"p\.json: a pipe, a socket or a device, and no file")


def test_an_infinite_energy_of_the_initial_state_is_refused() -> None:
    """The largest error of H was 0, because inf − inf was left out, and the exit code 0."""
    Path("p.json").write_text(json.dumps(SYSTEM | {"initial": [1e200, 1.0]}))
    run("run midpoint --steps 4 -p p.json", r"H\(y0\) = inf at y0 = \[1e\+200, 1\.0\]")


@pytest.mark.parametrize("name", PROBLEMS)
def test_a_problem_file_is_refused_with_its_place_and_reason(name: str) -> None:
    content, words = PROBLEMS[name]
    if isinstance(content, dict):
        content = json.dumps(content if "name" in content else SYSTEM | content)
    Path("p.json").write_bytes(content if isinstance(content, bytes) else content.encode())
    assert "p.json" in run("run energy-preserving -p p.json --steps 2", words)


@pytest.mark.parametrize("name", TOKENS)
def test_a_token_is_refused_and_imports_nothing(name: str) -> None:
    given, words = TOKENS[name]
    run(f"verify midpoint --law energy --replay {shlex.quote(given)}", words)


@pytest.mark.parametrize("name", EXPECTED)
def test_a_file_of_expected_failures_is_refused_and_imports_nothing(name: str) -> None:
    content, words = EXPECTED[name]
    Path("e.toml").write_text(content)
    run("verify midpoint --law identity,energy --examples 1 --expected e.toml", words)


def test_a_program_that_answers_with_escapes() -> None:
    """The other answers are asked in test_external.py."""
    line = json.dumps({"id": 0, "protocol": 1, "scheme": BELL, "polynomial": True})
    Path("program.py").write_text(
        f"import sys\nsys.stderr.write({BELL!r})\nprint({line!r}, flush=True)\ninput()\ninput()"
    )
    command = shlex.quote(f"{shlex.quote(sys.executable)} program.py")
    run(f"verify --exec {command} --law identity --examples 1 --call-timeout 5", "scheme in hello", 3)


def test_names_of_files_and_schemes_do_nothing_to_a_terminal() -> None:
    Path(f"{BELL}[bold].json").write_text(json.dumps(SYSTEM | {"initial": [1, 0]}))
    shown = run(f"step energy-preserving '{BELL}[bold].json' --h 0.1", r"\[bold\]", 0)
    assert r"\x1b]0;title\x07" in shown
    Path("own.py").write_text(
        f"import sepv\nscheme = sepv.Scheme({RED + '[/x]'!r}, lambda problem, y, h, dW: y, source={BELL!r})\n"
    )
    for options in ("--json r.json --junit j.xml --pin p.toml", "--expected p.toml"):
        run(f"verify own:scheme --law identity --examples 1 {options}", r"red\[/x\]", 0)
    run(f"report '{RED}.json'", r"\\x1b\[31mred\.json: No such file")
    run(f"verify '{BELL}'", r"Received '\\x1b\]0;title\\x07'", 3)


def test_text_of_others_is_printed_without_control_characters() -> None:
    assert printable("naïve Δ\n\tok") == "naïve Δ\n\tok"
    assert printable("\x1b[31m\x07\u202e\u2028\ud800\x9b") == r"\x1b[31m\x07\u202e\u2028\ud800\x9b"


def test_numbers_of_json_are_read_in_one_way() -> None:
    assert [double(v) for v in (1, -0.5, "0x1.8p+1", "-0X1P-1", "0x0p0")] == [1.0, -0.5, 3.0, -0.5, 0.0]
    assert np.isnan(hex_float("nan"))
    assert hex_float("-0x1p+999999") == -np.inf


@pytest.mark.parametrize(
    "name", ["pendulum", "rigid-body", "maxwell-bloch", "noncommuting-tops", "two-spins", "kepler", "toda"]
)
def test_a_built_in_problem_goes_to_a_file_and_back(name: str) -> None:
    problem = problems.by_name(name)
    Path("p.json").write_text(json.dumps(problems.to_json(problem)))
    again = sepv.schemes.load_problem("p.json")
    assert again.data == problem.data
    assert np.array_equal(again.initial, problem.initial)
    y = 1.0 + np.asarray(problem.initial)
    assert np.array_equal(again.gradient(y), problem.gradient(y))


@pytest.mark.parametrize(
    "law", ["identity", "casimir", "invariant:casimir", "midpoint", "reduction", "expansion"]
)
def test_a_law_accuses_nobody_on_a_case_of_another(law: str) -> None:
    """(2.1) claims all of these; replayed on what other laws ask,
    *identity* alone called it violated 40 times.
    """
    for other in ("energy", "symmetry", "noise-sum", "equivariance"):
        for witness in witnesses(other)[:2]:
            try:
                found = replay("energy-preserving", law, cases.to_json(witness.case))
            except sepv.UsageError:
                continue  # a case of which the law says nothing
            assert found.verdict is not Verdict.VIOLATED


def test_a_witness_of_its_own_package_is_replayed_and_others_when_they_are_named() -> None:
    from sepv.schemes._load_target import require_trusted

    require_trusted(["canary:problem", None, "pendulum"], ["canary:problem"], "midpoint")
    require_trusted(["mine.problems:top"], [], "mine.schemes:step")
    untrusted = (
        ("canary:problem", "midpoint"),
        ("canary:problem", "mine:step"),
        ("sepv.commands:main", sepv.verify),
    )
    for target, scheme in untrusted:
        with pytest.raises(sepv.UsageError, match=f"add -p {target}"):
            require_trusted([target], [], scheme)


def test_a_tolerance_is_advised_only_where_the_defect_is_no_power_of_the_step() -> None:
    """Heun's defect of H is that of its order, also in steps so short that it is as small as a
    tolerance.
    """
    quartic = SYSTEM | {"hamiltonian": [[[4, 0], 0.25], [[0, 2], 0.5]]}
    short = {"problem": quartic, "y": [1, 0.5], "h": 2.0**-13, "dW": [0.0]}
    found = replay("euler-heun", "energy", short)
    assert found.verdict is Verdict.VIOLATED
    assert found.defect * 2.0**-52 < 1e-7
    assert "solver_tolerance" not in found.message


def test_a_run_that_pins_does_not_ask_for_a_pin() -> None:
    Path("pinned.py").write_text("def step(problem, y, h, dW):\n    return y.copy()\n")
    line = "verify pinned:step --law identity,energy --examples 1 --pin p.toml"
    assert "--pin FILE" not in run(line, "From now on: .*--expected", 0)


def test_a_user_without_a_name_or_a_home_has_a_private_folder(monkeypatch, tmp_path):
    monkeypatch.delenv("SEPV_CACHE_DIR", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    place = cache_folder("hypothesis")
    assert place == tmp_path / "cache" / "hypothesis" or place == tmp_path / "cache" / "sepv" / "hypothesis"
    assert place.stat().st_mode & 0o077 == 0
    place.chmod(0o777)
    fresh = cache_folder("hypothesis")
    assert fresh != place
    assert fresh.stat().st_mode & 0o077 == 0
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setattr(Path, "home", lambda: (_ for _ in ()).throw(RuntimeError("no home")))
    monkeypatch.setattr("getpass.getuser", lambda: (_ for _ in ()).throw(KeyError("uid not found")))
    assert cache_folder("hypothesis") == fresh
    monkeypatch.delenv("HYPOTHESIS_STORAGE_DIRECTORY", raising=False)
    run("list", "midpoint", 0)
