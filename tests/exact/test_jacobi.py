"""Jacobi's elliptic functions against mpmath's."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest

from sepv.exact._jacobi import argument, jacobi
from sepv.record._binary64 import EPS


@pytest.mark.parametrize("m", [0.0, 1e-300, 1e-9, 0.3, 0.99, 1 - 1e-4])
@pytest.mark.parametrize("size", [1.0, 50.0, 1000.0])
def test_functions_to_a_few_roundings(m: float, size: float) -> None:
    """A rounding of the argument each, and of dn a few of its own size."""
    u = np.random.default_rng(int(size)).uniform(-size, size, 12)
    found = jacobi(u, m)
    with mpmath.workdps(40):
        for name, values in zip(("sn", "cn", "dn"), found[:3], strict=True):
            exact = [mpmath.ellipfun(name, mpmath.mpf(float(x)), m=mpmath.mpf(m)) for x in u]
            off = max(float(abs(v - float(e))) for v, e in zip(values, exact, strict=True))
            assert off <= 4 * EPS * size, name
            if name == "dn":
                relative = max(float(abs(v / e - 1)) for v, e in zip(values, exact, strict=True))
                assert relative <= 8 * EPS * size


@pytest.mark.parametrize("m", [0.0, 0.3, 1 - 1e-4])
@pytest.mark.parametrize("amplitude", [-3.1, -1.0, 0.0, 0.5, 3.1])
def test_the_amplitude_of_its_argument_is_the_amplitude(m: float, amplitude: float) -> None:
    u = argument(amplitude, m)
    # Near a quarter period dn is √(1 − m): what is a rounding of u is that of the amplitude and more.
    assert jacobi(np.array([u]), m)[3][0] == pytest.approx(amplitude, abs=8 * EPS * max(1.0, abs(u)))
