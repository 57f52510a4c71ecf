"""Other libraries' schemes: adapters through their own stepping code, and what the suite says of them.

`posing` turns a problem into arrays of a library. `diffrax`, `torchsde` and `sdeint` are adapters that take one step
at a time, for the suite; `_compare_diffrax` and its neighbours run the same solvers over whole paths in the library's
own loop, for `sepv compare`; `_solvers_diffrax` and its neighbours list every solver for noise of each kind. Each needs
its library.

`compliance` makes the table of verdicts (docs/compliance.md), `solvers` the table of orders (docs/solvers.md). `_peer`
records what one release does, and `_trend` and `_trend_page` follow the records over releases (docs/trend.md).
"""
