"""The test cases of the laws. A case is a problem as data, a state and a step (`case`).

`of_law` describes the cases of a law. `strata` divides properties of cases into ranges (strata),
and lists cases that cover all pairs of strata; `classes` has the strata of each class of systems.
`random_cases`, `families` and `random_parts` make random cases inside strata. `fixed_cases` are the
same for every seed. `users_problems` and `from_problem` make cases of a user's problems. `shrink`
simplifies a case that violates a law.
"""
