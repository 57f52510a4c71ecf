"""A scheme from what a user names: a built-in, or module:attribute."""

from __future__ import annotations

import importlib
import inspect
import os
import sys
from collections.abc import Iterable
from dataclasses import replace
from typing import Any

from sepv.errors import TargetError, UsageError
from sepv.scheme import Scheme, Step


def load_scheme(target: str | Scheme | Step, claims: Iterable[str] = ()) -> Scheme:
    """The scheme that `target` names or is.

    Parameters
    ----------
    target : str, Scheme or function
        A built-in name (``energy-preserving``), ``module:attribute``, a `Scheme`, or a function
        ``step(problem, y, h, dW)``, of which nothing is claimed.
    claims : iterable of law names
        Claimed in addition.

    Raises
    ------
    TargetError
        Where it cannot be loaded or is not a scheme, with what it is instead.
    """
    name = getattr(target, "__name__", "scheme")
    scheme = _named(target) if isinstance(target, str) else as_scheme(target, name)
    extra = frozenset(claims)
    return replace(scheme, claims=frozenset(scheme.claims) | extra) if extra else scheme


def as_scheme(value: Any, name: str) -> Scheme:
    """A `Scheme` as it is; a function as a scheme that claims nothing.

    Raises
    ------
    TargetError
        For anything that cannot be called with (problem, y, h, dW).
    """
    if isinstance(value, Scheme):
        _check_signature(value.step, name)
        return value
    if not callable(value):
        raise TargetError(
            expected="a sepv.Scheme or a function step(problem, y, h, dW) -> y_next",
            received=f"{name}, which is {type(value).__name__}: {value!r:.80}",
            remedy="name the function itself: module:function",
        )
    if inspect.isclass(value):
        raise TargetError(
            expected="a sepv.Scheme or a function step(problem, y, h, dW) -> y_next",
            received=f"{name}, which is a class",
            remedy="name an instance's method or a function that uses the class",
        )
    _check_signature(value, name)
    from sepv.candidate import takes_batches

    scheme = Scheme(name=name, step=value, source="a function of which nothing is claimed")
    return replace(scheme, batched=takes_batches(scheme))


def _check_signature(step: Any, name: str) -> None:
    try:
        signature = inspect.signature(step)
    except (TypeError, ValueError):
        return  # a compiled callable: the contract law asks it
    try:
        signature.bind(None, None, None, None)
    except TypeError as error:
        raise TargetError(
            expected="a function that takes (problem, y, h, dW)",
            received=f"{name}{signature}: {error}",
            remedy="wrap it: def step(problem, y, h, dW): ...",
        ) from error


def _named(target: str) -> Scheme:
    if ":" not in target:
        from sepv.schemes import by_name

        try:
            return by_name(target)
        except UsageError as error:
            raise TargetError(
                expected=f"{error.expected}, or module:attribute",
                received=error.received,
                remedy="see `sepv list`; your own scheme goes as mypackage.mymodule:scheme",
            ) from None
    return as_scheme(load_object(target), target)


def load_object(target: str) -> Any:
    """What module:attribute names.

    Raises
    ------
    TargetError
        Where the module cannot be imported, or has no such attribute.
    """
    module_name, _, attribute = target.partition(":")
    module = _module(module_name)
    value: Any = module
    for part in attribute.split("."):
        try:
            value = getattr(value, part)
        except AttributeError as error:
            names = [n for n in vars(module) if not n.startswith("_") and callable(getattr(module, n, None))]
            raise TargetError(
                expected=f"an attribute {attribute!r} in module {module_name}",
                received=f"a module with {', '.join(names[:8]) or 'no public functions'}",
                remedy="correct the name after the colon",
            ) from error
    return value


def _module(name: str) -> Any:
    # As for `python -m`: modules of the current directory can be named.
    if os.getcwd() not in sys.path and "" not in sys.path:
        sys.path.insert(0, os.getcwd())
    try:
        return importlib.import_module(name)
    except UsageError as error:
        raise TargetError(expected=error.expected, received=error.received, remedy=error.remedy) from error
    except ModuleNotFoundError as error:
        missing = error.name or name
        raise TargetError(
            expected=f"a module {name} that can be imported",
            received=f"no module named {missing!r}",
            remedy="run in its folder, install it, or correct the name before the colon"
            if name == missing or name.startswith(missing + ".")
            else f"install {missing}, which {name} imports",
        ) from error
    except (Exception, SystemExit) as error:
        raise TargetError(
            expected=f"a module {name} that can be imported",
            received=f"{type(error).__name__} while importing it: {error}",
            remedy=f"make `python -c 'import {name}'` work first",
        ) from error
