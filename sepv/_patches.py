"""All patches of other packages: names outside the packages' public interfaces that sepv changes.

Each patch is needed because of one behaviour of the other package. For each patch,
tests/simulate/test_compiled_code.py has a test that fails once this behaviour has changed. Then the
patch must be removed.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any


def put_off_blas() -> None:
    """Make numba import scipy.linalg only for code that calls BLAS:
    this saves a fifth of the first ensemble's time.

    numba.np.arraymath imports scipy.linalg to check that it is installed, which sepv requires
    anyway. Code that calls BLAS makes the same check again, by numba.np.linalg.ensure_blas.
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
    """Add an attribute of LLVM, as text, to the attributes of a function of llvmlite.

    llvmlite has a list of names and refuses others, such as a name with a value,
    "prefer-vector-width"="512". This function adds the text to the set of attributes without
    llvmlite's check.
    """
    set.add(attributes, text)


@contextmanager
def without_local_constants() -> Iterator[None]:
    """A context in which Hypothesis draws from its own list of constants only;
    its state is restored at the end.

    By default Hypothesis also draws constants that it reads in loaded modules, and no option
    prevents that. The run would then depend on the command that started it, on the user's own
    source and on how sepv is installed. If a release of Hypothesis has no such constants, or has
    them under other names, nothing is changed.
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
