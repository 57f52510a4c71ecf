"""Rules for expectations over Wiener increments: exact where they say so, positive, and clipped where the scheme is."""

import numpy as np
import pytest
from sepv.properties._orders.gaussian import rule
from sepv.reference.increments import bound, lost_variance, moment, truncated_moment

STEPS = (2.0**-2, 2.0**-6, 2.0**-13, 2.0**-40)


@pytest.mark.parametrize("h", STEPS)
@pytest.mark.parametrize(("k", "degree"), [(1, 4), (2, 4), (4, 6), (12, 14), (None, 6)])
def test_moments_of_one_increment_are_those_of_the_closed_forms(h: float, k: int | None, degree: int) -> None:
    """Gauss rules on panels are exact for even powers up to the degree; a few roundings are left."""
    nodes = rule(1, h, k, degree)
    assert np.all(nodes.weights > 0)
    (xi,), (zeta,) = nodes.xi, nodes.zeta[:, nodes.index]
    for p in range(0, degree + 1, 2):
        assert nodes.weights @ xi**p == pytest.approx(float(moment(p)), rel=1e-13)
        assert abs(nodes.weights @ xi ** (p + 1)) <= 1e-13 * float(moment(p + 2))
        if k is not None:
            assert nodes.weights @ zeta**p == pytest.approx(float(truncated_moment(h, k, p)), rel=1e-13)


@pytest.mark.parametrize("h", STEPS)
def test_what_clipping_loses_is_seen_to_all_digits(h: float) -> None:
    """E[ξ² − ζ²] as small as h^12 is a sum over the tails alone: no cancellation."""
    for k in (1, 2, 12):
        nodes = rule(1, h, k, 4)
        lost = nodes.weights @ (nodes.xi[0] ** 2 - nodes.zeta[0, nodes.index] ** 2)
        assert lost == pytest.approx(float(lost_variance(h, k)), rel=1e-10)
        assert np.max(np.abs(nodes.zeta)) == pytest.approx(float(bound(h, k)), rel=1e-15)


@pytest.mark.parametrize("noises", [0, 1, 2, 3, 4, 5, 6, 9])
def test_several_increments_are_independent_standard_normals(noises: int) -> None:
    nodes = rule(noises, 2.0**-10, 2, 4)
    assert nodes.xi.shape == (noises, nodes.weights.size)
    assert np.all(nodes.weights > 0)
    assert nodes.weights.sum() == pytest.approx(1, abs=1e-14)
    assert (nodes.weights * nodes.xi) @ nodes.xi.T == pytest.approx(np.eye(noises), abs=1e-13)
    assert nodes.xi @ nodes.weights == pytest.approx(np.zeros(noises), abs=1e-13)
    A = float(bound(2.0**-10, 2))
    assert np.array_equal(nodes.zeta[:, nodes.index], np.clip(nodes.xi, -A, A))


def test_the_scheme_is_asked_once_for_increments_that_it_sees_as_equal() -> None:
    nodes = rule(2, 2.0**-10, 2, 4)
    assert len(set(map(tuple, nodes.zeta.T))) == nodes.zeta.shape[1] < nodes.xi.shape[1]
