"""The cases that laws ask about: a problem as data, a state, a step (`case`).

`strata` has the space of cases and its designs, `spaces` the part of it that each law speaks of, `random_cases` and
`random_parts` fill a row with random numbers. `fixed_cases` come with every seed. `structures`, `hamiltonians`,
`poisson` and `families` have systems beyond (1.1) or inside it; `users_problems`, `from_problem` and `case_of_law` a
user's own. `shrink` simplifies a case that violates.
"""
