"""The pages about other libraries' solvers, made from the adapters of `sepv.peers`.

``python -m benchmarks.peers.compliance`` makes the table of verdicts (docs/compliance.md).
``python -m benchmarks.peers.solvers`` makes the table of orders by kind of noise (docs/solvers.md).
For this table `solver` holds a solver with its documented orders, and `solver_measurements`
measures it. `solvers_diffrax`, `solvers_sdeint` and `solvers_torchsde` list all solvers of a
library, and need this library.
"""
