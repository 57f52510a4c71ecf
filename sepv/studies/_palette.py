"""One look for every scheme, in every picture: colours that the colour-blind can tell apart, and a marker each.

The colours are those of M. Okabe and K. Ito (2008). Nothing is said by colour alone: markers and dashes
differ too.
"""

from __future__ import annotations

from typing import NamedTuple


class Look(NamedTuple):
    """A colour for light paper, one for a dark screen, a marker of matplotlib's alphabet, a dash pattern."""

    colour: str
    dark: str
    marker: str
    dash: str


_LOOKS = {
    "energy-preserving": Look("#0072B2", "#56B4E9", "o", ""),
    "midpoint": Look("#009E73", "#2CC79A", "^", "6 2"),
    "discrete-gradient": Look("#B0558A", "#E59AC4", "D", "2 2"),
    "euler-heun": Look("#C47F00", "#E69F00", "s", ""),
    "milstein": Look("#6A5ACD", "#B5A8FF", "*", "5 1 1 1"),
    "euler-maruyama": Look("#D55E00", "#FF8A3D", "+", "3 2"),
    "exact-flow": Look("#333333", "#DDDDDD", "v", ""),
    "splitting": Look("#7A5230", "#D2A679", "x", "4 1"),
}
_REFERENCE = Look("#333333", "#DDDDDD", "", "1 2")
_MORE = ("v", "x", "s", "^", "D", "o", "*", "+")


def look(scheme: str, number: int = 0) -> Look:
    """The look of a scheme; of a reference for "", and for a name not known here the next one by number."""
    if not scheme:
        return _REFERENCE
    if scheme in _LOOKS:
        return _LOOKS[scheme]
    base = tuple(_LOOKS.values())[number % len(_LOOKS)]
    return base._replace(marker=_MORE[number % len(_MORE)], dash="8 2 2 2")
