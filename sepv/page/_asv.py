"""Results as files of asv (airspeed velocity), which shows numbers of a repository's commits as a
trend.

The folder has the layout of asv's `results_dir`: benchmarks.json, and a folder a machine with a
file a commit.
"""

from __future__ import annotations

import hashlib
import os
import platform
import subprocess
import sys
from pathlib import Path
from typing import Any

from sepv._version import __version__
from sepv.errors import UsageError
from sepv.files import json_text, read_json, write_atomically
from sepv.page._sources import Sources

# The versions of asv's formats, as of asv 0.6.
ASV_FORMAT, ASV_MACHINE_FORMAT = 2, 1
_ASV_COLUMNS = ("result", "params", "version", "started_at", "duration")


def write_asv(sources: Sources, folder: str) -> int:
    """Write the numbers of reports and comparisons for the commit that is checked out here;
    return how many there are.

    A report gives the defect of each law that was measured, a comparison the strong error and the
    nanoseconds of a step for each number of steps. Results of earlier commits in the folder are
    kept.

    Raises
    ------
    UsageError
        If the current folder is in no git repository, or if there is no report and no comparison.
    """
    tracks = {**_of_reports(sources.verify), **_of_comparisons(sources.compare)}
    if not tracks:
        raise UsageError(
            expected="a report of verify or a comparison, for asv",
            received="neither",
            remedy="sepv verify mypkg.scheme:scheme --json report.json",
        )
    commit, date = _git("rev-parse", "HEAD"), _git("show", "-s", "--format=%ct", "HEAD")
    described = {name: _described(name, **track) for name, track in tracks.items()}
    python, machine = platform.python_version(), platform.node() or "machine"
    environment = f"sepv-{__version__}-py{sys.version_info.major}.{sys.version_info.minor}"
    about = {
        "machine": machine, "os": platform.system(), "arch": platform.machine(), "cpu": platform.processor(),
        "num_cpu": str(os.cpu_count()), "ram": "",
    }  # fmt: skip
    results = {
        name: [track["values"], track["params"], described[name]["version"], int(date) * 1000, None]
        for name, track in tracks.items()
    }
    place = Path(folder, machine)
    place.mkdir(parents=True, exist_ok=True)
    known = Path(folder, "benchmarks.json")
    before = read_json(known, expected="asv's benchmarks.json", remedy="remove it") if known.exists() else {}
    _write(known, {**before, **described, "version": ASV_FORMAT})
    _write(place / "machine.json", {**about, "version": ASV_MACHINE_FORMAT})
    _write(
        place / f"{commit[:8]}-{environment}.json",
        {
            "commit_hash": commit, "env_name": environment, "date": int(date) * 1000,
            "params": about | {"python": python}, "python": python, "requirements": {}, "env_vars": {},
            "result_columns": _ASV_COLUMNS, "results": results,
            "durations": {}, "version": ASV_FORMAT,
        },
    )  # fmt: skip
    return sum(len(track["values"]) for track in tracks.values())


def _of_reports(reports: list[dict[str, Any]]) -> dict[str, dict[str, Any]]:
    return {
        f"{report['scheme']['name']}.{law['law']}": {
            "unit": law["unit"],
            "params": [],
            "values": [law["defect"]],
        }
        for report in reports
        for law in report["laws"]
        if law["defect"] is not None
    }


def _of_comparisons(comparisons: list[dict[str, Any]]) -> dict[str, dict[str, Any]]:
    tracks = {}
    for data in comparisons:
        for method in (m["name"] for m in data["methods"]):
            points = [p for p in data["points"] if p["method"] == method]
            steps = [[repr(p["steps"]) for p in points]]
            at = f"{method}.{data['problem']}"
            errors = [p["strong_error"]["value"] for p in points]
            tracks[f"{at}.strong_error"] = {"unit": "error", "params": steps, "values": errors}
            times = [p["ns_per_step"] for p in points]
            tracks[f"{at}.ns_per_step"] = {"unit": "ns", "params": steps, "values": times}
    return tracks


def _described(name: str, unit: str, params: list[list[str]], values: list[Any]) -> dict[str, Any]:
    """The entry of benchmarks.json; a benchmark of another unit or of other numbers of steps has
    another version.
    """
    assert len(values) == (len(params[0]) if params else 1)
    version = hashlib.sha256(repr((name, unit, params)).encode()).hexdigest()
    return {
        "name": name, "type": "track", "unit": unit, "params": params, "param_names": ["steps"] * len(params),
        "version": version, "code": "", "timeout": 60.0,
    }  # fmt: skip


def _git(*words: str) -> str:
    try:
        return subprocess.run(["git", *words], capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError) as error:
        raise UsageError(
            expected="a commit of a git repository, for asv's trend",
            received=f"none in {Path.cwd()}",
            remedy="run the command in the repository of your library",
        ) from error


def _write(path: Path, data: dict[str, Any]) -> None:
    write_atomically(str(path), json_text(data))
