"""The laws, which are properties of one-step schemes. Each file has one theorem: a `law`,
and a test for pytest.

Files whose names begin with an underscore contain measurements that several laws use. `_orders`
measures orders of convergence: of one step by quadrature, and over sampled paths. `_exact_step`
solves a step in extended precision. `_sequential` samples paths of `_setups` until the verdict is
clear. `_without_solution` proves that a step has no solution. `_growth`, `_decay`,
`_trace_formula`, `_poisson_map`, `_reversal`, `_way_back` and `_states_of_a_path` have one theorem
each, which two or three laws use. `_structures` tests conditions on B. `_without_memory` has the
checks of the law *contract* that need several calls of a step.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from sepv._lazy import lazily

if TYPE_CHECKING:
    from sepv.properties._by_name import listed, load_laws, renamed
    from sepv.properties._growth import LEVEL as GROWTH_LEVEL
    from sepv.properties._growth import exponent as growth_exponent
    from sepv.properties._growth import kind_of as growth_kind
    from sepv.properties._growth import rounding_walk as energy_rounding_walk
    from sepv.properties._orders.convergence import StrongErrors
    from sepv.properties._orders.convergence import slope as mean_square_slope
    from sepv.properties._orders.gaussian import rule as gaussian_rule
    from sepv.properties._orders.gaussian import rule_for as gaussian_rule_for
    from sepv.properties._orders.integrable import users_orbits
    from sepv.properties._orders.local_errors import local_errors
    from sepv.properties._orders.long_times import EnergyPath, Stopped, allowed_rounding, trend

__getattr__, __dir__ = lazily(
    __name__,
    {
        "_by_name": "listed load_laws renamed",
        "_growth": "GROWTH_LEVEL=LEVEL energy_rounding_walk=rounding_walk growth_exponent=exponent "
        "growth_kind=kind_of",
        "_orders.convergence": "StrongErrors mean_square_slope=slope",
        "_orders.gaussian": "gaussian_rule=rule gaussian_rule_for=rule_for",
        "_orders.integrable": "users_orbits",
        "_orders.local_errors": "local_errors",
        "_orders.long_times": "EnergyPath Stopped allowed_rounding trend",
    },
)
