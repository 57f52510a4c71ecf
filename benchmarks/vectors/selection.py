"""The choice of cases for the reference vectors: the paper's problems, extremes, folds,
separatrices, random systems.

All cases are the same in each run, also the random systems.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

from sepv.reference.arithmetic import total
from sepv.reference.branch import follow
from sepv.reference.equations import EQUATIONS
from sepv.reference.problem import Description, binary64_problem
from sepv.reference.vector import FLOW

from benchmarks.vectors.random_systems import Generator
from sepv.problem import NamedProblem, PolynomialSystem
from sepv.record import poly


class Candidate(NamedTuple):
    """A case of a scheme for the reference vectors, without its result."""

    scheme: str
    family: str
    problem: Description
    y: tuple[float, ...]
    h: float
    dW: tuple[float, ...]
    flags: tuple[str, ...]
    note: str


class _Draft(NamedTuple):
    problem: Description
    y: tuple[float, ...]
    h: float
    dW: tuple[float, ...]
    flags: tuple[str, ...]
    note: str


OSCILLATOR = NamedProblem("harmonic-oscillator", (("noise", (1.0,)),))
PENDULUM = NamedProblem("pendulum", (("noise", (1.0, 0.5)),))
BODY = NamedProblem("rigid-body", (("inertia", (0.345, 0.653, 1.0)), ("noise", (1.0,))))
PREDATORS = NamedProblem(
    "lotka-volterra",
    (("a", (-2.0,)), ("b", (-1.0,)), ("d", (-0.5,)), ("nu", (1.0,)), ("mu", (2.0,)), ("noise", (0.5,))),
)
# The paper's problems with its parameters and initial states, §4.1 to §4.4.
PAPER: dict[str, tuple[NamedProblem, tuple[float, ...]]] = {
    "oscillator": (OSCILLATOR, (0.2, 0.1)),
    "rigid body": (BODY, (0.8, 0.6, 0.0)),
    "pendulum": (PENDULUM, (0.2, 1.0)),
    "Lotka-Volterra": (PREDATORS, (1.0, 1.9, 0.5)),
}


def noise_of(problem: Description) -> tuple[float, ...]:
    """The noise sizes c_j of a problem."""
    return problem.noise if isinstance(problem, PolynomialSystem) else dict(problem.parameters)["noise"]


def split(problem: Description, delta: float, share: float = 0.25) -> tuple[float, tuple[float, ...]]:
    """Split Δ into h = share·|Δ| and equal noise terms c_jΔW_j for the rest; without noise h
    = Δ.
    """
    c = [v for v in noise_of(problem) if v]
    if not c:
        return delta, (0.0,) * len(noise_of(problem))
    h = share * abs(delta)
    return h, tuple((delta - h) / (len(c) * v) if v else 0.5 for v in noise_of(problem))


def _paper() -> Iterator[_Draft]:
    for name, (problem, y) in PAPER.items():
        for delta in (0.1, -0.1, 0.01, -0.01, 2.0**-10, -(2.0**-10)):
            yield _Draft(
                problem, y, *split(problem, delta), (), f"{name} from the paper's state, Δ about {delta:g}"
            )


def _short() -> Iterator[_Draft]:
    for name, (problem, y) in PAPER.items():
        for k, exponent in enumerate((4, 8, 12, 16, 20, 50, 100, 200, 300)):
            delta = (-1.0) ** k * 10.0**-exponent
            yield _Draft(
                problem,
                y,
                *split(problem, delta),
                ("short-step",),
                f"{name}, |Δ| about 1e-{exponent}: y1 − y0 is lost beside y0",
            )


def _long() -> Iterator[_Draft]:
    steps = {
        "oscillator": (1.0, -10.0, 1e3, 1e8, -1e15),
        "rigid body": (1.0, 5.0, -20.0, 100.0, 1e4),
        "pendulum": (1.0, -2.0, 5.0, 20.0),
        "Lotka-Volterra": (0.5, 0.8, 1.0, 1.1, -0.3, -0.5),
    }
    for name, deltas in steps.items():
        problem, y = PAPER[name]
        for delta in deltas:
            note = f"{name}, Δ about {delta:g}: far beyond any contraction radius, on the branch that starts at y0"
            yield _Draft(problem, y, *split(problem, delta), ("large-step",), note)


def _folds(scheme: str) -> Iterator[_Draft]:
    """Steps shorter by a fraction 2^−k than the fold of the solutions' branch from y0.
    Conditions grow like 2^(k/2).
    """
    cubic = PolynomialSystem(
        2,
        poly.polynomial(2, [((2, 0), 0.5), ((0, 3), 1.0)]),
        ((0, 1, poly.constant(2, -1.0)),),
        (1.0,),
    )
    states: list[tuple[Description, tuple[float, ...], str]] = [
        (PREDATORS, (1.0, 1.9, 0.5), "Lotka-Volterra from the paper's state"),
        (PREDATORS, (0.5, 3.0, 0.25), "Lotka-Volterra from (0.5, 3, 0.25)"),
        (PREDATORS, (2.0, 1.0, 1.5), "Lotka-Volterra from (2, 1, 1.5)"),
        (cubic, (1.0, -1.0), "H = p²/2 + x³"),
    ]
    for problem, y, name in states:
        for sign in (1.0, -1.0):
            # Δ = h without noise increments, so that Δ is exactly as the note says.
            zero = (0.0,) * len(noise_of(problem))
            end = follow(EQUATIONS[scheme], problem, y, 4 * sign, zero)
            if end.whole:
                continue
            for k in (1, 3, 6, 10, 14, 18, 24):
                h = 4 * sign * end.reached * (1 - 2.0**-k)
                note = f"{name}, a share 2^-{k} short of the fold at Δ = {4 * sign * end.reached:.9g}"
                yield _Draft(problem, y, h, zero, ("near-fold",) if k > 1 else ("large-step",), note)


def _cancelling() -> Iterator[_Draft]:
    for name, (problem, y) in PAPER.items():
        c = noise_of(problem)
        for k in (10, 30, 45, 52):
            h = 0.125
            dW = (-h * (1 - 2.0**-k) / c[0], *(0.0 for _ in c[1:]))
            yield _Draft(problem, y, h, dW, ("cancelling",), f"{name}: h and Σ c_jΔW_j cancel to 2^-{k} of h")
    for n in (1, 2, 4):
        # H = (y1 − y2)^(2n) multiplied out: its gradient cancels if y1 is close to y2.
        terms = [((j, 2 * n - j), (-1.0) ** j * math.comb(2 * n, j)) for j in range(2 * n + 1)]
        system = PolynomialSystem(2, poly.polynomial(2, terms), ((0, 1, poly.constant(2, -1.0)),), (1.0,))
        for k in (4, 20, 40):
            y = (1.0, 1.0 + 2.0**-k)
            note = f"H = (y1 − y2)^{2 * n} multiplied out, y1 and y2 equal to 2^-{k}: ∇H cancels"
            yield _Draft(system, y, *split(system, 0.125), ("cancelling",), note)


def _scales() -> Iterator[_Draft]:
    quartic = PolynomialSystem(
        2,
        poly.polynomial(2, [((2, 0), 0.5), ((0, 4), 0.25)]),
        ((0, 1, poly.constant(2, -1.0)),),
        (1.0,),
    )
    least, small = 5e-324, 2.5e-310
    y: tuple[float, ...]
    for y in ((least, 0.0), (small, -small), (1e-308, least), (3e-308, 2e-308)):
        for problem in (OSCILLATOR, PENDULUM, quartic):
            note = "subnormal states: products underflow"
            yield _Draft(problem, y, *split(problem, 0.4375), ("subnormal",), note)
    momenta: tuple[tuple[float, ...], ...] = (
        (small, least, -small),
        (1e-308, 1.0, 1e-310),
        (1.0, 1e-320, 1.0),
    )
    for y in momenta:
        yield _Draft(BODY, y, *split(BODY, -0.25), ("subnormal",), "rigid body with subnormal components")
    y = (1e-310, 1.9, 0.5)
    yield _Draft(PREDATORS, y, *split(PREDATORS, 0.01), ("subnormal",), "Lotka-Volterra, y1 subnormal")
    for size in (1e100, 1e200, 1e300):
        y = (size, -size / 3)
        yield _Draft(OSCILLATOR, y, *split(OSCILLATOR, 0.5), ("huge",), f"oscillator at {size:g}")
    for size in (1e50, 1e100, 1e150):
        y = (0.8 * size, 0.6 * size, -0.1 * size)
        note = f"rigid body at {size:g}, Δ as small: |y|² is near overflow"
        yield _Draft(BODY, y, *split(BODY, 0.25 / size), ("huge",), note)
    for size in (1e20, 1e40, 1e70):
        note = f"quartic H at {size:g}, Δ as small as that asks for"
        yield _Draft(quartic, (size, size / 2), *split(quartic, 0.1 / size**2), ("huge",), note)
    for y in ((1e3, 1e3), (1e8, 1e8), (-1e12, 1e15)):
        note = f"pendulum at q = {y[1]:g}: the argument of sin loses digits"
        yield _Draft(PENDULUM, y, *split(PENDULUM, 0.25), ("huge",), note)
    for y in ((1e8, 1.0, 1e-8), (1e-12, 1e3, 1.0), (1.0, 1e-16, 1e-16)):
        note = "rigid body, components of very different size"
        yield _Draft(BODY, y, *split(BODY, 0.1 / max(y)), ("mixed-scales",), note)
    for y in ((1e3, 1e-3, 1.0), (1e-6, 1e3, 1e3)):
        note = "Lotka-Volterra, components of very different size"
        yield _Draft(PREDATORS, y, *split(PREDATORS, 1e-5), ("mixed-scales",), note)


def _separatrices() -> Iterator[_Draft]:
    flags = ("separatrix",)
    for y, what in (
        ((2.0, 0.0), "on the separatrix exactly"),
        ((-2.0, 0.0), "on the separatrix exactly, turning back"),
        ((2 * math.cos(0.5), 1.0), "on the separatrix to rounding"),
        ((0.0, math.pi), "at the upper equilibrium, to rounding of π"),
        ((1e-9, -math.pi), "beside the upper equilibrium"),
        ((0.0, 3.0), "libration near the top"),
    ):
        for delta in (0.25, -0.1):
            yield _Draft(PENDULUM, y, *split(PENDULUM, delta), flags, f"pendulum {what}")
    # On the separatrix K_a = K_c, that is y_a²/A_a = y_c²/A_c.
    a, c = 1 / 0.653 - 1 / 1.0, 1 / 0.345 - 1 / 0.653
    for body, what in (
        ((0.0, 1.0, 0.0), "on the unstable axis"),
        ((1e-9, 1.0, 0.0), "beside the unstable axis"),
        ((1e-300, 1.0, -1e-300), "beside the unstable axis by 1e-300"),
        ((math.sqrt(a) / 2, 0.5, math.sqrt(c) / 2), "on the separatrix to rounding"),
    ):
        for delta in (0.25, -0.1):
            yield _Draft(BODY, body, *split(BODY, delta), flags, f"rigid body {what}")


def _rest() -> Iterator[_Draft]:
    cases: tuple[tuple[NamedProblem, tuple[float, ...], str], ...] = (
        (OSCILLATOR, (0.0, 0.0), "oscillator at rest"),
        (PENDULUM, (0.0, 0.0), "pendulum at rest"),
        (BODY, (0.0, 0.0, 0.0), "rigid body without momentum"),
        (BODY, (1.0, 0.0, 0.0), "rigid body about its first axis"),
        (BODY, (0.0, 0.0, -3.0), "rigid body about its third axis"),
        (
            NamedProblem("rigid-body", (("inertia", (2.0, 2.0, 2.0)), ("noise", (1.0,)))),
            (0.3, -0.2, 0.7),
            "a ball",
        ),
    )
    for problem, y, what in cases:
        for delta in (0.5, -2.0):
            yield _Draft(problem, y, *split(problem, delta), ("rest",), f"{what}: y1 = y0")
    symmetric = NamedProblem("rigid-body", (("inertia", (1.0, 1.0, 2.0)), ("noise", (1.0, 0.5, 0.25, 2.0))))
    yield _Draft(symmetric, (0.3, -0.2, 0.7), *split(symmetric, 0.5), (), "a symmetric body with four noises")


def lipschitz(problem: Description, y: tuple[float, ...]) -> float:
    """The norm ‖f′(y)‖_∞ of the derivative of the field f, in floats."""
    p = binary64_problem(problem)
    state = p.state(y)
    columns = [p.field_slope(state, [float(i == k) for i in range(len(y))]) for k in range(len(y))]
    return max(total(abs(v) for v in row) for row in zip(*columns, strict=True))


_SHARES = (0.4, -0.2, 0.05, -0.4, 0.01, 0.2)


def _random(scheme: str, every: int, phase: int) -> Iterator[_Draft]:
    """Cases of each `every`-th of 84 random systems; other systems are not drawn,
    because finding steps takes time.
    """
    for n in range(phase % every, 84, every):
        if n < 72:
            d, k = 1 + n // 6, n % 6
            degree, structure_degree, noises = 1 + (n * 3) % 8, n % 4 if d > 1 else 0, (n + k) % 5
            draw = Generator(1000 + n)
            system = draw.system(d, degree, structure_degree, noises)
            note = f"random system: d = {d}, H of degree {degree}, B of degree {structure_degree}, {noises} noises"
            flags: tuple[str, ...] = ()
        else:
            d, k = 3, n - 72
            draw = Generator(2000 + k)
            system = draw.on_a_quadric(1 + k % 8, k % 3, k % 5)
            note = f"random system on a quadric: H of degree {1 + k % 8}, B of degree {1 + k % 3}"
            flags = ("casimir",)
        y = tuple(draw.component() for _ in range(d))
        yield _within(scheme, system, y, _SHARES[k % 6], note, flags)


def _within(
    scheme: str,
    system: PolynomialSystem,
    y: tuple[float, ...],
    share: float,
    note: str,
    flags: tuple[str, ...],
) -> _Draft:
    """A step with |Δ| = |share|/‖f′(y)‖, halved until the branch of solutions from y covers the
    whole step.
    """
    delta = share / (lipschitz(system, y) or 1.0)
    for _ in range(40):
        h, dW = split(system, delta)
        if EQUATIONS[scheme].residual is None or follow(EQUATIONS[scheme], system, y, h, dW).whole:
            break
        delta /= 2
    return _Draft(system, y, h, dW, flags, note)


_ONE_STEP = ("energy-preserving", "midpoint", "discrete-gradient")


def _families(scheme: str) -> dict[str, list[_Draft]]:
    return {
        "paper": list(_paper()),
        "short": list(_short()),
        "long": list(_long()),
        "fold": list(_folds(scheme)) if scheme in _ONE_STEP else [],
        "cancelling": list(_cancelling()),
        "scale": list(_scales()),
        "separatrix": list(_separatrices()),
        "rest": list(_rest()),
    }


def _quadrature_settles(draft: _Draft) -> bool:
    """False for huge states, and for tiny components if H is no polynomial.
    Error bounds of a rule say little there.
    """
    closed = isinstance(draft.problem, PolynomialSystem) or draft.problem in (OSCILLATOR, BODY)
    return "huge" not in draft.flags and (closed or not {"subnormal", "mixed-scales"} & set(draft.flags))


def candidates(scheme: str) -> list[Candidate]:
    """The cases of one scheme. (2.1) has all of them, the paper's other schemes a third,
    methods with stages a few.
    """
    if scheme == FLOW:
        return [Candidate(FLOW, family, *draft) for family, draft in _flows()]
    phase = 1 + sorted(SCHEMES).index(scheme)
    stages = EQUATIONS[scheme].of_increments
    every = 1 if scheme == "energy-preserving" else 12 if stages else 3
    found = []
    for family, drafts in _families(scheme).items():
        # Methods with stages get no long steps, whose branches depend on the number of stages, and
        # no drafts for which no quadrature settles.
        usual = [draft for draft in drafts if family != "long" and _quadrature_settles(draft)]
        kept = (usual if stages else drafts)[phase % every :: every]
        if scheme == "milstein":
            # The term f′f of the rigid body at 1e150 overflows, although the step itself does not.
            kept += [draft for draft in drafts if "1e+150" in draft.note and draft not in kept]
        found += [Candidate(scheme, family, *draft) for draft in kept]
    random = _random(scheme, 24 if stages else every, phase)
    return found + [Candidate(scheme, "random", *draft) for draft in random]


def _flows() -> Iterator[tuple[str, _Draft]]:
    """Pairs (family, draft) for the exact flow, with the time θ in place of h."""
    for name, (problem, y) in PAPER.items():
        for theta in (
            (8.0, -5.0, 1.0, -1.0, 0.1, 1e-8) if name != "Lotka-Volterra" else (1.0, -0.75, 0.1, 1e-8)
        ):
            yield (
                "paper",
                _Draft(problem, y, theta, (), (), f"{name} from the paper's state at θ = {theta:g}"),
            )
    for draft in list(_separatrices())[::2]:
        if any(0 < abs(v) < 1e-30 for v in draft.y):
            continue
        yield "separatrix", draft._replace(h=2.0, dW=(), note=f"{draft.note}, θ = 2")
    for k in range(12):
        draw = Generator(3000 + k)
        d = 2 + k % 5
        system = draw.system(d, 1 + k % 6, k % 3, 1) if k % 3 else draw.on_a_quadric(1 + k % 4, k % 2, 1)
        y = tuple(draw.component() for _ in range(system.dimension))
        theta = (-1.0) ** k * 0.5 / (lipschitz(system, y) or 1.0)
        yield (
            "random",
            _Draft(
                system,
                y,
                theta,
                (),
                (),
                f"random system: d = {system.dimension}, H of degree {system.hamiltonian.degree}",
            ),
        )


SCHEMES = (
    "energy-preserving",
    "midpoint",
    "discrete-gradient",
    "euler-heun",
    "milstein",
    "euler-maruyama",
    *(f"collocation-{s}" for s in range(1, 7)),
    *(f"gauss-{s}" for s in range(1, 7)),
    FLOW,
)
