"""The pages about other libraries' solvers, made from the adapters of `sepv.peers`.

``python -m benchmarks.peers.compliance`` makes the table of verdicts (docs/compliance.md).
``python -m benchmarks.peers.solvers`` makes the table of orders by kind of noise (docs/solvers.md).
Its solvers and their documented orders are in the libraries' records (`Peer.solvers`). `solver` has
the problems, and `solver_measurements` measures a solver on them.
"""
