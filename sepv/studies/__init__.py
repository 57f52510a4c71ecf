"""Studies of schemes: error against cost, times of two versions, hard cases, long times.

The studies do not depend on each other. Each has a command and is loaded on demand: `_compare`
(error against cost), `_bench` (counts of evaluations, times of two versions in pairs),
`_hard_cases`, `_energy_growth`, `_solvability`. `_evaluation_count` counts the evaluations of a
scheme. The paper's own experiments are in `sepv.paper`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from sepv._lazy import lazily

if TYPE_CHECKING:
    from sepv.studies import _energy_growth as energy_growth
    from sepv.studies import _energy_without_noise as energy_without_noise
    from sepv.studies import _trajectory as trajectory
    from sepv.studies._bench import cases as bench_cases
    from sepv.studies._bench import pairs as bench_pairs
    from sepv.studies._bench import store as bench_store
    from sepv.studies._bench.gate import check as check_bench
    from sepv.studies._compare import table as comparison_table
    from sepv.studies._compare.comparison import Comparison as Comparison
    from sepv.studies._compare.method import Method as Method
    from sepv.studies._compare.method import from_scheme as from_scheme
    from sepv.studies._compare.method import from_states, load_method
    from sepv.studies._compare.run import compare as compare
    from sepv.studies._compare.run import one_core
    from sepv.studies._energy_growth import SLOPE_DOUBLINGS, Growth, growth
    from sepv.studies._hard_cases import Seen, long_steps
    from sepv.studies._hard_cases import run as run_hard_cases
    from sepv.studies._solvability.branch import End
    from sepv.studies._solvability.map import Map
    from sepv.studies._solvability.map import solvability_map as solvability_map
    from sepv.studies._solvability.paths import Exits, follow_paths
    from sepv.studies._solvability.picture import draw as draw_solvability

__getattr__, __dir__ = lazily(
    __name__,
    {
        "_bench.cases": "*bench_cases",
        "_bench.gate": "check_bench=check",
        "_bench.pairs": "*bench_pairs",
        "_bench.store": "*bench_store",
        "_compare.method": "Method from_scheme from_states load_method",
        "_compare.comparison": "Comparison",
        "_compare.run": "compare one_core",
        "_compare.table": "*comparison_table",
        "_energy_growth": "*energy_growth SLOPE_DOUBLINGS Growth growth",
        "_energy_without_noise": "*energy_without_noise",
        "_hard_cases": "Seen long_steps run_hard_cases=run",
        "_solvability.branch": "End",
        "_solvability.map": "Map solvability_map",
        "_solvability.paths": "Exits follow_paths",
        "_solvability.picture": "draw_solvability=draw",
        "_trajectory": "*trajectory",
    },
)
