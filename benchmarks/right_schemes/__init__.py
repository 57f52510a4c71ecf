"""Right schemes that look unusual. No law may call one of their claims violated.

Each scheme claims what theory proves for it and no more. `solved_otherwise` has variants of (2.1)
with other solvers than the core's Newton iteration, other orders of summation, fewer roundings or
more refusals. `other_formulas` and `mechanical` have other schemes, and `with_memory` methods that
carry a state.
tests/verification/test_right_schemes.py and `benchmarks.false_alarms` run the suite on all of them.
"""

from __future__ import annotations

from benchmarks.right_schemes import (
    charges,
    friction,
    in_single_precision,
    long_times,
    other_formulas,
    solved_otherwise,
    stated,
    with_memory,
)
from sepv.schemes import Scheme

RIGHT_SCHEMES: dict[str, Scheme] = {
    s.name: s
    for s in (
        *solved_otherwise.OTHERWISE_SOLVED,
        *other_formulas.OTHER_FORMULAS,
        *charges.CHARGE_SCHEMES,
        *friction.FRICTION_SCHEMES,
        *long_times.LONG_TIME_SCHEMES,
        *in_single_precision.SINGLE_PRECISION_SCHEMES,
        *with_memory.SCHEMES_WITH_MEMORY,
        *stated.STATED_SCHEMES,
    )
}
