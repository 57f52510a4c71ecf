"""Which tests are asked to kill the mutants of which module: quick ones, and those that are about it."""

from __future__ import annotations

IMPLICIT = ("tests/test_implicit.py", "tests/test_jacobians.py", "tests/test_newton.py")
CATALOGUE = "tests/test_hard.py::test_the_energy_preserving_scheme_solves_to_its_bound_or_refuses"
OTHERS = "tests/test_hard.py::test_the_other_implicit_schemes_leave_nothing_unmarked"
COUNTERS = "tests/test_bench.py::test_the_committed_counters_are_those_of_today"
SCHEME = ("tests/test_schemes.py", *IMPLICIT, COUNTERS)

TARGETS: dict[str, tuple[str, ...]] = {
    "sepv.polynomial": ("tests/test_polynomial.py", "tests/test_problems.py", "tests/test_nambu.py"),
    "sepv.average": (
        "tests/test_average.py",
        "tests/test_schemes.py",
        *IMPLICIT,
        CATALOGUE,
        COUNTERS,
        "tests/test_collocation.py",
    ),
    "sepv.fields": ("tests/test_schemes.py", *IMPLICIT, CATALOGUE, OTHERS, "tests/test_collocation.py"),
    "sepv.implicit": (
        "tests/test_schemes.py",
        *IMPLICIT,
        CATALOGUE,
        OTHERS,
        COUNTERS,
        "tests/test_division.py",
    ),
    "sepv.division": ("tests/test_division.py",),
    "sepv.wiener": ("tests/test_wiener.py", "tests/test_simulation.py"),
    "sepv.tableaux": ("tests/test_collocation.py",),
    "sepv.nambu": ("tests/test_nambu.py",),
    "sepv.structures": ("tests/test_structures.py",),
    "sepv.scheme": (*IMPLICIT, "tests/test_schemes.py", "tests/test_collocation.py"),
    "sepv.schemes.energy_preserving": SCHEME,
    "sepv.schemes.midpoint": SCHEME,
    "sepv.schemes.discrete_gradient": SCHEME,
    "sepv.schemes.euler_heun": SCHEME,
    "sepv.schemes.milstein": SCHEME,
    "sepv.schemes.euler_maruyama": SCHEME,
    "sepv.schemes.collocation": ("tests/test_collocation.py", OTHERS, "tests/test_jacobians.py"),
    "sepv.schemes.gauss": ("tests/test_rivals.py", "tests/test_collocation.py"),
    "sepv.schemes.explicit": ("tests/test_rivals.py", COUNTERS),
    "sepv.schemes.both_invariants": ("tests/test_nambu.py",),
    "sepv.schemes.several_structures": ("tests/test_structures.py", "tests/test_jacobians.py"),
}
