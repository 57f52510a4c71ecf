"""How a scheme looks in pictures. Nothing is said by colour alone: markers and dashes differ too."""

from __future__ import annotations

import re
from dataclasses import dataclass

from sepv.errors import UsageError

# Markers of matplotlib's alphabet; "" for a line without any.
MARKERS = ("o", "s", "^", "D", "v", "*", "x", "+", "<", ">", "P", "X", "h", "p", "d", "")


@dataclass(frozen=True)
class Look:
    """A colour on light paper, one on a dark screen, a marker and a dash pattern.

    Attributes
    ----------
    colour, dark : str
        As #RRGGBB. Both are read best with a contrast of 3 or more against white and against #0F1419.
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
        for what, value, ok, expected in (
            ("colour", self.colour, _is_colour(self.colour), "#RRGGBB"),
            ("dark", self.dark, _is_colour(self.dark), "#RRGGBB"),
            ("marker", self.marker, self.marker in MARKERS, f"one of {' '.join(MARKERS)}"),
            (
                "dash",
                self.dash,
                re.fullmatch(r"(\d{1,2} \d{1,2}( |$))*", self.dash),
                'pairs of lengths such as "6 2"',
            ),
        ):
            if not ok:
                raise UsageError(
                    expected=f"Look({what}=…), {expected}",
                    received=repr(value),
                    remedy="see sepv.schemes.Look",
                )


def _is_colour(text: str) -> bool:
    return bool(re.fullmatch("#[0-9A-Fa-f]{6}", text))
