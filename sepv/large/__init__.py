"""Large systems: one path with d to 10⁴ and more, B sparse, Newton's matrix banded or sparse, cost linear in d.

SciPy's sparse matrices are imported when a step is made, and not before.
"""

from sepv.large._check import check_large
from sepv.large._integrate import LargePath, integrate
from sepv.large._problem import LargeProblem
from sepv.large._problems import nonlinear_schroedinger, spin_chain, toda_chain, volterra_lattice
from sepv.large._schemes import energy_preserving, midpoint
