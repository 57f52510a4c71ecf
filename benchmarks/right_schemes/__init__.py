"""Right schemes that look unusual. No law may call one of their claims violated.

Each claims what theory gives it and no more. `solved_otherwise` has (2.1) solved by other means than the core's Newton
iteration, summed in other orders, rounded less or refused more often; `other_formulas` has schemes with laws of their
own. tests/verification/test_right_schemes.py and `benchmarks.false_alarms` run the suite on them.
"""

from __future__ import annotations

from benchmarks.right_schemes import (
    charges,
    in_single_precision,
    long_times,
    other_formulas,
    solved_otherwise,
)
from sepv.schemes import Scheme

RIGHT: dict[str, Scheme] = {
    s.name: s
    for s in (
        *solved_otherwise.SCHEMES,
        *other_formulas.SCHEMES,
        *charges.SCHEMES,
        *long_times.SCHEMES,
        *in_single_precision.SCHEMES,
    )
}
