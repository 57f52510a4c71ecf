"""Solvers of other libraries: one file a library, with one record (`peer.Peer`).

`posing` turns a problem into arrays of a library. `diffrax`, `torchsde` and `sdeint` take single steps, for the
laws, and whole paths in the library's own loop, for `sepv compare`. The others are integrators of mechanical
systems (`_integrator`; start with `mici`). Each needs its library. Another package may offer a peer of its own
(`peer`). `benchmarks.peers` measures and records released versions.
"""
