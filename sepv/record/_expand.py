"""Expansion of recorded functions into sums of monomials,
if every recorded operation gives such a sum.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from sepv.record._replay import replay
from sepv.record._symbols import Symbol

Monomials = dict[tuple[int, ...], float]


class NotMonomials(Exception):
    """Raised if the result of a recorded operation is no sum of monomials."""


class _Sum:
    """A sum of monomials Σ c_e y^e, whose exponents may be negative:
    a later factor may cancel a division by y_i.
    """

    def __init__(self, terms: Monomials) -> None:
        self.terms = terms

    def __add__(self, other: _Sum) -> _Sum:
        terms = dict(self.terms)
        for e, c in other.terms.items():
            terms[e] = terms.get(e, 0.0) + c
        return _Sum({e: c for e, c in terms.items() if c != 0})

    def __neg__(self) -> _Sum:
        return _Sum({e: -c for e, c in self.terms.items()})

    def __sub__(self, other: _Sum) -> _Sum:
        return self + -other

    def __mul__(self, other: _Sum) -> _Sum:
        total = _Sum({})
        for e, c in self.terms.items():
            total = total + _Sum({_together(e, f, 1): c * b for f, b in other.terms.items()})
        return total

    def __truediv__(self, other: _Sum) -> _Sum:
        if len(other.terms) != 1:
            raise NotMonomials
        ((f, b),) = other.terms.items()
        return _Sum({_together(e, f, -1): c / b for e, c in self.terms.items()})


def _together(e: tuple[int, ...], f: tuple[int, ...], sign: int) -> tuple[int, ...]:
    return tuple(a + sign * b for a, b in zip(e, f, strict=True))


def _refused(*_: Any) -> Any:
    raise NotMonomials


def expand(outputs: Sequence[Symbol], inputs: Sequence[Symbol], most: int) -> list[Monomials] | None:
    """The outputs multiplied out into polynomials of the inputs.

    The result is None if an output is no polynomial, or if the outputs have more than `most` terms
    in total.
    """
    d = len(inputs)
    start = {x.index: _Sum({tuple(int(i == k) for i in range(d)): 1.0}) for k, x in enumerate(inputs)}
    zero = (0,) * d
    try:
        sums = replay(outputs, start, _refused, lambda c: _Sum({zero: c} if c else {}), _refused)
    except (NotMonomials, KeyError, TypeError):  # comparisons of sums are not defined
        return None
    expanded = [s.terms for s in sums]
    if sum(map(len, expanded)) > most or any(k < 0 for terms in expanded for e in terms for k in e):
        return None
    return expanded
