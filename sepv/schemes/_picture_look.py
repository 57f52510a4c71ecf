"""The look of a scheme in pictures: a colour, a marker and a dash pattern."""

from __future__ import annotations

import re
from dataclasses import dataclass

from sepv.errors import UsageError

# Markers of matplotlib; "" is a line without markers.
MARKERS = ("o", "s", "^", "D", "v", "*", "x", "+", "<", ">", "P", "X", "h", "p", "d", "")


@dataclass(frozen=True)
class Look:
    """The look of a scheme's curve in pictures: a colour on white, one on a dark screen,
    a marker and a dash pattern.

    Attributes
    ----------
    colour, dark : str
        Colours as #RRGGBB, best with a contrast of 3 or more: `colour` against white, and `dark`
        against #0F1419.
    marker : str
        One of `MARKERS`.
    dash : str
        Lengths of dashes and gaps with blanks between them, such as "6 2"; "" for a solid line.

    Raises
    ------
    UsageError
    """

    colour: str
    dark: str
    marker: str = "o"
    dash: str = ""

    def __post_init__(self) -> None:
        colour, dashes = "#[0-9A-Fa-f]{6}", r"(\d{1,2} \d{1,2}( |$))*"
        for attribute, pattern, expected in (
            ("colour", colour, "#RRGGBB"),
            ("dark", colour, "#RRGGBB"),
            ("marker", "|".join(map(re.escape, MARKERS)), f"one of {' '.join(MARKERS)}"),
            ("dash", dashes, 'pairs of lengths such as "6 2"'),
        ):
            if not re.fullmatch(pattern, str(getattr(self, attribute))):
                raise UsageError(
                    expected=f"Look({attribute}=…), {expected}",
                    received=repr(getattr(self, attribute)),
                    remedy="see sepv.schemes.Look",
                )
