"""The record of a law and its verdicts, the cases on which it is measured, its bounds,
and the search for a violation.

Read `_law` first (a law, its verdict, a run's effort). `cases` has the test cases, `tolerance`
every bound, `search` measures a law about single steps. `strategies` draws cases by Hypothesis. The
laws themselves are in `sepv.properties`, one a file, and a run of them is in `sepv.verification`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from sepv._lazy import lazily
from sepv.law._amplification import amplification
from sepv.law._law import (
    Effort,
    Finding,
    Law,
    LawViolated,
    Measure,
    Measurement,
    Middle,
    Run,
    Verdict,
    about_noise,
    collecting,
    in_units,
    laws_in,
    require,
    same_error,
    to_bound,
    verdict_text,
)
from sepv.law.cases.case import NO_NOISE, Case, has_words, quiet_problem, require_named
from sepv.law.cases.from_problem import describe
from sepv.law.cases.of_law import Cases
from sepv.law.search import searched
from sepv.law.tolerance import (
    casimir_bound,
    casimir_ulp,
    energy_bound,
    energy_ulp,
    state_ulp,
    step_residual,
)
from sepv.law.units import units_of

if TYPE_CHECKING:
    from sepv.law._first_order import first_order

__getattr__, __dir__ = lazily(__name__, {"_first_order": "first_order"})
