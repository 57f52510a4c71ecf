"""A spin with damping and a random field: the Landau-Lifshitz equation at a temperature,
in Stratonovich's form.

With the energy E(y) = −½K y₃² − b·y, damping α and a random field √(2αkT) dW along each axis,

    dy = y × (∇E + α y × ∇E) dt + √(2αkT) Σ_j y × e_j ∘dW_j.                                     (L)

Each field is y × ω = −hat(ω) ∇(½|y|²). So (L) is a system with a structure −hat(ω_k) for each k and
the one H = ½|y|², which is kept on each path. For |y| = 1 the term of α is −α∇E along the sphere,
because y × (y × v) = −v for v ⊥ y. The density e^{−E/kT} on the sphere is stationary: its flow of
probability −α p∇E − αkT ∇p is zero (J. L. García-Palacios and F. J. Lázaro, Phys. Rev. B 58, 1998,
with a random field that enters the precession alone).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from sepv._arguments import is_number
from sepv.errors import ProblemError
from sepv.problem import PolynomialSystem, Problem, Structure
from sepv.problems._common import HAT
from sepv.problems._polynomial_system import started
from sepv.record import Polynomial, poly


def damped_spin(
    damping: float = 0.5,
    temperature: float = 0.25,
    field: Sequence[float] = (0.0, 0.25, 0.5),
    anisotropy: float = 1.0,
) -> Problem:
    """A spin with damping α and field noise at kT; E = −½K y₃² − b·y, from the state (0.6, 0, 0.8);
    H is ½|y|².

    Raises
    ------
    ProblemError
        Unless α and kT are numbers from 0 up, and b has three numbers.
    """
    given = (damping, temperature, anisotropy, *field)
    if len(given) != 6 or not all(map(is_number, given)) or min(damping, temperature) < 0:
        raise ProblemError(
            expected="damping and temperature from 0 up, anisotropy, and a field of three numbers",
            received=f"damping={damping!r}, temperature={temperature!r}, field={field!r}, anisotropy={anisotropy!r}",
            remedy="give damped_spin(0.5, 0.25, field=(0, 0, 1))",
        )
    y = [poly.variable(3, k) for k in range(3)]
    slope = [poly.constant(3, -b) for b in field]
    slope[2] = poly.add(slope[2], poly.scale(-anisotropy, y[2]))
    turned = _cross(y, slope)
    omega = [poly.add(s, poly.scale(damping, t)) for s, t in zip(slope, turned, strict=True)]
    axes = [[poly.constant(3, float(j == k)) for k in range(3)] for j in range(3)]
    c = (math.sqrt(2 * damping * temperature),) * 3
    noises = tuple(_turning(axis) for axis in axes)
    data = PolynomialSystem(3, poly.squares((1, 1, 1)), _turning(omega), c, noise_structures=noises)
    return started(data, "damped-spin", (0.6, 0.0, 0.8))


def _cross(a: Sequence[Polynomial], b: Sequence[Polynomial]) -> list[Polynomial]:
    """The product a × b, by a × b = hat(a) b."""
    total = [poly.polynomial(3, {})] * 3
    for i, j, k, sign in HAT:
        total[i] = poly.add(total[i], poly.scale(sign, poly.multiply(a[k], b[j])))
        total[j] = poly.add(total[j], poly.scale(-sign, poly.multiply(a[k], b[i])))
    return total


def _turning(omega: Sequence[Polynomial]) -> Structure:
    """The structure −hat(ω) of the field y × ω = −hat(ω) y."""
    return tuple((i, j, poly.scale(-sign, omega[k])) for i, j, k, sign in HAT if omega[k].terms)
