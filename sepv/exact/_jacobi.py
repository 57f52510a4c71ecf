"""Jacobi's elliptic functions at arrays of arguments.

`scipy.special.ellipj` is not used, because its dn has five more roundings if m is near 1, it takes
1.5 times as long, and importing it takes a third of a second, a twentieth of the time of all laws.
"""

from __future__ import annotations

import math
from functools import lru_cache

import mpmath
import numpy as np

from sepv.problem import Array
from sepv.record import EPS


def jacobi(u: Array, m: float) -> tuple[Array, Array, Array, Array]:
    """Jacobi's sn, cn and dn and the amplitude at arguments u (M,) for the parameter m = k²,
    0 ≤ m < 1.

    The arithmetic-geometric mean (DLMF 22.20(ii)) has means a_n, b_n and c_n = (a_{n−1}
    − b_{n−1})/2, up to the first N with c_N ≤ eps a_N. The recursion 2φ_{n−1} = φ_n
    + arcsin((c_n/a_n) sin φ_n) from φ_N = 2^N a_N u gives the amplitude φ_0.
    """
    a, b, shares = 1.0, math.sqrt(1 - m), list[float]()
    c = math.sqrt(m)
    while c > EPS * a:
        a, b, c = (a + b) / 2, math.sqrt(a * b), (a - b) / 2
        shares.append(c / a)
    phi = 2.0 ** len(shares) * a * u
    for share in reversed(shares):
        phi = 0.5 * (phi + np.arcsin(share * np.sin(phi)))
    sn, cn = np.sin(phi), np.cos(phi)
    # This is dn² = 1 − m sn², written without cancellation.
    return sn, cn, np.sqrt(cn * cn + (1 - m) * (sn * sn)), phi


# It takes most of the time of a flow, and many flows start at one state.
@lru_cache(maxsize=1024)
def argument(amplitude: float, m: float) -> float:
    """The argument u at which `jacobi` has a given amplitude:
    Legendre's incomplete integral of the first kind.
    """
    return float(mpmath.ellipf(float(amplitude), float(m)))
