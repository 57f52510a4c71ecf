"""Schemes and problems loaded from a built-in name, from module:attribute,
or from the object itself.
"""

from __future__ import annotations

import ast
import importlib
import inspect
import os
import shlex
import sys
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from sepv._arguments import did_you_mean, double
from sepv._lazy import find
from sepv.children import TimedOut, one_process
from sepv.errors import ProblemError, TargetError, UnknownTarget, UsageError, said
from sepv.files import read_bounded, read_json
from sepv.problem import NamedProblem, PolynomialSystem, Problem, require_invariants
from sepv.schemes._one_step import Explicit, Implicit
from sepv.schemes._scheme import Scheme, Step, Twin
from sepv.schemes._stateful import StatefulStep

# The positional arguments of a step.
_ARGUMENTS = ("problem", "y", "h", "dW")
_NOTHING_CLAIMED = "a function of which nothing is claimed"


def load_scheme(
    target: str | Scheme | Step, claims: Iterable[str] = (), problems: Iterable[Problem] = ()
) -> Scheme:
    """Load a scheme from its name, or make one from a function.

    Parameters
    ----------
    target : str, Scheme or function
        A built-in name (``energy-preserving``), a solver of another library
        (``sdeint-strat-heun``), ``module:attribute``, a `Scheme`, or a function
        ``step(problem, y, h, dW)``, which claims nothing.
    claims : iterable of law names
        Laws that the scheme is to claim, added to its own claims.
    problems : iterable of Problem
        Problems on which a function is called to see whether it takes batches; by default two of
        the paper's.

    Raises
    ------
    TargetError
        For a target that cannot be loaded or is no scheme. The message says what the target is
        instead.
    """
    name = getattr(target, "__name__", "scheme")
    scheme = _named(target, problems) if isinstance(target, str) else as_scheme(target, name, problems)
    extra = frozenset(claims)
    if not extra:
        return scheme
    source = "a function" if scheme.source == _NOTHING_CLAIMED else scheme.source
    return replace(scheme, claims=frozenset(scheme.claims) | extra, source=source)


def as_scheme(value: Any, name: str, problems: Iterable[Problem] = ()) -> Scheme:
    """Convert a function to a scheme that claims nothing; a `Scheme` is returned unchanged.

    Raises TargetError for anything that cannot be called with (problem, y, h, dW).
    """
    if isinstance(value, Scheme):
        _check_signature(value.step, name, 5 if value.asks else 4)
        return value
    if not callable(value):
        raise TargetError(
            expected="a sepv.Scheme, a scheme's name, or a function step(problem, y, h, dW) -> y_next",
            received=f"{name}, which is {type(value).__name__}: {value!r:.80}",
            remedy="hand over the function itself, or name it: module:function",
        )
    if inspect.isclass(value):
        raise TargetError(
            expected="a sepv.Scheme or a function step(problem, y, h, dW) -> y_next",
            received=f"{name}, which is a class",
            remedy="name an instance's method or a function that uses the class",
        )
    _check_signature(value, name)
    from sepv.schemes._guard import takes_batches

    scheme = Scheme(name=name, step=value, source=_NOTHING_CLAIMED)
    # A state may be any object: only its author can say that it takes batches.
    batched = not isinstance(value, StatefulStep) and takes_batches(scheme, problems)
    return replace(scheme, batched=batched)


def _check_signature(step: Any, name: str, count: int = 4) -> None:
    """Raise a TargetError for a function that cannot be called with `count` arguments,
    (problem, y, h, dW) first.
    """
    if count == 4 and isinstance(step, (Explicit, Implicit)):
        return  # both classes take these four arguments, and `inspect` would take longer than a step
    try:
        signature = inspect.signature(step)
    except (TypeError, ValueError):
        return  # a compiled callable; the contract law tests it
    try:
        signature.bind(*(None,) * count)
    except TypeError as error:
        raise TargetError(
            expected="a function that takes (problem, y, h, dW)",
            received=f"{name}{signature}: {error}",
            remedy="wrap it: def step(problem, y, h, dW): ...",
        ) from error
    named = list(signature.parameters)[: len(_ARGUMENTS)]
    if set(named) == set(_ARGUMENTS) and named != list(_ARGUMENTS):
        raise TargetError(
            expected="a function step(problem, y, h, dW): it is called with these four by their places",
            received=f"{name}{signature}: the same names in another order",
            remedy=f"wrap it: def step(problem, y, h, dW): return …({', '.join(named)})",
        )


def _named(target: str, problems: Iterable[Problem]) -> Scheme:
    """The scheme that a text names: a built-in scheme, a solver of another library,
    or module:attribute.
    """
    if ":" in target:
        return as_scheme(load_object(target), target, problems)
    from sepv.schemes._catalogue import by_name

    try:
        return by_name(target)
    except UsageError as error:
        solver: Scheme | None = find("scheme", target)
        if solver is not None:
            return solver
        own = "your own scheme goes as mypackage.mymodule:scheme"
        raise UnknownTarget(
            expected=f"{error.expected}, or module:attribute",
            received=error.received,
            remedy=_as_module(target) or f"{own}; {error.remedy}",
        ) from None


def load_problem(target: Any) -> Problem:
    """Load a problem from its name, a file or a module, or make one from data or by a function.

    Parameters
    ----------
    target : str, Problem, function, PolynomialSystem or NamedProblem
        A built-in name (``rigid-body``), a file of polynomial data (``.json``),
        ``module:attribute``; or a `Problem`, a function without arguments that returns one, or its
        data.

    Raises
    ------
    UsageError
        For any other target. The message says what the target is instead.
    """
    from sepv import problems

    name = "the problem"
    if isinstance(target, str):
        if target.endswith(".json"):
            return _from_file(Path(target))
        if ":" not in target:
            return problems.by_name(target)
        name, target = target, load_object(target)
    loaded = target
    if isinstance(loaded, (PolynomialSystem, NamedProblem)):
        return problems.build(loaded)
    if not isinstance(loaded, (Problem, Scheme)) and callable(loaded) and _takes_nothing(loaded):
        loaded = loaded()
    if not isinstance(loaded, Problem):
        raise UsageError(
            expected="a sepv.Problem, a problem's name, a .json file of polynomial data, module:attribute, or a "
            "function without arguments that returns a Problem",
            received=f"{name}, which is {type(loaded).__name__}: {loaded!r:.80}",
            remedy="a scheme goes first and a problem second; see `sepv list` for names",
        )
    return loaded


def words_for(scheme: Any, problems: Any = None) -> str:
    """The arguments of ``sepv verify`` on the command line that name a scheme and its problems.

    The text is empty for objects that no text names, such as a function defined in a Python
    session.
    """
    from sepv.schemes._catalogue import by_name

    words = scheme if isinstance(scheme, str) else ""
    if isinstance(scheme, Scheme):
        with suppress(UsageError):
            words = scheme.name if by_name(scheme.name) is scheme else ""
    elif (
        inspect.isfunction(scheme) and scheme.__module__ != "__main__" and scheme.__qualname__.isidentifier()
    ):
        words = f"{scheme.__module__}:{scheme.__qualname__}"
    listed = [] if problems is None else problems if isinstance(problems, (list, tuple)) else [problems]
    if not words or (problems is not None and not listed) or not all(isinstance(p, str) for p in listed):
        return ""
    return " ".join([shlex.quote(words), *(f"-p {shlex.quote(p)}" for p in listed)])


def as_twin(target: Any, bits: bool = False) -> Twin | None:
    """The twin that `agrees_with` names, any target of `load_scheme` or a `Twin`;
    None if it is None.

    Raises UsageError if equal `bits` are asked of no twin.
    """
    if bits and target is None:
        raise UsageError(
            expected="equal bits (--bits, bits=True) to be asked of a second program",
            received="no second program",
            remedy="name it: --agrees-with B, or agrees_with=b",
        )
    if target is None or isinstance(target, Twin):
        return target
    return Twin(target, bits, words_for(target))


def _takes_nothing(function: Any) -> bool:
    """True if the function can be called without arguments."""
    try:
        inspect.signature(function).bind()
    except (TypeError, ValueError):
        return False
    return True


def _from_file(path: Path) -> Problem:
    """The problem of a JSON file of polynomial data, named after the file."""
    from sepv import problems

    data = read_json(
        path,
        expected="a JSON file of a problem",
        remedy="correct the path, or write one: json.dump(sepv.problems.to_json(problem), file)",
    )
    try:
        problem = problems.build(problems.from_json(data))
        initial = [double(v) for v in data["initial"]] if "initial" in data else problem.initial
        named = replace(problem, name=path.stem, initial=initial, check=False)
        require_invariants(named)
        return named
    except UsageError as error:
        raise ProblemError(
            expected=error.expected, received=f"{path}: {error.received}", remedy=error.remedy
        ) from error


def require_trusted(targets: Iterable[Any], named: Iterable[str], scheme: Any) -> None:
    """Refuse a target module:attribute read from a file or a replay token,
    because importing a module runs its code.

    Allowed are the targets in `named`, which the user has given, and those in the scheme's package,
    which runs anyway.

    Raises
    ------
    UsageError
    """
    words = scheme if isinstance(scheme, str) and ":" in scheme else ""
    module = words.partition(":")[0] or getattr(getattr(scheme, "step", scheme), "__module__", None) or ""
    package, known = module.partition(".")[0], list(named)
    for target in targets:
        if not isinstance(target, str) or ":" not in target or target in known:
            continue
        if package in ("", "sepv") or target.partition(":")[0].partition(".")[0] != package:
            raise UsageError(
                expected="a file or token about problems that you name yourself: to import a module is to run it",
                received=f"the problem {target!r:.80} in it",
                remedy=f"where you trust that module, add -p {shlex.quote(target):.80}",
            )


def load_object(target: str) -> Any:
    """Import module:attribute. Raises TargetError if the module cannot be imported or has no such
    attribute.
    """
    module_name, _, attribute = target.partition(":")
    if module_name.endswith(".py"):
        raise UnknownTarget(
            expected="module:attribute, as after import",
            received=f"a file: {target!r}",
            remedy=_as_module(target),
        )
    if not all(part.isidentifier() for part in module_name.split(".")):
        raise UnknownTarget(
            expected="module:attribute, the module as after import: mypackage.mymodule:step",
            received=f"{target!r:.80}",
            remedy="names of letters, digits and _ with dots between them before the colon",
        )
    module = _module(module_name)
    value: Any = module
    for part in [attribute] if hasattr(module, attribute) else attribute.split("."):
        try:
            value = getattr(value, part)
        except AttributeError as error:
            raise _no_attribute(module, attribute) from error
    return value


def _no_attribute(module: Any, attribute: str) -> UnknownTarget:
    """The error for a name that a module lacks; it lists the schemes,
    the problems and the module's own functions.
    """
    public = {name: value for name, value in vars(module).items() if not name.startswith("_")}
    records = [name for name, value in public.items() if isinstance(value, (Scheme, Problem))]
    # Imported functions are suggested for a similar name, and not listed.
    callables = [name for name, value in public.items() if callable(value)]
    defined = [name for name in callables if getattr(public[name], "__module__", None) == module.__name__]
    names = list(dict.fromkeys([*records, *defined]))
    here, top = Path.cwd(), module.__name__.partition(".")[0]
    hidden = any(place.exists() for place in (here / f"{top}.py", here / top / "__init__.py"))
    hidden = hidden and here not in Path(getattr(module, "__file__", None) or "/").parents
    return UnknownTarget(
        expected=f"an attribute {attribute!r} in module {module.__name__}",
        received=f"{did_you_mean(attribute, [*names, *callables])} and a module with "
        + (", ".join(names) or "no public functions or records"),
        remedy=f"rename {top} in this folder: an installed module, or one of Python's, has this name"
        if hidden
        else "correct the name after the colon",
    )


def _as_module(target: str) -> str:
    """The remedy for a target that is the name of a file: ``mine:step`` for mine.py,
    ./mine.py:step or mine.

    The text is empty if the name has no .py and there is no such file.
    """
    name, _, attribute = target.partition(":")
    file = Path(name) if name.endswith(".py") else Path(name.replace(".", "/") + ".py")
    if not (name.endswith(".py") or file.is_file()):
        return ""
    away = file.is_absolute() or ".." in file.parts
    module = file.stem if away else ".".join(file.with_suffix("").parts)
    where = f" in the folder {file.parent}" if away else ""
    return f"name it as {module}:{attribute or _likely_step(file)}{where}"


def _likely_step(file: Path) -> str:
    """The name of the first public function of a file that takes four arguments,
    without running it; else "step".
    """
    try:
        body = ast.parse(read_bounded(file)).body
    except (OSError, SyntaxError, ValueError):
        return "step"
    four = (n.name for n in body if isinstance(n, ast.FunctionDef) and len(n.args.args) == 4)
    return next((name for name in four if not name.startswith("_")), "step")


def _module(name: str) -> Any:
    """Import a module. Raises TargetError, with the reason, if the import fails."""
    # Modules of the current directory can be named. It stands last, so that none of them hides a
    # module of Python's.
    if os.getcwd() not in sys.path and "" not in sys.path:
        sys.path.append(os.getcwd())
    try:
        with one_process():
            return importlib.import_module(name)
    except UsageError as error:
        raise TargetError(expected=error.expected, received=error.received, remedy=error.remedy) from error
    except ModuleNotFoundError as error:
        missing = error.name or name
        raise UnknownTarget(
            expected=f"a module {name} that can be imported",
            received=f"no module named {missing!r}",
            remedy="run in its folder, install it, or correct the name before the colon"
            if name == missing or name.startswith(missing + ".")
            else f"install {missing}, which {name} imports",
        ) from error
    except (KeyboardInterrupt, TimedOut):
        raise
    except BaseException as error:
        raise TargetError(
            expected=f"a module {name} that can be imported",
            received=f"{type(error).__name__} while importing it: {said(error)}",
            remedy=f"make `python -c 'import {name}'` work first",
        ) from error
