"""Other libraries' schemes: adapters through their own stepping code, and what their versions were found to do.

`posing` turns a problem into arrays of a library. `diffrax`, `torchsde` and `sdeint` are adapters that take one step
at a time, for the suite; `_compare_diffrax` and its neighbours run the same solvers over whole paths in the library's
own loop, for `sepv compare`. Each needs its library.

`_peer` records what one release does, and `_trend` and `_trend_page` follow the records over releases (docs/trend.md).
The tables of all verdicts and orders (docs/compliance.md, docs/solvers.md) are made by `benchmarks.peers`.
"""
