"""Where the implicit equation of a step has a solution connected to y0, and where Newton finds it."""

from __future__ import annotations

from sepv.studies._solvability.branch import Branch as Branch
from sepv.studies._solvability.branch import End as End
from sepv.studies._solvability.branch import follow as follow
from sepv.studies._solvability.chance import chance_outside as chance_outside
from sepv.studies._solvability.map import Ending as Ending
from sepv.studies._solvability.map import Map as Map
from sepv.studies._solvability.map import solvability_map as solvability_map
from sepv.studies._solvability.paths import Exits as Exits
from sepv.studies._solvability.paths import follow_paths as follow_paths
