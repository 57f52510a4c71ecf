"""The step with its claims, for `sepv verify spinning.laws:scheme`."""

import sepv
from spinning.midpoint import step

scheme = sepv.Scheme(
    "spinning midpoint",
    step,
    claims=["casimir", "symmetry", "noise-sum"],
    mean_square_order=1.0,
    source="Milstein, Repin and Tretyakov (2002)",
)
