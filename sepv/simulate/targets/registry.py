"""All targets by name, and those that engine="auto" tries."""

from __future__ import annotations

from sepv.simulate.targets._numba import NUMBA
from sepv.simulate.targets._numpy import NUMPY
from sepv.simulate.targets._target import Target
from sepv.simulate.targets.cuda import CUDA, ON_HOST

TARGETS: dict[str, Target] = {target.name: target for target in (NUMPY, NUMBA, CUDA, ON_HOST)}
# The targets that engine="auto" tries, in this order.
AUTOMATIC = (NUMBA.name, NUMPY.name)
