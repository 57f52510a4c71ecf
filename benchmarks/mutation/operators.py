"""What is changed: mutmut's operators without those that can only crash, and a few for numerical code.

Left out of mutmut's are strings (texts), `a = None` for an assignment, and None or nothing for a positional argument:
on arrays they end in a TypeError whatever the tests are, and would only flatter the score. Keyword arguments are
dropped. Added are a comparison turned round, max for min, any for all, and x for |x| and √x.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import libcst as cst
from mutmut.mutation import mutators

LEFT_OUT = ("operator_string", "operator_assignment", "operator_arg_removal", "operator_dict_arguments")
TURNED: dict[type[cst.BaseCompOp], type[cst.BaseCompOp]] = {
    cst.LessThan: cst.GreaterThanEqual,
    cst.LessThanEqual: cst.GreaterThan,
    cst.GreaterThan: cst.LessThanEqual,
    cst.GreaterThanEqual: cst.LessThan,
}
PAIRS = [
    ("max", "min"),
    ("maximum", "minimum"),
    ("fmax", "fmin"),
    ("any", "all"),
    ("zeros", "ones"),
    ("cos", "sin"),
]
SWAPPED = {a: b for pair in PAIRS for a, b in (pair, pair[::-1])}
IDENTITIES = ("abs", "sqrt")


def turned_comparison(node: cst.ComparisonTarget) -> Iterator[cst.CSTNode]:
    """x < y becomes x >= y."""
    if type(node.operator) in TURNED:
        yield node.with_changes(operator=TURNED[type(node.operator)]())


def swapped_function(node: cst.Call) -> Iterator[cst.CSTNode]:
    """np.max(x), x.max() and max(x) become their opposites; |x| and √x become x."""
    name = node.func.attr if isinstance(node.func, cst.Attribute) else node.func
    if not isinstance(name, cst.Name):
        return
    if name.value in SWAPPED:
        yield node.with_deep_changes(name, value=SWAPPED[name.value])
    if name.value in IDENTITIES and len(node.args) == 1:
        yield node.args[0].value.with_changes(lpar=[cst.LeftParen()], rpar=[cst.RightParen()])


def dropped_keyword(node: cst.Call) -> Iterator[cst.CSTNode]:
    """f(x, axis=0) becomes f(x)."""
    for i, argument in enumerate(node.args):
        if argument.keyword is not None and argument.keyword.value != "strict":
            yield node.with_changes(args=[*node.args[:i], *node.args[i + 1 :]])


OPERATORS: list[tuple[type, Callable[[Any], Any]]] = [
    *(
        (kind, operator)
        for kind, operator in mutators.mutation_operators
        if operator.__name__ not in LEFT_OUT
    ),
    (cst.ComparisonTarget, turned_comparison),
    (cst.Call, swapped_function),
    (cst.Call, dropped_keyword),
]
