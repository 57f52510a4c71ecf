"""Problems: a structure matrix B, a Hamiltonian H, noises c, and everything derived from them.

Read `_problem` first (the records and the classes of systems), then `_derived` (gradient, Hessian, B′ and averages,
from the record of B and H), `_checks` (consistency of the parts), `_averaged_gradient` and `_fields` (formulas of B
and H for batches). Wider classes than (1.1) are `_structures` (a structure for each noise) and `_hamiltonians` (a
Hamiltonian for each noise), narrower ones `_nambu` and `_mechanics`. `_poisson` has Jacobi's identity, `_json` what is
written.
"""

from __future__ import annotations

from sepv.problem import _poisson as poisson
from sepv.problem._averaged_gradient import Average, argument_rounding, average_gradient, average_hessian
from sepv.problem._checks import check_problem, sample_states
from sepv.problem._damped import DampedProblem, damping_of
from sepv.problem._derived import PartFlow
from sepv.problem._directions import Directions, directions
from sepv.problem._fields import (
    DENSE,
    Algebra,
    casimir_gradients,
    cramer,
    derivative_along,
    dot,
    field_jacobian,
    forward_differences,
    hessian,
    invariants,
    linear_solve,
    matmul,
    matvec,
    slope_along,
    structure_slope,
    turned_along,
    vector_field,
)
from sepv.problem._hamiltonians import (
    HamiltoniansProblem,
    bracket,
    column,
    combined_field,
    combined_gradient,
    combined_hessian,
    commutes,
    drift_bracket,
    hamiltonian_field,
    is_several,
    ito_drift,
    noise_field,
    noise_hessian,
    noise_vectors,
)
from sepv.problem._json import from_json, problem_from_json, problem_to_json, to_json
from sepv.problem._mechanics import Mechanics, mechanics
from sepv.problem._nambu import Nambu, cross
from sepv.problem._poisson import derivative_of_structure, is_poisson, jacobi_defect
from sepv.problem._problem import (
    Array,
    Description,
    Flow,
    Function,
    GivenProblem,
    Matrix,
    NamedProblem,
    PolynomialSystem,
    Problem,
    Structure,
    Systems,
    coefficients,
)
from sepv.problem._reversal import momentum_flip
from sepv.problem._structures import (
    ClosedForm,
    CommutingStructure,
    StructuresProblem,
    combined,
    combined_slope,
    commuting_hamiltonians,
    each_noise,
    noise_structures,
    undefined,
)
