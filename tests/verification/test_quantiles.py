"""Quantiles of the statistical laws against SciPy's, and that a run of the laws does without SciPy's import."""

import pytest
from doors import python
from scipy.special import bdtr, fdtri, stdtrit

from sepv.statistics import binomial, fishers_f, students_t


@pytest.mark.parametrize("df", [1, 2, 7, 31, 59, 511, 16383, 10**6])
@pytest.mark.parametrize("tail", [0.3, 1e-2, 5e-8, 1e-14])
def test_students_t(df: int, tail: float) -> None:
    assert students_t(tail, df) == pytest.approx(-stdtrit(df, tail), rel=1e-11)


@pytest.mark.parametrize("n", [2, 31, 60, 500])
@pytest.mark.parametrize("tail", [0.2, 1e-3, 1e-7])
def test_fishers_f(n: int, tail: float) -> None:
    assert fishers_f(tail, n) == pytest.approx(fdtri(n, n, tail), rel=1e-11)


@pytest.mark.parametrize("n", [64, 512, 2048, 16384])
@pytest.mark.parametrize("level", [1e-7, 4.17e-7, 0.3, 0.9999995])
def test_binomial(n: int, level: float) -> None:
    k = binomial(level, n, 0.8)
    assert bdtr(k - 1, n, 0.8) < level <= bdtr(k, n, 0.8)


def test_no_chance_is_level_enough_without_a_count() -> None:
    """P(0 of 8) is more than the level: none below is as unlikely."""
    assert binomial(1e-7, 8, 0.8) == 0
    assert binomial(1e-5, 8, 0.8) == 1


def test_the_laws_about_samples_do_without_scipy() -> None:
    code = (
        "import sys; from sepv import verify; "
        "report = verify('energy-preserving', laws='rounding,mean-square-order,weak-order,right-limit'); "
        "assert report.exit_code == 0; print('scipy' in sys.modules)"
    )
    assert python(code) == "False"
