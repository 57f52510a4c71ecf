"""The pages about other libraries' solvers, made from the adapters of `sepv.reference.peers`.

``python -m benchmarks.peers.compliance`` makes the table of verdicts (docs/compliance.md). ``python -m
benchmarks.peers.solvers`` makes the table of orders by kind of noise (docs/solvers.md): `solver` is the record of a
solver and its documentation, `solver_measurements` what is measured of it, `solvers_diffrax` and its neighbours list
every solver of a library, which they need.
"""
