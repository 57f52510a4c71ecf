"""Hypothesis profiles for these tests: the same examples in every run by default, never a deadline.

``--hypothesis-profile fresh`` draws new ones, ``--hypothesis-profile deep`` many of them.
"""

from __future__ import annotations

from hypothesis import HealthCheck, settings

# Cases are large by nature: too slow a draw is no finding here.
_COMMON = {"deadline": None, "database": None, "suppress_health_check": [HealthCheck.too_slow]}

settings.register_profile("ci", derandomize=True, **_COMMON)
settings.register_profile("fresh", derandomize=False, print_blob=True, **_COMMON)
settings.register_profile("deep", derandomize=False, print_blob=True, max_examples=2000, **_COMMON)
settings.load_profile("ci")
