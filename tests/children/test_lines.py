"""Lines between processes of sepv: what comes from elsewhere is never unpickled,
and nothing of ours is lost by it.
"""

import json
import pickle
import subprocess
import sys
from binascii import b2a_base64
from pathlib import Path
from typing import Any

import pytest

from sepv.children import packed, unpacked

RAN: list[str] = []


class Harm:
    """An object whose pickle runs code."""

    def __reduce__(self) -> Any:
        return RAN.append, ("ran",)


def test_a_line_of_another_is_shown_and_not_unpickled(capfd: pytest.CaptureFixture[str]) -> None:
    harm = b2a_base64(pickle.dumps(Harm()))[:-1]
    for line in (
        harm,
        b"",
        b"warning: 3 kernels",
        packed(Harm())[:-1].replace(b"Y", b"Z"),
        packed("cut")[:-9],
    ):
        assert unpacked(line) is None
        assert capfd.readouterr().err.strip() == line.decode()
    assert not RAN


def test_text_before_a_line_is_another_s(capfd: pytest.CaptureFixture[str]) -> None:
    for before in (b"", b"no end of line: "):
        assert unpacked(before + packed(("law", 3))[:-1]) == ("law", 3)
        assert capfd.readouterr().err.strip() == before.decode().strip()


# On its first calls it writes such a line into each pipe that it finds.
STEP = """
import os, pickle, stat
from binascii import b2a_base64
from contextlib import suppress
from sepv import schemes
calls = 0
class Harm:
    def __reduce__(self):
        return open, ("ran", "w")
def step(problem, y, h, dW):
    global calls
    calls += 1
    for fd in range(1, 40) if calls < 4 else ():
        with suppress(OSError):
            if stat.S_ISFIFO(os.fstat(fd).st_mode):
                os.write(fd, b"warning" * (calls % 2) + b2a_base64(pickle.dumps(Harm())) + b"no end" * (calls % 3))
    return schemes.midpoint.step(problem, y, h, dW)
"""


@pytest.mark.parametrize("jobs", ["1", "2"])
def test_a_step_that_writes_into_all_pipes_runs_nothing_elsewhere(jobs: str, tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(STEP)
    command = [sys.executable, "-m", "sepv", "verify", "mine:step", "--law", "identity,contract,truncation"]
    done = subprocess.run(
        [*command, "-q", "-j", jobs, "--json", "r.json"],
        cwd=tmp_path, capture_output=True, text=True, timeout=360, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    found = {law["law"]: law["verdict"] for law in json.loads((tmp_path / "r.json").read_text())["laws"]}
    assert found == dict.fromkeys(("contract", "identity", "truncation"), "holds")
    assert not (tmp_path / "ran").exists()
    assert "warning" in done.stderr
