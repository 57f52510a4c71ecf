"""The global state of the process, which a step must leave as it was.

Random numbers, options and thresholds are set to unusual values before a step is watched. Otherwise
a step that always sets the same value, such as a seed, would show in the very first call only.
"""

from __future__ import annotations

import decimal
import gc
import os
import random
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np

from sepv._arithmetic import in_words
from sepv.errors import SchemeFault, SepvError
from sepv.problem import Array, Problem
from sepv.schemes import Scheme


@contextmanager
def watched(scheme: Scheme) -> Iterator[Scheme]:
    """Context manager that gives a copy of the scheme,
    and on exit raises SchemeFault if a call changed global state.

    While the scheme runs, floating-point errors are warnings, and warnings are ignored. NumPy's
    error handling is checked for changes at the end of each call, because `sepv.schemes._guard`
    undoes them, and so is the arithmetic. Changes by an import are allowed.
    """
    inside: dict[str, Any] = {}

    def step(problem: Problem, y: Array, h: float, dW: Array, *further: Array) -> Array:
        with np.errstate(all="warn"), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            # This unusual filter makes changes visible: else a step that ignores all warnings would
            # change nothing.
            warnings.simplefilter("ignore", ImportWarning)
            filters = list(warnings.filters)
            try:
                answer: Array = scheme.step(problem, y, h, dW, *further)
            finally:
                inside["NumPy's error handling"] = any(value != "warn" for value in np.geterr().values())
                inside["the filters of warnings"] = filters != list(warnings.filters)
                # The guard of calls restores the arithmetic, so that it is looked at before.
                inside.update({words: True for words in [in_words()] if words})
        return answer

    with _unusual():
        before, modules = _state(), len(sys.modules)
        try:
            yield replace(scheme, step=step)
        finally:
            after = _state()
            changed = [key for key, value in after.items() if value != before[key]]
            changed += [key for key, differs in inside.items() if differs]
            if len(sys.modules) != modules:
                changed = [key for key in changed if key not in OF_IMPORTS]
            error = sys.exc_info()[1]
            if changed and (error is None or isinstance(error, SepvError)):
                raise SchemeFault(
                    expected="a step that leaves the process as it was",
                    received=f"a change of {', '.join(changed)}",
                    remedy="use a generator of your own, context managers such as np.errstate, and no -ffast-math",
                )


# State that modules may change while they are imported, which a step may do.
OF_IMPORTS = ("the filters of warnings", "the environment", "the path of modules", "the recursion limit")


def _state() -> dict[str, Any]:
    """Return a dict of the global state that a step must not change,
    with the words for messages as keys.
    """
    kind, keys, *rest = np.random.get_state(legacy=True)  # noqa: NPY002  (the global generator is the point)
    return {
        "NumPy's global random numbers": (kind, keys.tobytes(), *rest),  # type: ignore[union-attr]  # legacy tuple
        "Python's global random numbers": random.getstate(),
        "the current directory": os.getcwd(),
        "the environment": dict(os.environ),
        "the path of modules": list(sys.path),
        "the recursion limit": sys.getrecursionlimit(),
        "NumPy's print options": np.get_printoptions(),
        "the decimal context": repr(decimal.getcontext()),
        "the garbage collector": (gc.isenabled(), gc.get_threshold()),
    }


@contextmanager
def _unusual() -> Iterator[None]:
    """Set random numbers, options and thresholds to values that no scheme sets,
    and restore them at the end.
    """
    python, numpy = random.getstate(), np.random.get_state()  # noqa: NPY002  (the global generator is the point)
    first, *others = gc.get_threshold()
    random.random()
    np.random.random()  # noqa: NPY002
    gc.set_threshold(first + 1, *others)
    try:
        with np.printoptions(precision=13, edgeitems=4), decimal.localcontext() as context:
            context.prec += 1
            yield
    finally:
        gc.set_threshold(first, *others)
        random.setstate(python)
        np.random.set_state(numpy)  # noqa: NPY002
