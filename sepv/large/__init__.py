"""Paths of large systems, d = 10⁴ and more: B is sparse, Newton's matrix banded or sparse, and the cost linear in d.

SciPy's sparse matrices are imported when a step is made, and not before.
"""

from sepv.large._check import check_large as check_large
from sepv.large._integrate import LargePath as LargePath
from sepv.large._integrate import integrate as integrate
from sepv.large._problem import LargeProblem as LargeProblem
from sepv.large._problems import nonlinear_schroedinger as nonlinear_schroedinger
from sepv.large._problems import spin_chain as spin_chain
from sepv.large._problems import toda_chain as toda_chain
from sepv.large._problems import volterra_lattice as volterra_lattice
from sepv.large._schemes import energy_preserving as energy_preserving
from sepv.large._schemes import midpoint as midpoint
