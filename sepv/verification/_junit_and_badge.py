"""Reports for other programs: JUnit XML, and a badge. JSON is `Report.to_json`."""

from __future__ import annotations

import re
from xml.etree import ElementTree

from sepv.files import json_text
from sepv.law import Verdict
from sepv.verification._profiles import SUITE, found
from sepv.verification._shown import Report

# Characters that XML 1.0 cannot hold, not even escaped.
_NOT_XML = re.compile("[^\t\n\r -\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def junit_xml(report: Report) -> str:
    """The report as JUnit XML: each law is a test case that passes, fails,
    has an error or is skipped.
    """
    name, seconds = _clean(report.scheme.name), f"{sum(f.seconds for f in report.findings):.3f}"
    facts = {"name": f"sepv {name}", "tests": str(len(report.findings)), "time": seconds}
    suite = ElementTree.Element("testsuite", facts)
    tally = {"failure": 0, "error": 0, "skipped": 0}
    for f in report.findings:
        facts = {"classname": name, "name": f.law, "time": f"{f.seconds:.3f}"}
        test = ElementTree.SubElement(suite, "testcase", facts)
        tag = {Verdict.ERROR: "error", Verdict.HOLDS: ""}.get(f.verdict, "skipped")
        kind = "failure" if f in report.failing else tag
        if kind:
            tally[kind] += 1
            why = _clean(f.words)
            again = f"replay: {report.again(f)}" if f.replay else ""
            text = "\n".join(part for part in (f.message, again) if part)
            ElementTree.SubElement(test, kind, message=why).text = _clean(text)
    for kind, count in tally.items():
        suite.set(kind if kind == "skipped" else f"{kind}s", str(count))
    root = ElementTree.Element("testsuites")
    root.append(suite)
    ElementTree.indent(root)
    return '<?xml version="1.0" encoding="utf-8"?>\n' + ElementTree.tostring(root, encoding="unicode") + "\n"


# The most characters on a badge.
BADGE = 60


def badge_json(report: Report) -> str:
    """A badge, as JSON for a badge service: the first reason why a run fails,
    or the profiles that were found.

    The badge is green for exit code 0, orange if laws are undecided or end in an error, red for a
    failure. Its text has at most BADGE characters; "+6" stands for six reasons or profiles more.
    """
    undecided = (Verdict.INCONCLUSIVE, Verdict.ERROR, Verdict.NOT_MEASURED)
    wrong = [f for f in report.findings if f in report.failing or (f.claimed and f.verdict in undecided)]
    reasons = [f"{f.law} {f.verdict.text}" for f in wrong] + [f"no {name}" for name in report.missing]
    waived = f"; waived: {', '.join(report.waived)}" if report.waived else ""
    waived = waived if len(waived) <= BADGE // 2 else f"; {len(report.waived)} waived"
    held = _fitting(found(report.profiles) or ["no profile"], BADGE - len(waived)) + waived
    words = _fitting(reasons, BADGE, most=1) if reasons else held
    red = report.missing or any(f.verdict not in undecided for f in wrong)
    color = "brightgreen" if report.exit_code == 0 else "red" if red else "orange"
    badge = {"schemaVersion": 1, "label": f"sepv {SUITE}", "message": words, "color": color}
    return json_text(badge, indent=None)


def _fitting(parts: list[str], room: int, most: int | None = None) -> str:
    """The first `parts` with commas, as many as fit and at most `most`,
    and "+N" for the N that are left out.
    """
    for count in range(most or len(parts), 0, -1):
        text = ", ".join(parts[:count]) + (f", +{len(parts) - count}" if count < len(parts) else "")
        if len(text) <= room:
            return text
    return text[: room - 1] + "…"


def _clean(text: str) -> str:
    return _NOT_XML.sub("�", text)
