"""From a scheme to verdicts: laws, their cases, their bounds, and the run that measures them.

Read `_law` first (a law, an effort, a verdict), then `_verify` (a run over all laws) with `_laws` (their list) and
`_outcome` (the report). `_search` has laws about single steps, whose cases come from `strategies` and `_cases`;
`_sequential` laws about whole paths, and `_orders` laws about orders. `_tolerance` derives every bound. `_report`
prints a run, `_profiles` summarises its findings. The laws themselves, one a file, are `sepv.properties`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from sepv._lazy import lazily
from sepv.verification import _law as law
from sepv.verification import _verify as suite
from sepv.verification._amplification import amplification
from sepv.verification._cases import case as cases
from sepv.verification._cases.case import Case, has_words, quiet_problem, require_named
from sepv.verification._cases.from_problem import describe
from sepv.verification._cases.of_law import Cases
from sepv.verification._expected_failures import Expectations, pin, to_toml
from sepv.verification._expected_failures import load as load_expectations
from sepv.verification._law import (
    Effort,
    Finding,
    Law,
    LawViolated,
    Measurement,
    Run,
    Verdict,
    require,
    verdict_text,
)
from sepv.verification._laws import LAWS, laws_of, load_laws
from sepv.verification._outcome import Report, fails
from sepv.verification._profiles import PROFILES, SUITE, Profile, requirements
from sepv.verification._search import searched
from sepv.verification._tolerance import (
    casimir_bound,
    casimir_ulp,
    energy_bound,
    energy_ulp,
    state_ulp,
    step_residual,
)
from sepv.verification._units import units_of
from sepv.verification._verify import load_in_time, measure, replay, verify

if TYPE_CHECKING:
    from sepv.verification import _github as github
    from sepv.verification import _report as report
    from sepv.verification._against import against, read_report
    from sepv.verification._course import with_courses
    from sepv.verification._coverage import show as show_coverage
    from sepv.verification._junit_and_badge import badge_json, junit_xml
    from sepv.verification._orders.convergence import StrongErrors
    from sepv.verification._orders.convergence import slope as mean_square_slope
    from sepv.verification._orders.gaussian import rule as gaussian_rule
    from sepv.verification._orders.gaussian import rule_for as gaussian_rule_for
    from sepv.verification._orders.local_errors import local_errors
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
        "_orders.convergence": "StrongErrors mean_square_slope=slope",
        "_orders.gaussian": "gaussian_rule=rule gaussian_rule_for=rule_for",
        "_orders.local_errors": "local_errors",
        "_progress": "watching",
        "_report": "*report same_error",
    },
)
