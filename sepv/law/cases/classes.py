"""Records of the classes of systems for which schemes are made,
each with a space of test cases and named problems.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import partial
from random import Random

from sepv.law.cases import families, strata
from sepv.law.cases import random_cases as make
from sepv.law.cases.case import Case
from sepv.law.cases.commuting import commuting_step
from sepv.law.cases.fixed_cases import fixed_cases
from sepv.law.cases.random_cases import maker
from sepv.law.cases.strata import CaseAxis, Space, Strata
from sepv.problem import Problem, Systems

_SIZE_AXES = (strata.STATE, strata.DIMENSION, strata.DEGREE, strata.TERMS_OF_H)
_STEP_AXES = (strata.SIZE, strata.STEP, strata.SIGN, strata.SHARE, strata.GIVEN, strata.BATCH_SIZE)
# Strata (ranges) in which a wrong quadrature, or B taken at a wrong place, does not show: most laws
# need other cases.
_FAULTS_HIDDEN = {"degree of H": ("1–2",), "degree of B": ("0",), "degree of C": ("1", "2")}


@dataclass(frozen=True)
class SystemsClass:
    """A class of systems, and the sources of its test cases.

    Attributes
    ----------
    space : Space
        The space of random cases: a system of the class, a state and a step.
    named : names of problems
        Built-in problems of the class; the random search also draws steps from states near their
        initial states.
    more : Random -> Case or None
        Functions for the random search, which draw steps of systems that are in the class but not
        in the space.
    fixed : () -> cases
        Cases that are measured with every seed.
    problems : names of problems, or functions that make one
        Problems on which laws about many steps run a scheme that is only for this class.
    any_terms : bool
        True if a system of the class stays in it when H loses terms or its coefficients change.
    """

    space: Space
    named: tuple[str, ...] = ()
    more: tuple[Callable[[Random], Case | None], ...] = ()
    fixed: Callable[[], Iterable[Case]] = tuple
    problems: tuple[str | Callable[[], Problem], ...] = ()
    any_terms: bool = False


def _space(make: strata.Make, *axes: CaseAxis, **left: Strata) -> Space:
    """A space with the properties `axes` and those of all classes; `left` restricts ranges:
    degree_of_H=("1–2",).
    """
    wanted = {name.replace("_", " "): names for name, names in left.items()}
    kept = [
        replace(a, strata=tuple(s for s in a.strata if s.name in wanted.get(a.name, (s.name,))))
        for a in (*_SIZE_AXES, *axes, strata.NOISES, *_STEP_AXES)
    ]
    kinds = tuple(kind for kind in strata.STEP_KINDS if kind.name in wanted.get("kinds", (kind.name,)))
    whole = Space(tuple(strata.possible(kept, strata.COMBINATION_RULES)), make, kinds=kinds)
    return replace(whole, pool=whole.part(blind=_FAULTS_HIDDEN))


# Kinds of steps for several fields. Such systems have no Δ, so no noise cancels h. _OF_PATHS omits
# h = 0 with ΔW ≠ 0: no path has such a step, and schemes for several fields use areas or other
# increments, whose size h determines.
_OF_PATHS = tuple(
    kind.name for kind in (strata.UNEVEN_NOISES, strata.NEAR_REST, *strata.EXTREME_SIZES, *strata.ONE_SIGN)
)
_OF_STRUCTURES = (strata.NO_TIME.name, *_OF_PATHS)
_NOISE_NUMBERS = ("1", "2", "3–4", "5–20")
_MIDDLE_DIMENSIONS = ("2", "3", "4–6", "7–9")
_STRUCTURE_AXES = (strata.JACOBI_IDENTITY, strata.CASIMIRS, strata.STRUCTURE)
# Each H has fewer terms here, because a system of several fields has the terms of all fields.
_FEWER_TERMS = {"degree_of_H": ("1–2", "3–4", "5–6"), "terms_of_H": ("1–2", "3–9", "10–19")}
_BODY_STRATA = {"degree_of_H": ("1–2",), "terms_of_H": ("3–9",)}
_SMALL_STRATA = {**_FEWER_TERMS, "terms_of_H": ("1–2", "3–9")}

CLASSES: dict[Systems, SystemsClass] = {
    Systems.SINGLE: SystemsClass(
        _space(maker(make.single), *_STRUCTURE_AXES),
        named=("harmonic-oscillator", "rigid-body", "pendulum", "lotka-volterra"),
        fixed=fixed_cases,
    ),
    Systems.NAMBU: SystemsClass(
        _space(maker(make.nambu), strata.CASIMIR_DEGREE, strata.FACTOR, d=("3",)),
        named=("rigid-body", "lotka-volterra"),
    ),
    Systems.SEVERAL: SystemsClass(
        _space(maker(make.several), strata.CHANNEL_STRUCTURES, strata.STRUCTURE, kinds=_OF_STRUCTURES,
            m=_NOISE_NUMBERS, d=_MIDDLE_DIMENSIONS),
        more=(commuting_step,),
    ),
    Systems.HAMILTONIANS: SystemsClass(
        _space(maker(make.hamiltonians, shows=False), *_STRUCTURE_AXES, kinds=_OF_PATHS, m=_NOISE_NUMBERS,
            d=_MIDDLE_DIMENSIONS, **_FEWER_TERMS)
    ),
    Systems.CANONICAL_SEPARABLE: SystemsClass(
        _space(maker(families.canonical_separable, (2, 4, 6)), d=("2", "4–6"), **_SMALL_STRATA),
        problems=("harmonic-oscillator", "pendulum"), any_terms=True,
    ),
    Systems.MECHANICAL: SystemsClass(
        _space(maker(families.mechanical, (2, 4, 6)), strata.MASS, strata.POTENTIAL, d=("2", "4–6"), **_SMALL_STRATA),
        problems=("henon-heiles", "pendulum-chain"),
    ),
    Systems.LIE_POISSON: SystemsClass(
        _space(maker(families.lie_poisson, (3, 6)), strata.ALGEBRA, d=("3", "4–6"), **_SMALL_STRATA),
        problems=("rigid-body",), any_terms=True,
    ),
    Systems.RIGID_BODIES: SystemsClass(
        _space(maker(families.rigid_body), strata.INERTIA, d=("3",), **_BODY_STRATA),
        problems=("rigid-body", partial(families.small_body, (5.0, 1.0, -2.0, 1.0))),
    ),
    Systems.PRINCIPAL_BODIES: SystemsClass(
        _space(maker(families.rigid_body), d=("3",), **_BODY_STRATA),
        problems=("rigid-body", partial(families.small_body, (1.0, 0.0, 0.0, 0.0))),
    ),
    Systems.MATRIX_HAMILTONIANS: SystemsClass(
        _space(maker(families.matrix_hamiltonians, (3, 6, 8), shows=False), strata.MATRICES, kinds=_OF_PATHS,
               d=("3", "4–6", "7–9"), m=_NOISE_NUMBERS, **_SMALL_STRATA),
        problems=("random-inertia", "two-spins", "commuting-twists", "twisted-top"),
    ),
    Systems.SEPARABLE_HAMILTONIANS: SystemsClass(
        _space(maker(families.separable_hamiltonians, (2, 4), shows=False), kinds=_OF_PATHS, d=("2", "4–6"),
            m=_NOISE_NUMBERS,
               **_SMALL_STRATA),
        problems=("noisy-henon-heiles",),
    ),
    Systems.ADDITIVE: SystemsClass(
        _space(maker(families.additive, shows=False), *_STRUCTURE_AXES, kinds=_OF_PATHS, m=_NOISE_NUMBERS,
            d=_MIDDLE_DIMENSIONS, **_SMALL_STRATA),
        problems=("noisy-henon-heiles", "pushed-rigid-body"),
    ),
    Systems.DAMPED: SystemsClass(
        _space(families.damped, *_STRUCTURE_AXES, kinds=_OF_PATHS, d=_MIDDLE_DIMENSIONS, **_SMALL_STRATA),
        problems=("damped-top",)
    ),
    Systems.FRICTION: SystemsClass(
        _space(families.friction, strata.MASS, strata.POTENTIAL, kinds=(), d=("2", "4–6"), m=("1",), **_SMALL_STRATA),
        problems=("langevin-oscillator", "langevin-double-well", "langevin-pair"),
    ),
}  # fmt: skip
# Narrow classes, which users can name. For a scheme for such a class all cases come from the class.
NARROW_CLASSES = {systems: own for systems, own in CLASSES.items() if own.problems}
