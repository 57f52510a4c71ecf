"""The Euler-Heun scheme as a program for ``sepv verify --exec``: plain Python, without sepv and without NumPy.

    sepv verify --exec "python examples/euler_heun_plain.py"

y1 = y0 + h f(y0) + ½(f(ŷ) + f(y0)) S with ŷ = y0 + (h + S) f(y0), f = B∇H and S = Σ c_j ΔW_j. The program reads a
JSON message from each line of stdin, and answers with one line on stdout, as in docs/protocol.md.
"""

import json
import math
import sys

HELLO = {
    "protocol": 1,
    "scheme": "euler-heun-plain",
    "source": "Roberts (2012), as in Cohen and Dujardin (2014), section 4",
    "mean_square_order": 1,
    "problems": ["harmonic-oscillator", "rigid-body", "pendulum", "lotka-volterra"],
    "polynomial": True,
    "max_steps": 256,
}


def oscillator(_parameters):
    """f(p, x) for H = (p² + x²)/2."""
    return lambda y: [-y[1], y[0]]


def pendulum(_parameters):
    """f(p, q) for H = p²/2 − cos q."""
    return lambda y: [-math.sin(y[1]), y[0]]


def rigid_body(parameters):
    """f = y × ∇H for H = ½ Σ y_i²/I_i."""
    inertia = parameters["inertia"]

    def field(y):
        g = [a / i for a, i in zip(y, inertia, strict=True)]
        return [y[1] * g[2] - y[2] * g[1], y[2] * g[0] - y[0] * g[2], y[0] * g[1] - y[1] * g[0]]

    return field


def lotka_volterra(parameters):
    """f = B∇H with B_12 = d y1y2, B_13 = bd y1y3, B_23 = −y2y3."""
    a, b, d, nu, mu = (parameters[key][0] for key in ("a", "b", "d", "nu", "mu"))

    def field(y):
        if min(y) <= 0:
            raise ArithmeticError("left the octant y > 0")
        g = [a * b, 1 + nu / y[1], -a - mu / y[2]]
        b12, b13, b23 = d * y[0] * y[1], b * d * y[0] * y[2], -y[1] * y[2]
        return [b12 * g[1] + b13 * g[2], -b12 * g[0] + b23 * g[2], -b13 * g[0] - b23 * g[1]]

    return field


def polynomial(terms):
    """A function of y from [[exponents, coefficient], …]."""
    table = [(float.fromhex(c), [(i, e) for i, e in enumerate(exponents) if e]) for exponents, c in terms]
    return lambda y: sum(c * math.prod(y[i] ** e for i, e in factors) for c, factors in table)


def derivative(terms, k):
    """∂/∂y_k of [[exponents, coefficient], …]."""
    return [
        [[e - (i == k) for i, e in enumerate(exponents)], (float.fromhex(c) * exponents[k]).hex()]
        for exponents, c in terms
        if exponents[k]
    ]


def polynomial_field(problem):
    """f = B∇H of polynomial data: B_ij is given for i < j, and B_ji = −B_ij."""
    d = problem["dimension"]
    gradient = [polynomial(derivative(problem["hamiltonian"], k)) for k in range(d)]
    entries = [(i, j, polynomial(terms)) for i, j, terms in problem["structure"]]

    def field(y):
        g, f = [slope(y) for slope in gradient], [0.0] * d
        for i, j, entry in entries:
            b = entry(y)
            f[i] += b * g[j]
            f[j] -= b * g[i]
        return f

    return field


NAMED = {
    "harmonic-oscillator": oscillator,
    "pendulum": pendulum,
    "rigid-body": rigid_body,
    "lotka-volterra": lotka_volterra,
}


def read_problem(problem):
    """f and the noise coefficients c, or None if the problem is unknown."""
    if "name" not in problem:
        return polynomial_field(problem), [float.fromhex(c) for c in problem["noise"]]
    if problem["name"] not in NAMED:
        return None
    parameters = {key: [float.fromhex(v) for v in values] for key, values in problem["parameters"].items()}
    return NAMED[problem["name"]](parameters), parameters["noise"]


def step(field, noise, y, h, dW):
    """y1, for y of d components and dW of one increment for each c_j."""
    S = sum(c * increment for c, increment in zip(noise, dW, strict=True))
    f0 = field(y)
    predicted = field([a + h * f + f * S for a, f in zip(y, f0, strict=True)])
    y1 = [a + h * f + 0.5 * (g + f) * S for a, f, g in zip(y, f0, predicted, strict=True)]
    if not all(map(math.isfinite, y1)):
        raise ArithmeticError("the step overflows")
    return y1


def answer(message):
    """The answer to a message, without the id."""
    if message["type"] == "hello":
        return HELLO
    if message["type"] != "step":
        return {"error": "unknown type of message"}
    known = read_problem(message["problem"])
    if known is None:
        return {"skip": "unknown problem"}
    states = []
    for one in message["steps"]:
        y, dW = ([float.fromhex(v) for v in one[key]] for key in ("y", "dW"))
        try:
            states.append([v.hex() for v in step(*known, y, float.fromhex(one["h"]), dW)])
        except ArithmeticError as error:
            return {"error": str(error)}
    return {"y_next": states}


def main():
    """Answer each line until "stop" or the end of stdin."""
    for line in sys.stdin:
        message = json.loads(line)
        if message["type"] == "stop":
            return
        print(json.dumps({"id": message["id"], **answer(message)}), flush=True)


if __name__ == "__main__":
    main()
