"""Problems: a structure matrix B, a Hamiltonian H, noise coefficients c,
and everything derived from them.

Read `_data` (a problem as data) and `_problem` first. `_derived` derives gradient,
Hessian, B′ and averages from recorded operations of B and H, and `_checks` compares the parts. What
a step uses of a problem stands in `sepv.core`, also the record of its fields, `Channel`. `_facts`
and `_channels` compute all that is asked of a system from these, and `_systems` names classes of
systems by facts. Equation (1.1) is dy = B∇H(dt + Σ
c_j∘dW_j). `_structures` (a structure for each noise), `_hamiltonians` (a Hamiltonian or a vector
for each noise) and `_damped` make wider systems, `_nambu` and `_mechanics` narrower ones.
`_poisson` computes the defect of Jacobi's identity. `_json` reads and writes problems as JSON.
"""

from __future__ import annotations

from sepv.core.arrays import Array as Array
from sepv.core.arrays import cramer, forward_differences, linear_solve, matmul, matvec
from sepv.core.average import Average, argument_rounding
from sepv.core.average import average_gradient as average_gradient
from sepv.core.average import average_hessian as average_hessian
from sepv.core.problem import Channel as Channel
from sepv.core.problem import (
    Function,
    combined,
    combined_gradient,
    combined_hessian,
    combined_slope,
    each_noise,
    hessian,
)
from sepv.core.problem import field_jacobian as field_jacobian
from sepv.core.problem import vector_field as vector_field
from sepv.problem import _poisson as poisson
from sepv.problem._channels import bracket, combined_field, noise_field
from sepv.problem._channels import column as column
from sepv.problem._channels import commutes as commutes
from sepv.problem._channels import drift as drift
from sepv.problem._channels import hamiltonian_field as hamiltonian_field
from sepv.problem._channels import ito_drift as ito_drift
from sepv.problem._channels import slope as channel_slope
from sepv.problem._checks import check_problem as check_problem
from sepv.problem._checks import sample_states
from sepv.problem._damped import DampedProblem as DampedProblem
from sepv.problem._damped import conformal_rate, scaled_damping
from sepv.problem._data import Matrix, Structure
from sepv.problem._data import NamedProblem as NamedProblem
from sepv.problem._data import PolynomialSystem as PolynomialSystem
from sepv.problem._derived import PartFlow, derivatives
from sepv.problem._directional import derivative_along, structure_slope
from sepv.problem._directions import Directions, directions, projections
from sepv.problem._enclosures import over_box as over_box
from sepv.problem._enclosures import recorded as recorded
from sepv.problem._facts import (
    damped,
    damping_matrix,
    damping_of,
    energy_changes,
    hamiltonian_noises,
    hamiltonians_of,
    noise_vectors,
    one_field,
    one_hamiltonian,
    one_structure,
    same_structure,
    structures_of,
    structures_with_derivatives,
    undamped,
    uniform_damping,
    without_friction,
)
from sepv.problem._fields import casimir_gradients as casimir_gradients
from sepv.problem._fields import changes_of_invariants, invariants, known_invariants, slope_along
from sepv.problem._fields import energy_change as energy_change
from sepv.problem._friction import Langevin as Langevin
from sepv.problem._friction import friction as friction
from sepv.problem._friction import langevin as langevin
from sepv.problem._friction import temperature as temperature
from sepv.problem._hamiltonians import HamiltoniansProblem as HamiltoniansProblem
from sepv.problem._invariants import Relation, relation, require_invariants
from sepv.problem._json import from_json as from_json
from sepv.problem._json import problem_from_json, problem_to_json
from sepv.problem._json import to_json as to_json
from sepv.problem._mechanics import Mechanics as Mechanics
from sepv.problem._mechanics import mechanics as mechanics
from sepv.problem._nambu import Nambu as Nambu
from sepv.problem._nambu import cross
from sepv.problem._poisson import derivative_of_structure
from sepv.problem._poisson import jacobi_defect as jacobi_defect
from sepv.problem._problem import Description as Description
from sepv.problem._problem import Flow, coefficients, few
from sepv.problem._problem import GivenProblem as GivenProblem
from sepv.problem._problem import Problem as Problem
from sepv.problem._products import dot, turned_along
from sepv.problem._structures import ClosedForm, undefined
from sepv.problem._structures import CommutingStructure as CommutingStructure
from sepv.problem._structures import StructuresProblem as StructuresProblem
from sepv.problem._structures import commuting_hamiltonians as commuting_hamiltonians
from sepv.problem._systems import FACTS, Fact
from sepv.problem._systems import Systems as Systems
