"""The cases of the laws: a problem as data, a state, a step (`case`).

`of_law` has the record in which a law describes its cases. `strata` has spaces of cases and their designs, `classes`
the space of each class of systems; `random_cases`, `families` and `random_parts` make random cases inside strata.
`fixed_cases` are measured with every seed. `users_problems` and `from_problem` make cases of a user's problems.
`shrink` simplifies a case that violates.
"""
