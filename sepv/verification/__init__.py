"""Verification of a scheme: a run of laws, its report,
and what is claimed of a scheme for later runs.

Read `_verify` first (a run of laws), then `_laws` (the order of laws) and `_outcome` (the report).
`_report` prints a report. `_profiles` states which properties a scheme was found to have. What a
law is made of is in `sepv.law`; the laws themselves, one in each file, are in `sepv.properties`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from sepv._lazy import lazily
from sepv.law import Case as Case
from sepv.law import Cases as Cases
from sepv.law import Effort as Effort
from sepv.law import Finding as Finding
from sepv.law import Law as Law
from sepv.law import LawViolated as LawViolated
from sepv.law import Measurement as Measurement
from sepv.law import Middle as Middle
from sepv.law import Run as Run
from sepv.law import Verdict as Verdict
from sepv.law import amplification as amplification
from sepv.law import casimir_bound as casimir_bound
from sepv.law import energy_bound as energy_bound
from sepv.law import energy_ulp as energy_ulp
from sepv.law import require as require
from sepv.law import searched as searched
from sepv.law import state_ulp as state_ulp
from sepv.law import step_residual as step_residual
from sepv.properties import load_laws as load_laws
from sepv.schemes import ALL_LAWS as ALL_LAWS
from sepv.schemes import LAWS as LAWS
from sepv.verification._expected_failures import Expectations as Expectations
from sepv.verification._expected_failures import load as load_expectations
from sepv.verification._expected_failures import pin, to_toml
from sepv.verification._laws import laws_of
from sepv.verification._outcome import fails
from sepv.verification._profiles import PROFILES as PROFILES
from sepv.verification._profiles import SUITE as SUITE
from sepv.verification._profiles import Profile as Profile
from sepv.verification._profiles import requirements
from sepv.verification._shown import Report as Report
from sepv.verification._verify import along_paths, load_candidate, load_in_time, measure, replay
from sepv.verification._verify import verify as verify

if TYPE_CHECKING:
    from sepv.verification import _github as github
    from sepv.verification import _report as report
    from sepv.verification._against import against, read_report
    from sepv.verification._course import with_courses
    from sepv.verification._coverage import show as show_coverage
    from sepv.verification._junit_and_badge import badge_json, junit_xml
    from sepv.verification._progress import watching
    from sepv.verification._report import VERDICT_MARKS

__getattr__, __dir__ = lazily(
    __name__,
    {
        "_against": "against read_report",
        "_course": "with_courses",
        "_coverage": "show_coverage=show",
        "_github": "*github",
        "_junit_and_badge": "badge_json junit_xml",
        "_progress": "watching",
        "_report": "VERDICT_MARKS *report",
    },
)
