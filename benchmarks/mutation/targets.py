"""Which tests are asked to kill the mutants of which module: quick ones, and those that are about it."""

from __future__ import annotations

IMPLICIT = (
    "tests/test_implicit.py",
    "tests/test_jacobians.py",
    "tests/test_newton.py",
    "tests/test_newton_alone.py",
)
CATALOGUE = "tests/test_hard.py::test_the_energy_preserving_scheme_solves_to_its_bound_or_refuses"
OTHERS = "tests/test_hard.py::test_the_other_implicit_schemes_leave_nothing_unmarked"
COUNTERS = "tests/test_bench.py::test_the_committed_counters_are_those_of_today"
# Without those that take seconds.
COLLOCATION = tuple(
    f"tests/test_collocation.py::test_{name}"
    for name in (
        "coefficients_are_right_to_two_roundings",
        "averages_are_exact_up_to_the_degree_that_is_promised_and_not_beyond",
        "a_linear_h_needs_no_more_nodes_than_half_the_stages",
        "what_averages_may_amplify_is_the_integral_of_a_lagrange_polynomial",
        "one_stage_is_the_energy_preserving_scheme_to_an_ulp",
        "newton_needs_no_derivatives_of_the_problem",
        "energies_that_are_no_polynomials_are_kept_at_large_steps[2]",
        "energies_that_are_no_polynomials_are_kept_at_large_steps[5]",
        "errors_fall_with_order_s[2]",
        "what_no_quadrature_resolves_is_reported_and_not_returned",
        "steps_of_a_batch_are_the_steps_of_its_states",
        "members_of_families_have_names",
        "a_hard_step_is_refused_and_nothing_is_warned_about",
        "a_family_member_says_what_it_is_and_counts_its_work",
    )
)
# Without those that take seconds.
STRUCTURES = tuple(
    f"tests/test_structures.py::test_{name}"
    for name in (
        "commuting_hamiltonians_are_structures",
        "casimirs_of_b_are_casimirs_of_every_structure",
        "hamiltonians_that_do_not_commute_are_refused_with_their_bracket",
        "schemes_for_one_structure_refuse_several",
        "one_structure_is_the_energy_preserving_scheme_to_the_bit",
        "ensembles_take_several_structures",
        "wrong_structures_are_refused",
        "a_step_sees_the_sum_of_its_structures",
        "a_single_structure_is_that_of_the_noise_too",
        "without_one_of_the_derivatives_there_is_no_slope",
        "every_casimir_of_either_kind_is_one_of_a_commuting_structure",
        "structures_of_eight_components_have_the_bits_of_their_states",
        "where_the_drift_rests_the_structure_vanishes",
        "roundings_of_a_commuting_structure_are_relative_to_its_terms",
        "a_problem_with_several_hamiltonians_is_put_together_from_its_parts",
        "brackets_are_judged_beside_their_terms",
        "brackets_are_asked_for_around_the_initial_state_and_inside_the_domain_only",
    )
)
SCHEME = ("tests/test_schemes.py", *IMPLICIT, COUNTERS)

TARGETS: dict[str, tuple[str, ...]] = {
    "sepv.record._polynomial": ("tests/test_polynomial.py", "tests/test_problems.py", "tests/test_nambu.py"),
    "sepv.problem._averaged_gradient": (
        "tests/test_averaged_gradient.py",
        "tests/test_schemes.py",
        *IMPLICIT,
        CATALOGUE,
        COUNTERS,
        *COLLOCATION,
    ),
    "sepv.problem._fields": (
        "tests/test_schemes.py",
        *IMPLICIT,
        CATALOGUE,
        OTHERS,
        *COLLOCATION,
        *STRUCTURES,
        "tests/test_projected.py",
    ),
    "sepv.solve._newton": (
        *IMPLICIT,
        CATALOGUE,
        "tests/test_schemes.py",
        COUNTERS,
        f"{OTHERS}[midpoint]",
        f"{OTHERS}[discrete-gradient]",
        "tests/test_division.py",
    ),
    "sepv.solve._damped": (*IMPLICIT, CATALOGUE, "tests/test_schemes.py"),
    "sepv.solve._differences": (*IMPLICIT, "tests/test_schemes.py"),
    "sepv.schemes._division": ("tests/test_division.py",),
    "sepv.simulate._wiener": ("tests/test_wiener.py", "tests/test_simulation.py"),
    "sepv.schemes._tableaux": COLLOCATION,
    "sepv.problem._nambu": ("tests/test_nambu.py",),
    "sepv.problem._structures": STRUCTURES,
    "sepv.schemes._scheme": ("tests/test_scheme.py", *IMPLICIT, "tests/test_schemes.py", *COLLOCATION),
    "sepv.schemes._energy_preserving": SCHEME,
    "sepv.schemes._midpoint": SCHEME,
    "sepv.schemes._discrete_gradient": SCHEME,
    "sepv.schemes._euler_heun": SCHEME,
    "sepv.schemes._milstein": SCHEME,
    "sepv.schemes._euler_maruyama": SCHEME,
    "sepv.schemes._collocation": (
        "tests/test_stages.py",
        *COLLOCATION,
        "tests/test_jacobians.py",
        "tests/test_rivals.py::test_one_gauss_stage_is_the_midpoint_rule",
    ),
    "sepv.schemes._gauss": ("tests/test_rivals.py", "tests/test_scheme.py", *COLLOCATION),
    "sepv.schemes._explicit": ("tests/test_rivals.py", "tests/test_scheme.py"),
    "sepv.schemes._projected": ("tests/test_projected.py", "tests/test_scheme.py"),
    "sepv.schemes._both_invariants": ("tests/test_nambu.py",),
    "sepv.schemes._several_structures": (*STRUCTURES, "tests/test_jacobians.py"),
    "sepv.exact._dense_flow": ("tests/test_dense_flow.py", "tests/test_exact.py"),
    "sepv.exact._closed_forms": ("tests/test_exact.py",),
    "sepv.exact._flow": ("tests/test_exact.py",),
    "sepv.simulate._paths": ("tests/test_simulation.py", "tests/test_division.py"),
    "sepv.simulate._run_arguments": ("tests/test_simulation.py",),
    "sepv.simulate._batch": (
        "tests/test_simulation.py",
        "tests/test_division.py",
        "tests/test_continuation.py::test_ensembles_and_paths_count_what_was_continued",
    ),
    "sepv.verification._tolerance": ("tests/test_tolerance.py",),
}
