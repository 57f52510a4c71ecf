"""The code of the paper's problems that are not polynomial: the pendulum and Lotka-Volterra."""

from __future__ import annotations

from collections.abc import Sequence

from sepv.engine.code import Table, skew
from sepv.engine.text import Expression, Text
from sepv.polynomial import add, constant, multiply, polynomial, scale, variable
from sepv.problem import NamedProblem, PolynomialSystem


def as_polynomial(data: NamedProblem) -> PolynomialSystem | None:
    """The polynomial data of a named problem that is one."""
    parameters = dict(data.parameters)
    if data.name == "harmonic-oscillator":
        return PolynomialSystem(
            dimension=2,
            hamiltonian=polynomial(2, [((2, 0), 0.5), ((0, 2), 0.5)]),
            structure=((0, 1, constant(2, -1.0)),),
            noise=parameters["noise"],
        )
    if data.name == "rigid-body":
        y = [variable(3, i) for i in range(3)]
        minus = [polynomial(3, {y[i].terms[0][0]: -1.0}) for i in range(3)]
        squares = [((2, 0, 0), 0), ((0, 2, 0), 1), ((0, 0, 2), 2)]
        return PolynomialSystem(
            dimension=3,
            hamiltonian=polynomial(3, [(e, 0.5 / parameters["inertia"][i]) for e, i in squares]),
            structure=((0, 1, minus[2]), (0, 2, y[1]), (1, 2, minus[0])),
            noise=parameters["noise"],
            casimirs=(((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),),
            nambu=(constant(3, -1.0), polynomial(3, [(e, 0.5) for e, _ in squares])),
        )
    return None


class Pendulum:
    """y = (p, q), H = p²/2 − cos q; the mean of sin q is sin(q + δ/2)·sinc(δ/2)."""

    preamble = "from sepv.engine.functions import cosine, sincos, sinc\n"
    dimension = 2
    nambu = None
    field = None
    gradient_evaluations = 1
    degree = 0
    rate = 2.0**-26  # the derivative of sinc cancels near 0

    def hamiltonian(self, e: Text, y: Sequence[str]) -> Expression:
        """H(y)."""
        return e.let(f"0.5 * {y[0]} * {y[0]} - cosine({y[1]})")

    def gradient(self, e: Text, y: Sequence[str]) -> list[Expression]:
        """∇H(y)."""
        return [y[0], e.call("sincos", [y[1]], 2)[0]]

    def hessian(self, e: Text, y: Sequence[str]) -> Table:
        """H″(y)."""
        return [["(1.0)", None], [None, e.call("sincos", [y[1]], 2)[1]]]

    def structure(self, e: Text, y: Sequence[str]) -> Table:  # noqa: ARG002 - constant
        """B, constant."""
        return [[None, "(-1.0)"], ["(1.0)", None]]

    def structure_derivative(self, e: Text, y: Sequence[str]) -> list[Table]:  # noqa: ARG002 - constant
        """Zero."""
        return [[[None, None], [None, None]]] * 2

    def mean_gradient(self, e: Text, y: Sequence[str], z: Sequence[str]) -> list[Expression]:
        """(p + δp/2, sin(q + δq/2) sinc(δq/2))."""
        sine, _, mean, _ = self._parts(e, y, z)
        return [e.let(f"{y[0]} + 0.5 * {z[0]}"), e.product(sine, mean)]

    def mean_hessian(self, e: Text, y: Sequence[str], z: Sequence[str]) -> Table:
        """½cos(q + δ/2) sinc(δ/2) + ½sin(q + δ/2) sinc′(δ/2)."""
        sine, cos, mean, slope = self._parts(e, y, z)
        return [["(0.5)", None], [None, e.let(f"0.5 * ({cos} * {mean} + {sine} * {slope})")]]

    def _parts(self, e: Text, y: Sequence[str], z: Sequence[str]) -> list[str]:
        half = e.let(f"0.5 * {z[1]}")
        middle = e.let(f"{y[1]} + {half}")
        return e.call("sincos", [middle], 2) + e.call("sinc", [half], 2)

    def domain(self, e: Text, y: Sequence[str]) -> str | None:  # noqa: ARG002 - everywhere
        """Everywhere."""
        return None

    def casimirs(self, e: Text, y: Sequence[str]) -> list[Expression]:  # noqa: ARG002 - none
        """None."""
        return []

    def casimir_gradients(self, e: Text, ends: Sequence[str]) -> Table:  # noqa: ARG002 - none
        """None."""
        return []


class LotkaVolterra:
    """H = ab y1 + y2 − a y3 + ν ln y2 − μ ln y3 in the octant; means of 1/y by log1p."""

    preamble = "from sepv.engine.functions import logarithm, mean_reciprocal\n"
    dimension = 3
    gradient_evaluations = 1
    degree = 0
    rate = 2.0**-10  # derivatives of the means are those of three nodes

    def __init__(self, data: NamedProblem) -> None:
        p = {key: value[0] for key, value in data.parameters if key != "noise"}
        self.a, self.ab, self.nu, self.mu = p["a"], p["a"] * p["b"], p["nu"], p["mu"]
        self.pairs = ((0, 1, p["d"]), (0, 2, p["b"] * p["d"]), (1, 2, -1.0))
        y = [variable(3, i) for i in range(3)]
        # y_j ∂H/∂y_j, since B_ij = factor y_i y_j.
        turned = [
            scale(self.ab, y[0]),
            add(y[1], constant(3, self.nu)),
            add(scale(-self.a, y[2]), constant(3, -self.mu)),
        ]
        sums = [[constant(3, 0.0)] for _ in y]
        for i, j, factor in self.pairs:
            sums[i].append(scale(factor, turned[j]))
            sums[j].append(scale(-factor, turned[i]))
        self.field = [multiply(v, add(*terms)) for v, terms in zip(y, sums, strict=True)]
        self.nambu = LotkaVolterraCasimir((1.0, p["b"] * p["d"], -p["d"]))

    def hamiltonian(self, e: Text, y: Sequence[str]) -> Expression:
        """H(y)."""
        logs = [e.let(f"logarithm({v})") for v in y[1:]]
        return e.total([
            e.product(e.number(self.ab), y[0]), y[1], e.product(e.number(-self.a), y[2]),
            e.product(e.number(self.nu), logs[0]), e.product(e.number(-self.mu), logs[1]),
        ])  # fmt: skip

    def gradient(self, e: Text, y: Sequence[str]) -> list[Expression]:
        """∇H(y)."""
        return self._slopes(e, [e.let(f"1.0 / {v}") for v in y[1:]])

    def hessian(self, e: Text, y: Sequence[str]) -> Table:
        """H″(y)."""
        squares = [e.let(f"1.0 / ({v} * {v})") for v in y[1:]]
        return self._diagonal(
            e.product(e.number(-self.nu), squares[0]), e.product(e.number(self.mu), squares[1])
        )

    def structure(self, e: Text, y: Sequence[str]) -> Table:
        """B_ij = factor y_i y_j."""
        return skew(3, {(i, j): e.product(e.number(f), y[i], y[j]) for i, j, f in self.pairs}, e)

    def structure_derivative(self, e: Text, y: Sequence[str]) -> list[Table]:
        """∂B_ij/∂y_k at [k][i][j]."""
        tables = []
        for k in range(3):
            upper = {
                (i, j): e.product(e.number(f), y[j if k == i else i]) for i, j, f in self.pairs if k in (i, j)
            }
            tables.append(skew(3, upper, e))
        return tables

    def mean_gradient(self, e: Text, y: Sequence[str], z: Sequence[str]) -> list[Expression]:
        """With ∫₀¹dτ/(y + τδ) = log1p(δ/y)/δ."""
        return self._slopes(e, [_means(e, y, z, i)[0] for i in (1, 2)])

    def mean_hessian(self, e: Text, y: Sequence[str], z: Sequence[str]) -> Table:
        """With the derivative of that mean by δ."""
        slopes = [_means(e, y, z, i)[1] for i in (1, 2)]
        return self._diagonal(
            e.product(e.number(self.nu), slopes[0]), e.product(e.number(-self.mu), slopes[1])
        )

    def domain(self, e: Text, y: Sequence[str]) -> str | None:
        """The octant y > 0."""
        return e.let(" & ".join(f"({v} > 0.0)" for v in y))

    def casimirs(self, e: Text, y: Sequence[str]) -> list[Expression]:  # noqa: ARG002 - none
        """Its Casimir is not quadratic."""
        return []

    def casimir_gradients(self, e: Text, ends: Sequence[str]) -> Table:  # noqa: ARG002 - none
        """None."""
        return []

    def _slopes(self, e: Text, reciprocals: list[str]) -> list[Expression]:
        return [
            e.number(self.ab),
            e.total(["(1.0)", e.product(e.number(self.nu), reciprocals[0])]),
            e.total([e.number(-self.a), e.product(e.number(-self.mu), reciprocals[1])]),
        ]

    @staticmethod
    def _diagonal(second: Expression, third: Expression) -> Table:
        return [[None, None, None], [None, second, None], [None, None, third]]


class LotkaVolterraCasimir:
    """g = −y1y2y3 and C = Σ w_i ln y_i."""

    def __init__(self, weights: tuple[float, float, float]) -> None:
        self.weights = weights

    def factor(self, e: Text, y: Sequence[str]) -> Expression:
        """g(y)."""
        return e.product("(-1.0)", *y)

    def factor_gradient(self, e: Text, y: Sequence[str]) -> list[Expression]:
        """∇g(y)."""
        return [e.product("(-1.0)", y[i], y[j]) for i, j in ((1, 2), (0, 2), (0, 1))]

    def mean_gradient(self, e: Text, y: Sequence[str], z: Sequence[str]) -> list[Expression]:
        """With the mean of 1/y."""
        return [e.product(e.number(w), _means(e, y, z, i)[0]) for i, w in enumerate(self.weights)]

    def mean_hessian(self, e: Text, y: Sequence[str], z: Sequence[str]) -> Table:
        """With its derivative."""
        slopes = [e.product(e.number(w), _means(e, y, z, i)[1]) for i, w in enumerate(self.weights)]
        return [[slopes[i] if i == k else None for k in range(3)] for i in range(3)]


def _means(e: Text, y: Sequence[str], z: Sequence[str], i: int) -> list[str]:
    return e.call("mean_reciprocal", [y[i], z[i]], 2)
