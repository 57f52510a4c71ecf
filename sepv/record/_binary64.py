"""Two numbers of binary64: EPS, the spacing at 1, and TINY, the smallest normal number."""

EPS = 2.0**-52
TINY = 2.0**-1022
