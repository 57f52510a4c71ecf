"""All patches of other packages: names outside their interfaces that sepv changes.

Each has its reason upstream. tests/simulate/test_compiled_code.py has a test for each that fails once the reason is
gone; then the patch goes.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any


def put_off_blas() -> None:
    """Make numba import scipy.linalg only for code that calls BLAS: that is a fifth of the time of a first ensemble.

    numba.np.arraymath imports it to learn if it is there, which it is, since sepv needs SciPy. Code that calls BLAS
    asks numba.np.linalg.ensure_blas again.
    """
    from numba.np import linalg

    if "numba.np.arraymath" in sys.modules or not hasattr(linalg, "ensure_blas"):
        return
    ensure_blas = linalg.ensure_blas
    linalg.ensure_blas = lambda: None
    try:
        importlib.import_module("numba.np.arraymath")
    finally:
        linalg.ensure_blas = ensure_blas


def add_attribute(attributes: Any, text: str) -> None:
    """Add an attribute that LLVM knows to those of a function of llvmlite.

    llvmlite has a list of names and refuses others, such as one with a value, "prefer-vector-width"="512". This one
    goes into the set without the check.
    """
    set.add(attributes, text)


@contextmanager
def without_local_constants() -> Iterator[None]:
    """A context in which Hypothesis draws from its own list of constants only; its state is restored at the end.

    It also draws constants that it reads in loaded modules, and has no switch for that. A run would depend on the
    command that started it, on the user's own source and on how sepv is installed. A release without such constants,
    or with them elsewhere, is not changed.
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
