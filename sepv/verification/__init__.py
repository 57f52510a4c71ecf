"""Verification of a scheme: its laws (required properties), the test cases and bounds of each law, and a run of laws.

Read `_law` first (a law, its verdict, a run's effort), then `_verify` (a run of laws) with `_laws` (the list of laws)
and `_outcome` (the report). `_search` measures laws about single steps; their cases come from `strategies` and
`_cases`. `_tolerance` derives every bound. `_report` prints a report. `_profiles` states which properties a scheme was
found to have. The laws themselves, one in each file, and the tools of their measurements are in `sepv.properties`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from sepv._lazy import lazily
from sepv.schemes import ALL_LAWS as ALL_LAWS
from sepv.schemes import LAWS as LAWS
from sepv.verification import _law as law
from sepv.verification import _verify as suite
from sepv.verification._amplification import amplification as amplification
from sepv.verification._cases import case as cases
from sepv.verification._cases.case import Case as Case
from sepv.verification._cases.case import has_words, quiet_problem, require_named
from sepv.verification._cases.from_problem import describe
from sepv.verification._cases.of_law import Cases as Cases
from sepv.verification._expected_failures import Expectations as Expectations
from sepv.verification._expected_failures import load as load_expectations
from sepv.verification._expected_failures import pin, to_toml
from sepv.verification._law import Effort as Effort
from sepv.verification._law import Finding as Finding
from sepv.verification._law import Law as Law
from sepv.verification._law import LawViolated as LawViolated
from sepv.verification._law import Measurement as Measurement
from sepv.verification._law import Middle as Middle
from sepv.verification._law import Run as Run
from sepv.verification._law import Verdict as Verdict
from sepv.verification._law import require as require
from sepv.verification._law import to_bound, verdict_text
from sepv.verification._laws import laws_of, renamed
from sepv.verification._laws import load_laws as load_laws
from sepv.verification._outcome import Report as Report
from sepv.verification._outcome import fails
from sepv.verification._profiles import PROFILES as PROFILES
from sepv.verification._profiles import SUITE as SUITE
from sepv.verification._profiles import Profile as Profile
from sepv.verification._profiles import requirements
from sepv.verification._search import searched as searched
from sepv.verification._tolerance import casimir_bound as casimir_bound
from sepv.verification._tolerance import casimir_ulp
from sepv.verification._tolerance import energy_bound as energy_bound
from sepv.verification._tolerance import energy_ulp as energy_ulp
from sepv.verification._tolerance import state_ulp as state_ulp
from sepv.verification._tolerance import step_residual as step_residual
from sepv.verification._units import units_of
from sepv.verification._verify import along_paths, load_in_time, measure, replay
from sepv.verification._verify import verify as verify

if TYPE_CHECKING:
    from sepv.verification import _github as github
    from sepv.verification import _report as report
    from sepv.verification._against import against, read_report
    from sepv.verification._course import with_courses
    from sepv.verification._coverage import show as show_coverage
    from sepv.verification._junit_and_badge import badge_json, junit_xml
    from sepv.verification._progress import watching
    from sepv.verification._report import same_error

__getattr__, __dir__ = lazily(
    __name__,
    {
        "_against": "against read_report",
        "_course": "with_courses",
        "_coverage": "show_coverage=show",
        "_github": "*github",
        "_junit_and_badge": "badge_json junit_xml",
        "_progress": "watching",
        "_report": "*report same_error",
    },
)
