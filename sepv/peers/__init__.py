"""Solvers of other libraries, which are compared with sepv's schemes:
each library has one file and one `peer.Peer`.

`diffrax`, `torchsde` and `sdeint` take single steps, for the laws, and whole paths in the library's
own loop, for `sepv compare`. The other files are integrators of mechanical systems (`_integrator`;
start with `mici`). A file can be imported if its library is installed. Another package may add a
library (`peer`). `benchmarks.peers` measures and records released versions.
"""

from __future__ import annotations

from sepv.peers.peer import Peer as Peer
