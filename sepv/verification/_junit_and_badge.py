"""A report for other programs: JUnit XML, a badge. JSON is `Report.to_json`."""

from __future__ import annotations

import re
from xml.etree import ElementTree

from sepv.files import json_text
from sepv.verification._law import Verdict
from sepv.verification._outcome import Report

# What XML 1.0 cannot hold, not even escaped.
_NOT_XML = re.compile("[^\t\n\r -\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def junit_xml(report: Report) -> str:
    """The report as JUnit XML: a law is a test case; what is not claimed cannot fail and is skipped instead."""
    name, seconds = _clean(report.scheme.name), f"{sum(f.seconds for f in report.findings):.3f}"
    facts = {"name": f"sepv {name}", "tests": str(len(report.findings)), "time": seconds}
    suite = ElementTree.Element("testsuite", facts)
    tally = {"failure": 0, "error": 0, "skipped": 0}
    for f in report.findings:
        facts = {"classname": name, "name": f.law, "time": f"{f.seconds:.3f}"}
        test = ElementTree.SubElement(suite, "testcase", facts)
        own = {Verdict.ERROR: "error", Verdict.HOLDS: ""}.get(f.verdict, "skipped")
        kind = "failure" if f in report.failing else own
        if kind:
            tally[kind] += 1
            why = _clean(f"{f.verdict.text} ({f.source})")
            again = f"replay: {report.again(f)}" if f.replay else ""
            text = "\n".join(part for part in (f.message, again) if part)
            ElementTree.SubElement(test, kind, message=why).text = _clean(text)
    for kind, count in tally.items():
        suite.set(kind if kind == "skipped" else f"{kind}s", str(count))
    root = ElementTree.Element("testsuites")
    root.append(suite)
    ElementTree.indent(root)
    return '<?xml version="1.0" encoding="utf-8"?>\n' + ElementTree.tostring(root, encoding="unicode") + "\n"


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
    return json_text({"schemaVersion": 1, "label": "sepv", "message": message, "color": color}, indent=None)


def _clean(text: str) -> str:
    return _NOT_XML.sub("�", text)
