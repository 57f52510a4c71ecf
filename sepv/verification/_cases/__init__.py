"""The cases of the laws: a problem as data, a state, a step (`case`).

In `of_law` a law describes its cases. `strata` divides properties of cases into ranges (strata), and lists cases that
cover all pairs of these; `classes` does so for each class of systems. `random_cases`, `families`, `random_parts` make
random cases inside strata. `fixed_cases` are the same for every seed. `users_problems` and `from_problem` make cases of
a user's problems. `shrink` simplifies a case that violates a law.
"""
