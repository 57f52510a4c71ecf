"""Submissions: what a scheme was found to do, as one file that somebody else can check.

A bundle is a zip of JSON files: `manifest.json` (what was asked for, versions, hashes of the scheme's source and of the
other files), `report.json` (`Report.to_json`: seeds, defects, witnesses), and `waivers.toml` where there are expected
failures. Hashes show that a file was changed by accident; who made a bundle can make another. What binds is that it can
be measured again: `again` measures a random share of the laws anew, and each counterexample.
"""

from __future__ import annotations

import hashlib
import io
import json
import math
import platform
import random
import shlex
import sys
import zipfile
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, fields
from functools import partial
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from sepv._version import __version__
from sepv.errors import SepvError, UsageError
from sepv.files import fault, finite, schema
from sepv.schemes._load_target import load_object
from sepv.verification._law import Effort, Finding, Run, Verdict
from sepv.verification._laws import load_laws
from sepv.verification._levels import SUITE, conformance
from sepv.verification._outcome import Report
from sepv.verification._verify import measure, replay

FORMAT = 1
MANIFEST, REPORT, WAIVERS = "manifest.json", "report.json", "waivers.toml"
# What the bits of a run come from.
_VERSIONS = ("numpy", "scipy", "hypothesis", "mpmath", "numba")
# A bundle of all laws has less than a hundred kilobytes: more is not one, and is not unpacked.
LARGEST = 2**24
# A zip wants a date; the environment says more.
_DATE = (1980, 1, 1, 0, 0, 0)
_SOURCE = (".py", ".so", ".pyd", ".pyx", ".c", ".cpp", ".rs", ".jl")


@dataclass(frozen=True)
class Asked:
    """What `sepv submit` was asked for: enough to measure it again."""

    target: str = ""  # module:attribute or a built-in name; empty for a program
    program: str = ""  # the command of --exec; empty for a target
    problems: tuple[str, ...] = ()  # as after -p
    claims: tuple[str, ...] = ()  # as after --claim

    @property
    def words(self) -> str:
        """As a command has it."""
        named = f"--exec {shlex.quote(self.program)}" if self.program else shlex.quote(self.target)
        return named + "".join(f" -p {shlex.quote(p)}" for p in self.problems)


@dataclass(frozen=True)
class Outcome:
    """One thing that was checked."""

    what: str
    right: bool
    text: str


def environment() -> dict[str, str]:
    """Python, the machine, and the versions that bits come from."""
    found = {"python": platform.python_version(), "machine": platform.machine(), "sepv": __version__}
    for name in _VERSIONS:
        found[name] = metadata.version(name) if find_spec(name) is not None else "none"
    return found


def source(asked: Asked) -> dict[str, str]:
    """SHA-256 of the files that the scheme is made of: those of its module's package, or those that a command names."""
    return {name: _hash(path.read_bytes()) for name, path in sorted(_files(asked))}


def _files(asked: Asked) -> Iterator[tuple[str, Path]]:
    if asked.program:
        yield from ((word, Path(word)) for word in shlex.split(asked.program) if Path(word).is_file())
        return
    top = asked.target.partition(":")[0].partition(".")[0] if ":" in asked.target else "sepv"
    if ":" in asked.target:
        # It finds modules of the current folder, and says what is wrong with others.
        load_object(asked.target)
    module = sys.modules[top]
    folders = [Path(folder) for folder in getattr(module, "__path__", ())]
    for folder in folders:
        own = (path for path in folder.rglob("*") if path.suffix in _SOURCE and path.is_file())
        yield from ((f"{top}/{path.relative_to(folder).as_posix()}", path) for path in own)
    if not folders and module.__file__:
        yield Path(module.__file__).name, Path(module.__file__)


def bundle(report: Report, asked: Asked, waivers: str | None = None) -> bytes:
    """The bytes of a bundle.

    Raises
    ------
    UsageError
        For a report of some of the laws only, or one that was interrupted.
    """
    if report.interrupted or len(report.findings) != len(load_laws()):
        raise UsageError(
            expected="a report of every law",
            received=f"{len(report.findings)} laws" + (", interrupted" if report.interrupted else ""),
            remedy="let `sepv submit` measure them all",
        )
    texts = {REPORT: _json(report.to_json())} | ({} if waivers is None else {WAIVERS: waivers})
    manifest = {
        "format": FORMAT,
        "asked": asdict(asked),
        "laws_version": SUITE,
        "effort": {f.name: getattr(report.effort, f.name) for f in fields(Effort)},
        "environment": environment(),
        "source": source(asked),
        "files": {name: _hash(text.encode()) for name, text in texts.items()},
    }
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as folder:
        for name, text in {MANIFEST: _json(manifest), **texts}.items():
            folder.writestr(zipfile.ZipInfo(name, _DATE), text, zipfile.ZIP_DEFLATED)
    return out.getvalue()


@dataclass(frozen=True)
class Bundle:
    """A bundle as it was read: its files are of the schemas and have their hashes."""

    manifest: dict[str, Any]
    report: dict[str, Any]
    waivers: str | None

    @property
    def asked(self) -> Asked:
        """What was measured."""
        own = self.manifest["asked"]
        return Asked(own["target"], own["program"], tuple(own["problems"]), tuple(own["claims"]))

    @property
    def effort(self) -> Effort:
        """How hard it was looked."""
        return Effort(**self.manifest["effort"])


def read(path: str | Path) -> Bundle:
    """A bundle, after a look at its schema and hashes; a UsageError for what is none, with what is wrong."""
    try:
        with zipfile.ZipFile(path) as folder:
            if sum(info.file_size for info in folder.infolist()) > LARGEST:
                raise _no_bundle(path, f"more than {LARGEST >> 20} MiB")
            texts = {name: folder.read(name).decode() for name in folder.namelist()}
        manifest = json.loads(texts.pop(MANIFEST))
        if wrong := fault(manifest, schema("manifest")):
            raise _no_bundle(path, f"{MANIFEST}, {wrong}")
        hashes = {name: _hash(text.encode()) for name, text in texts.items()}
        if hashes != manifest["files"]:
            changed = sorted(set(hashes.items()) ^ set(manifest["files"].items()))
            raise _no_bundle(path, f"other hashes of {', '.join(sorted({name for name, _ in changed}))}")
        report = json.loads(texts[REPORT])
        if wrong := fault(report, schema("report")):
            raise _no_bundle(path, f"{REPORT}, {wrong}")
    except UsageError:
        raise
    except OSError as error:
        raise _no_bundle(path, f"{error.strerror or error}") from error
    except (zipfile.BadZipFile, KeyError, ValueError, RuntimeError) as error:
        raise _no_bundle(path, f"{type(error).__name__}: {error}") from error
    return Bundle(manifest, report, texts.get(WAIVERS))


def consistent(found: Bundle) -> list[Outcome]:
    """Whether the report agrees with itself, and was made by these laws: no scheme is needed."""
    laws, report = load_laws(), found.report
    names = [f["law"] for f in report["laws"]]
    same = report["suite"]["laws_version"] == SUITE and names == [law.name for law in laws]
    own = f"{report['suite']['laws_version']}, here {SUITE}"
    outcomes = [Outcome("version of the suite", same, own)]
    counts = {k: sum(f["verdict"] == k for f in report["laws"]) for k in report["counts"]}
    outcomes.append(Outcome("counts", counts == report["counts"], f"{len(names)} laws"))
    if same:
        by_name = {law.name: law for law in laws}
        said = []
        for f in report["laws"]:
            facts = {fact: f[fact] for fact in ("claimed", "skipped", "expected")}
            said.append(by_name[f["law"]].finding(Verdict(f["verdict"]), **facts))
        reached = conformance(said, laws)
        level, stated = reached.level if reached else None, (report["conformance"] or {}).get("level")
        outcomes.append(Outcome("level", level == stated, f"{stated} stated, {level} follows"))
    silent = [f["law"] for f in report["laws"] if f["expected"] is not None and not f["expected"].strip()]
    outcomes.append(Outcome("waivers", not silent, ", ".join(silent) or "each with its reason"))
    return outcomes


def again(found: Bundle, scheme: Any, *, share: float = 0.25, seed: int | None = None) -> Iterator[Outcome]:
    """Measure a random share of the laws anew, one at least, and every counterexample.

    `scheme` is as loaded here, with the claims of the bundle. Without a `seed` of the choice nobody knows what will be
    measured. A verdict is right where it is the same; with the same versions on the same kind of machine the defect
    must be the same, too, to the last digit.
    """
    own = source(found.asked)
    yield Outcome("source of the scheme", own == found.manifest["source"], f"{len(own)} files")
    alike = environment() == found.manifest["environment"]
    laws = {law.name: law for law in load_laws()}
    said = {f["law"]: f for f in found.report["laws"]}
    for name, finding in said.items():
        if finding["verdict"] == "violated" and finding["witness"] is not None:
            text, right, _ = _measured(partial(replay, scheme, name, finding["witness"]), "violated")
            yield Outcome(f"counterexample of {name}", right, text)
    searched = [name for name, finding in said.items() if finding["expected"] is None]
    count = min(len(searched), max(1, math.ceil(share * len(searched))))
    chosen = set(random.Random(seed).sample(searched, count))
    run = Run(found.effort)
    for name in (name for name in searched if name in chosen):
        wanted = said[name]
        text, right, measured = _measured(partial(measure, laws[name], scheme, run), wanted["verdict"])
        if right and alike and measured is not None and finite(measured.defect) != wanted["defect"]:
            right, text = False, f"{text}, with a defect of {measured.defect!r} and not {wanted['defect']!r}"
        yield Outcome(f"{name} again", right, text)


def _measured(run: Callable[[], Finding], wanted: str) -> tuple[str, bool, Finding | None]:
    try:
        found = run()
    except SepvError as error:
        return f"{error}".splitlines()[0], False, None
    right = found.verdict.value == wanted
    return found.verdict.text + ("" if right else f", stated {wanted.replace('_', ' ')}"), right, found


def _no_bundle(path: str | Path, why: str) -> UsageError:
    return UsageError(
        expected="a bundle of `sepv submit`, unchanged", received=f"{path}: {why}", remedy="make it anew"
    )


def _json(data: Any) -> str:
    return json.dumps(data, indent=1, ensure_ascii=False, allow_nan=False, sort_keys=True) + "\n"


def _hash(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()
