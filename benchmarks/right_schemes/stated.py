"""Right schemes for problems that state functions: sums of momenta, spins in the mean,
and damped tops.
"""

from __future__ import annotations

from sepv.faults.saboteurs.stated import BODIES, CONFORMAL_TOP, SPINS

STATED_SCHEMES = (BODIES, SPINS, CONFORMAL_TOP)
