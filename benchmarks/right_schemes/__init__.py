"""Right schemes that look unusual. No law may call one of their claims violated.

Each scheme claims what theory proves for it and no more. `solved_otherwise` has variants of (2.1)
with other solvers than the core's Newton iteration, other orders of summation, fewer roundings or
more refusals. `other_formulas` has other schemes, and `with_memory` methods that carry a state.
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

RIGHT: dict[str, Scheme] = {
    s.name: s
    for s in (
        *solved_otherwise.SCHEMES,
        *other_formulas.SCHEMES,
        *charges.SCHEMES,
        *friction.SCHEMES,
        *long_times.SCHEMES,
        *in_single_precision.SCHEMES,
        *with_memory.SCHEMES,
        *stated.SCHEMES,
    )
}
