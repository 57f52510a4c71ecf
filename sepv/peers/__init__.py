"""Other libraries' schemes: adapters through their own stepping code, and what the suite says of them.

`diffrax`, `torchsde` and `sdeint` have schemes for the suite, `driven_…` the same solvers in their own loops for
`sepv compare`; each needs its library. `posing` puts a problem in a library's words. `compliance` makes the
table of verdicts; `_peer` and `_trend` follow them over versions.
"""
