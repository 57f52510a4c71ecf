"""The space of each law: which strata its statement speaks of, for each class of systems.

Laws without one here are searched at random only.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

from sepv.problem import Systems
from sepv.verification._cases import random_cases as make
from sepv.verification._cases import strata
from sepv.verification._cases.strata import Space
from sepv.verification.strategies import ORIGIN_SHARE

_SIZES = (strata.DIMENSION, strata.DEGREE, strata.TERMS)
_SYSTEM = (*_SIZES, strata.STRUCTURE, strata.NOISES)
_STEPS = (strata.SIZE, strata.STEP, strata.SIGN, strata.SHARE, strata.GIVEN)
_SOME_NOISE = ("1", "2", "3–4", "5–8")
_SEVERAL_NOISES = ("2", "3–4", "5–8")
_SHORT = ("1e-5–1e-2", "1e-9–1e-5")
# Substitutions multiply the terms.
_SUBSTITUTED = {"degree_of_H": ("1–2", "3–4", "5–6"), "terms_of_H": ("1–2", "3–9", "10–19")}

# Where no quadrature and no place of B can be wrong.
_QUADRATIC = {"degree_of_H": ("1–2",)}
_CONSTANT = {"degree_of_B": ("0",)}

SINGLE = Space((strata.CASIMIRS, *_SYSTEM, *_STEPS), make.single)
_SINGLE: dict[str, Space] = {
    "contract": SINGLE,
    "energy": SINGLE.without_faults(**_QUADRATIC),
    "symmetry": SINGLE.without_faults(**_CONSTANT),
    "reference": SINGLE.without_faults(**_QUADRATIC, **_CONSTANT),
    "reproducibility": Space((*SINGLE.axes, strata.BATCH), partial(make.batched, make.single)),
    # Most faults are of Δ, and show neither at rest nor where h = 0 without noise.
    "identity": Space((strata.WHY, *SINGLE.axes), make.still).without_faults(why=("∇H = 0",), m=("0",)),
    "casimir": SINGLE.restricted(
        Casimirs=("linear", "quadratic", "two"), d=("3", "4–6", "7–9", "10–12")
    ).without_faults(**_CONSTANT, Casimirs=("linear",)),
    "midpoint": SINGLE.restricted(degree_of_H=("1–2",)).without_faults(**_CONSTANT),
    "reduction": Space((strata.REDUCED, *SINGLE.axes), partial(make.reduced, make.single)),
    "noise-sum": SINGLE.restricted(m=_SEVERAL_NOISES),
    "random-step": SINGLE.restricted(m=_SOME_NOISE).without_faults(**_CONSTANT),
    "expansion": Space(
        (*_SYSTEM, strata.STEP, strata.GIVEN), make.drawn(partial(make.at_origin, ORIGIN_SHARE))
    ).restricted(m=_SOME_NOISE, **{"|Δ|": _SHORT}),
    "equivariance": SINGLE.restricted(
        d=("2", "3", "4–6", "7–9"), degree_of_B=("0", "1", "2–3"), **_SUBSTITUTED
    ),
}
# All but "expansion" ask for the same axes: they take their rows from the design in which least is hidden by others.
_POOL = _SINGLE["reference"]
_POOLED = {
    law: replace(space, pool=_POOL) if law not in ("reference", "expansion") else space
    for law, space in _SINGLE.items()
}

NAMBU = Space((*_SIZES, strata.CASIMIR_DEGREE, strata.FACTOR, strata.NOISES, *_STEPS), make.nambu).restricted(
    d=("3",)
)
_NAMBU: dict[str, Space] = {
    **dict.fromkeys(("contract", "symmetry", "reference"), NAMBU),
    "energy": NAMBU.without_faults(**_QUADRATIC),
    "any-casimir": NAMBU.without_faults(degree_of_C=("1", "2")),
    "reproducibility": Space((*NAMBU.axes, strata.BATCH), partial(make.batched, make.nambu)),
    "identity": Space(NAMBU.axes, partial(make.unmoved, make.nambu)),
    "casimir": NAMBU.restricted(degree_of_C=("1", "2")),
    "midpoint": NAMBU.restricted(degree_of_H=("1–2",), terms_of_H=("1–2", "3–9"), degree_of_C=("2",)),
    "reduction": Space((strata.REDUCED, *NAMBU.axes), partial(make.reduced, make.nambu)),
    "noise-sum": NAMBU.restricted(m=_SEVERAL_NOISES),
    "random-step": NAMBU.restricted(m=_SOME_NOISE),
    "equivariance": NAMBU.restricted(degree_of_C=("1", "2", "3–4"), degree_of_g=("0", "1–2"), **_SUBSTITUTED),
}

SEVERAL = Space((strata.STRUCTURES, *_SYSTEM, *_STEPS), make.several).restricted(
    m=_SOME_NOISE, d=("2", "3", "4–6", "7–9")
)
_SEVERAL: dict[str, Space] = {
    **dict.fromkeys(("contract", "symmetry", "reference"), SEVERAL),
    "noise-sum": SEVERAL.restricted(m=_SEVERAL_NOISES),
    "energy": SEVERAL.without_faults(**_QUADRATIC),
    "reproducibility": Space((*SEVERAL.axes, strata.BATCH), partial(make.batched, make.several)),
    "identity": Space(SEVERAL.axes, partial(make.unmoved, make.several)),
    "casimir": SEVERAL.restricted(
        structures=("common Casimir",), d=("3", "4–6", "7–9"), degree_of_B=("1", "2–3", "4–6")
    ),
    "reduction": Space((strata.CASIMIRS, *_SYSTEM, *_STEPS), make.same_structures).restricted(
        m=_SOME_NOISE, Casimirs=("none",), d=("2", "3", "4–6", "7–9")
    ),
    "equivariance": SEVERAL.restricted(structures=("any",), degree_of_B=("0", "1", "2–3"), **_SUBSTITUTED),
}

HAMILTONIANS = Space((strata.CASIMIRS, *_SYSTEM, *_STEPS), make.hamiltonians).restricted(
    m=_SOME_NOISE, d=("2", "3", "4–6", "7–9"), **_SUBSTITUTED
)
_HAMILTONIANS: dict[str, Space] = {
    **dict.fromkeys(("contract", "symmetry"), HAMILTONIANS),
    "noise-sum": HAMILTONIANS.restricted(m=_SEVERAL_NOISES),
    "reproducibility": Space((*HAMILTONIANS.axes, strata.BATCH), partial(make.batched, make.hamiltonians)),
    "identity": Space(HAMILTONIANS.axes, partial(make.unmoved, make.hamiltonians)),
    "casimir": HAMILTONIANS.restricted(
        Casimirs=("linear", "quadratic", "two"), d=("3", "4–6", "7–9")
    ).without_faults(**_CONSTANT, Casimirs=("linear",)),
    "equivariance": HAMILTONIANS.restricted(degree_of_B=("0", "1", "2–3"), m=("1", "2")),
}

# By class of systems and law.
SPACES: dict[Systems, dict[str, Space]] = {
    Systems.SINGLE: _POOLED, Systems.NAMBU: _NAMBU, Systems.SEVERAL: _SEVERAL, Systems.HAMILTONIANS: _HAMILTONIANS
}  # fmt: skip
