"""The same examples whatever else is loaded: Hypothesis also draws constants that it reads in loaded modules.

With them a run would depend on the command that started it, on the user's own source and on how sepv is installed.
There is no public switch. Where a release of Hypothesis has no such constants, or keeps them elsewhere, nothing is
changed here, and tests/test_search.py says so.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any


@contextmanager
def without_local_constants() -> Iterator[None]:
    """Within it Hypothesis draws from its own list of constants only; what it knew before is back afterwards."""
    providers: Any
    try:
        from hypothesis.internal.conjecture import providers

        before = providers._get_local_constants
        none = providers.Constants()
        cache = providers.CONSTANTS_CACHE.cache
    except (ImportError, AttributeError, TypeError):
        yield
        return
    cache.clear()
    providers._get_local_constants = lambda: none
    try:
        yield
    finally:
        providers._get_local_constants = before
        cache.clear()
