"""Property-based verification and benchmarks for energy-preserving integrators of stochastic
Poisson systems.

verify(scheme)                     measure every law on a scheme; problems=[…] names its problems
integrate, ensemble, long_path     one path, the end states of many, one path of any length
exact_flow(problem, theta)         compute the exact solution at random times
Scheme, StatefulStep, Problem, …   the records that a user makes
schemes, problems, strategies      built-in schemes and problems, random systems for Hypothesis
simulate, exact, external, …       the subpackages, each with its own public names
Effort, Report, Verdict, Ensemble, Trajectory, and the errors; a user's step may raise `Skipped`

>>> import sepv
>>> report = sepv.verify("midpoint", laws="identity,energy", problems="pendulum")
>>> report.finding("energy").verdict
<Verdict.VIOLATED: 'violated'>

Names are loaded when they are first used: ``import sepv`` itself imports nothing heavy.
"""

from __future__ import annotations

import os as _os

from sepv._lazy import finders as _finders
from sepv._lazy import lazily
from sepv._version import __version__ as __version__

# Importing `typing` or `pathlib` takes ten times as long as the rest of this file, so TYPE_CHECKING
# is set here.
TYPE_CHECKING = False
if TYPE_CHECKING:
    from sepv import core as core
    from sepv import exact as exact
    from sepv import external as external
    from sepv import posing as posing
    from sepv import problem as problem
    from sepv import problems as problems
    from sepv import record as record
    from sepv import schemes as schemes
    from sepv import simulate as simulate
    from sepv import strategies as strategies
    from sepv import studies as studies
    from sepv import verification as verification
    from sepv.errors import ChunkFailure as ChunkFailure
    from sepv.errors import ClusterFailure as ClusterFailure
    from sepv.errors import Interrupted as Interrupted
    from sepv.errors import ProblemError as ProblemError
    from sepv.errors import SchemeFault as SchemeFault
    from sepv.errors import SepvError as SepvError
    from sepv.errors import Skipped as Skipped
    from sepv.errors import StepFailure as StepFailure
    from sepv.errors import TargetError as TargetError
    from sepv.errors import UsageError as UsageError
    from sepv.exact import exact_flow as exact_flow
    from sepv.problem import PolynomialSystem as PolynomialSystem
    from sepv.problem import Problem as Problem
    from sepv.schemes import PathSolver as PathSolver
    from sepv.schemes import PointLaw as PointLaw
    from sepv.schemes import Scheme as Scheme
    from sepv.schemes import StatefulStep as StatefulStep
    from sepv.simulate import Ensemble as Ensemble
    from sepv.simulate import Trajectory as Trajectory
    from sepv.simulate import ensemble as ensemble
    from sepv.simulate import integrate as integrate
    from sepv.simulate import long_path as long_path
    from sepv.verification import Effort as Effort
    from sepv.verification import Report as Report
    from sepv.verification import Verdict as Verdict
    from sepv.verification import verify as verify

# `sepv.properties` and `sepv.reference` are folders beside this one, which an installation maps
# into the package. If the checkout itself is on the path, Python finds ./sepv before the
# installation, so they are added here.
_HERE = _os.path.dirname(_os.path.realpath(__file__))
_CHECKOUT = _os.path.dirname(_HERE)
if not _os.path.isdir(f"{_HERE}/reference") and _os.path.isdir(f"{_CHECKOUT}/reference/witnesses"):
    __path__.append(_CHECKOUT)

# Solvers of other libraries stand above the schemes and the comparison, which ask for them by name.
_finders.update(scheme="sepv.peers.peer:scheme", method="sepv.peers.peer:method")

__getattr__, __dir__ = lazily(
    __name__,
    {
        "errors": "SepvError UsageError ProblemError TargetError SchemeFault StepFailure ChunkFailure Skipped "
        "ClusterFailure Interrupted",
        "exact": "*exact exact_flow",
        "problem": "*problem Problem PolynomialSystem",
        "schemes": "*schemes PathSolver PointLaw Scheme StatefulStep",
        "simulate": "*simulate Ensemble ensemble long_path Trajectory integrate",
        "verification": "*verification Effort Verdict Report verify",
        **{
            room: f"*{room}"
            for room in ("core", "external", "posing", "problems", "record", "strategies", "studies")
        },
    },
)
