"""The numbers of binary64: their spacing at 1, and the smallest one that has all its digits."""

EPS = 2.0**-52
TINY = 2.0**-1022
