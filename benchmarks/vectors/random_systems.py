"""Random polynomial systems for the reference vectors;
they are the same in every run and on every machine.

Only `random()` of Python's Mersenne twister is used, because Python promises to keep its stream.
"""

from __future__ import annotations

from itertools import combinations
from random import Random

from sepv.problem import PolynomialSystem
from sepv.record import Exponents, Polynomial, poly


class Generator:
    """Random polynomial systems from the stream of one seed."""

    def __init__(self, seed: int) -> None:
        self._random = Random(seed).random

    def below(self, n: int) -> int:
        """A random integer among 0, …, n − 1."""
        return int(self._random() * n)

    def coefficient(self) -> float:
        """A random multiple of 1/4 between −2 and 2, not 0."""
        return (1 + self.below(8)) / 4 * (1 if self.below(2) else -1)

    def component(self) -> float:
        """A random double between −1.5 and 1.5."""
        return 3 * self._random() - 1.5

    def monomial(self, d: int, degree: int) -> Exponents:
        """Random exponents of d variables that add up to `degree`."""
        exponents = [0] * d
        for _ in range(degree):
            exponents[self.below(d)] += 1
        return tuple(exponents)

    def polynomial(self, d: int, degree: int, terms: int) -> Polynomial:
        """A random polynomial with one term of this degree and further terms of any degree up to
        it.
        """
        degrees = [degree, *(self.below(degree + 1) for _ in range(terms - 1))]
        return poly.polynomial(d, [(self.monomial(d, k), self.coefficient()) for k in degrees])

    def hamiltonian(self, d: int, degree: int) -> Polynomial:
        """A random H with 3 to 5 terms, to which ½|y|² is added with probability ½ if the degree is
        2 or more.
        """
        found = self.polynomial(d, degree, 3 + self.below(3))
        if degree >= 2 and self.below(2):
            squares = [(tuple(2 * int(i == k) for i in range(d)), 0.5) for k in range(d)]
            found = poly.add(found, poly.polynomial(d, squares))
        return found

    def system(self, d: int, degree: int, structure_degree: int, noises: int) -> PolynomialSystem:
        """A system whose B has up to d + 2 entries above the diagonal;
        y_d is a Casimir if d ≥ 4 and m is even.
        """
        moving = d - 1 if d >= 4 and noises % 2 == 0 else d
        pairs = list(combinations(range(moving), 2))
        chosen = sorted({pairs[self.below(len(pairs))] for _ in range(d + 2)}) if pairs else []
        structure = tuple((i, j, self.polynomial(d, structure_degree, 1 + self.below(2))) for i, j in chosen)
        linear = (tuple(float(i == d - 1) for i in range(d)),) if moving < d else ()
        return PolynomialSystem(d, self.hamiltonian(d, degree), structure, self.noise(noises), (), linear)

    def noise(self, m: int) -> tuple[float, ...]:
        """The random sizes c_j of m noises, among 1/4, 1/2, 1, 2."""
        return tuple((0.25, 0.5, 1.0, 2.0)[self.below(4)] for _ in range(m))

    def on_a_quadric(self, degree: int, factor_degree: int, noises: int) -> PolynomialSystem:
        """A system with d = 3 and B = g(y) hat(Ay), A symmetric, so that yᵀAy is a Casimir."""
        A = [[0.0] * 3 for _ in range(3)]
        for i in range(3):
            for j in range(i, 3):
                A[i][j] = A[j][i] = float(self.below(5) - 2) if i != j else float(1 + self.below(3))
        rows = [
            poly.polynomial(3, {tuple(int(i == k) for i in range(3)): A[n][k] for k in range(3)})
            for n in range(3)
        ]
        g = self.polynomial(3, factor_degree, 1)
        signs = ((0, 1, 2, -1.0), (0, 2, 1, 1.0), (1, 2, 0, -1.0))
        structure = tuple((i, j, poly.scale(s, poly.multiply(g, rows[k]))) for i, j, k, s in signs)
        return PolynomialSystem(
            3, self.hamiltonian(3, degree), structure, self.noise(noises), (tuple(map(tuple, A)),)
        )
