"""The code of docs/clusters.md runs where its library is installed."""

import os
import re
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest
from doors import blocks, doc
from reader import Reader

BLOCKS = [body for kind, body in blocks(doc("clusters.md")) if kind == "python"]
LIBRARIES = ("distributed", "joblib", "ray")
NEEDS = [
    next((name for name in LIBRARIES if re.search(rf"^(import|from) {name}\b", b, re.MULTILINE)), "zarr")
    for b in BLOCKS
]


def ran(number: int, folder: Path) -> str:
    if find_spec(NEEDS[number]) is None:
        pytest.skip(f"{NEEDS[number]} is not installed")
    (folder / "block.py").write_text(BLOCKS[number], encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "block.py"], cwd=folder, env=os.environ | {"PYTHONWARNINGS": "error"}, capture_output=True,
        text=True, timeout=300, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_every_engine_of_the_page_has_a_block() -> None:
    assert NEEDS == ["distributed", "joblib", "ray", "zarr"]


# Dask itself is asked in test_clusters.py. Its block and that of ray start clusters of processes, which take long.
@pytest.mark.parametrize(
    "number", [pytest.param(0, marks=pytest.mark.deep), 1, pytest.param(2, marks=pytest.mark.deep)]
)
def test_a_block_runs(number: int, tmp_path: Path) -> None:
    assert ("(2, 20000) 0" if NEEDS[number] == "ray" else "(2, 20000)") in ran(number, tmp_path)


def test_the_block_that_keeps_paths_on_disk_runs(reader: Reader) -> None:
    pytest.importorskip("zarr", reason="zarr is not installed")
    reader.python(BLOCKS[NEEDS.index("zarr")])
    assert (reader.folder / "paths.zarr").is_dir()
