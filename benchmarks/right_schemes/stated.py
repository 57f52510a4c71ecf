"""Right schemes for problems that state functions: sums of momenta, spins in the mean,
and damped tops.
"""

from __future__ import annotations

from sepv.faults.saboteurs.stated import BODIES, SPINS, TOPS

SCHEMES = (BODIES, SPINS, TOPS)
