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
    from sepv.properties._growth import GROWTH_LEVEL as GROWTH_LEVEL
    from sepv.properties._growth import exponent as growth_exponent
    from sepv.properties._growth import kind_of as growth_kind
    from sepv.properties._growth import rounding_walk as energy_rounding_walk
    from sepv.properties._orders.convergence import StrongErrors, quantile_slope, strong_errors
    from sepv.properties._orders.convergence import first as first_paths
    from sepv.properties._orders.convergence import join as joined_errors
    from sepv.properties._orders.convergence import slope as mean_square_slope
    from sepv.properties._orders.gaussian import rule as gaussian_rule
    from sepv.properties._orders.gaussian import rule_for as gaussian_rule_for
    from sepv.properties._orders.integrable import users_orbits
    from sepv.properties._orders.local_errors import five_noises, local_errors, local_states, one_step
    from sepv.properties._orders.local_errors import rule_degree as gaussian_rule_degree
    from sepv.properties._orders.long_times import EnergyPath, Stopped, allowed_rounding, trend
    from sepv.properties._orders.means import decay, leading, limit_errors, moment_errors
    from sepv.properties._orders.several_fields import refined
    from sepv.properties._orders.tilting import tilted_errors
    from sepv.properties._sequential import FALSE_ALARM, FIRST_LOOK, Assess, is_tilted
    from sepv.properties._setups import Setup, setups, setups_for
    from sepv.properties._stated_functions import drift_of_energy

__getattr__, __dir__ = lazily(
    __name__,
    {
        "_by_name": "listed load_laws renamed",
        "_growth": "GROWTH_LEVEL energy_rounding_walk=rounding_walk growth_exponent=exponent "
        "growth_kind=kind_of",
        "_orders.convergence": "StrongErrors first_paths=first joined_errors=join mean_square_slope=slope "
        "quantile_slope strong_errors",
        "_orders.gaussian": "gaussian_rule=rule gaussian_rule_for=rule_for",
        "_orders.integrable": "users_orbits",
        "_orders.local_errors": "five_noises gaussian_rule_degree=rule_degree local_errors local_states one_step",
        "_orders.long_times": "EnergyPath Stopped allowed_rounding trend",
        "_orders.means": "decay leading limit_errors moment_errors",
        "_orders.several_fields": "refined",
        "_orders.tilting": "tilted_errors",
        "_sequential": "FALSE_ALARM FIRST_LOOK Assess is_tilted",
        "_setups": "Setup setups setups_for",
        "_stated_functions": "drift_of_energy",
    },
)
