"""Names of other packages that are no part of their interface and that sepv changes: all of them are here.

Each has its reason upstream. tests/test_patches.py has a test for each that fails once the reason is gone: the patch
goes then.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any


def put_off_blas() -> None:
    """Have numba import scipy.linalg when somebody's code calls BLAS: that is a fifth of the time of a first ensemble.

    numba.np.arraymath imports it to learn whether it is there, and it is, since sepv needs SciPy. What calls BLAS asks
    numba.np.linalg.ensure_blas again.
    """
    from numba.np import linalg

    if "numba.np.arraymath" in sys.modules or not hasattr(linalg, "ensure_blas"):
        return
    asked = linalg.ensure_blas
    linalg.ensure_blas = lambda: None
    try:
        importlib.import_module("numba.np.arraymath")
    finally:
        linalg.ensure_blas = asked


def add_attribute(attributes: Any, text: str) -> None:
    """Add an attribute that LLVM knows to those of a function of llvmlite.

    llvmlite has a list of names and refuses others, such as one with a value, "prefer-vector-width"="512". It is put
    into the set past the check.
    """
    set.add(attributes, text)


@contextmanager
def without_local_constants() -> Iterator[None]:
    """Within it Hypothesis draws from its own list of constants only; what it knew before is back afterwards.

    It also draws constants that it reads in loaded modules, and has no switch for that. A run would depend on the
    command that started it, on the user's own source and on how sepv is installed. Where a release has no such
    constants, or keeps them elsewhere, nothing is changed.
    """
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
