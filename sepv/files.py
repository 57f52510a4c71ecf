"""Files that a run leaves for other programs: JSON, JUnit XML, a badge. Written whole or not at all."""

from __future__ import annotations

import json
import os
import re
import tempfile
from pathlib import Path
from xml.etree import ElementTree

from sepv.errors import UsageError
from sepv.verification import Finding, Report, Verdict

# What XML 1.0 cannot hold, not even escaped.
_NOT_XML = re.compile("[^\t\n\r -\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def require_folder(path: str | None) -> None:
    """Complain about a file that could not be written before hours of work, not after.

    Raises
    ------
    UsageError
    """
    if path is None:
        return
    folder = Path(path).resolve().parent
    if not folder.is_dir() or not os.access(folder, os.W_OK) or Path(path).is_dir():
        raise UsageError(
            expected="a file in a folder that exists and can be written to",
            received=path,
            remedy="make the folder, or name another file",
        )


def write_atomically(path: str, content: str | bytes) -> None:
    """Write a file whole or not at all: a reader never sees half of it. Text goes as UTF-8."""
    target = Path(path).resolve()
    handle, name = tempfile.mkstemp(dir=target.parent, prefix=f".{target.name}.")
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(content.encode() if isinstance(content, str) else content)
        os.chmod(name, 0o644)
        os.replace(name, target)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise


def report_json(report: Report) -> str:
    """The report as JSON text, as the schema in the package describes it."""
    return json.dumps(report.to_json(), indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def junit_xml(report: Report) -> str:
    """The report as JUnit XML: a law is a test case; what is not claimed cannot fail and is skipped instead."""
    suite = ElementTree.Element(
        "testsuite",
        name=_clean(f"sepv {report.scheme.name}"),
        tests=str(len(report.findings)),
        time=f"{sum(f.seconds for f in report.findings):.3f}",
    )
    tally = {"failure": 0, "error": 0, "skipped": 0}
    for f in report.findings:
        test = ElementTree.SubElement(
            suite, "testcase", classname=_clean(report.scheme.name), name=f.law, time=f"{f.seconds:.3f}"
        )
        kind = _junit_kind(report, f)
        if kind:
            tally[kind] += 1
            ElementTree.SubElement(
                test, kind, message=_clean(f"{f.verdict.text} ({f.source})")
            ).text = _clean(f.message)
    for kind, attribute in (("failure", "failures"), ("error", "errors"), ("skipped", "skipped")):
        suite.set(attribute, str(tally[kind]))
    root = ElementTree.Element("testsuites")
    root.append(suite)
    ElementTree.indent(root)
    return '<?xml version="1.0" encoding="utf-8"?>\n' + ElementTree.tostring(root, encoding="unicode") + "\n"


def _junit_kind(report: Report, f: Finding) -> str:
    if f in report.failing:
        return "failure"
    if f.verdict is Verdict.ERROR:
        return "error"
    return "" if f.verdict is Verdict.HOLDS else "skipped"


def badge_json(report: Report) -> str:
    """What a badge service that takes endpoints shows: the level, the suite's version, how many claimed laws hold."""
    vacuous = (Verdict.NOT_APPLICABLE, Verdict.NOT_MEASURED)
    claimed = [f for f in report.findings if f.claimed and (f.verdict not in vacuous or f in report.failing)]
    held = sum(f.verdict is Verdict.HOLDS for f in claimed)
    color = "brightgreen" if report.exit_code == 0 else "red"
    message = f"{held}/{len(claimed)} claimed laws hold" if claimed else "no claims"
    reached = report.conformance
    if reached is not None:
        waived = f", {len(reached.waived)} waived" if reached.waived else ""
        message = f"level {reached.level} of suite {reached.suite}{waived}: {message}"
    return json.dumps({"schemaVersion": 1, "label": "sepv", "message": message, "color": color}) + "\n"


def _clean(text: str) -> str:
    return _NOT_XML.sub("�", text)
