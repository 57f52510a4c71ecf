"""Growth of E[H] and E[C] under additive noise, for three schemes:
``python -m benchmarks.additive_noise``.

The problem is `pushed-rigid-body`. Paths are drawn in pairs with opposite noise, because the mean
of a pair varies less. The run takes some ten seconds of one core.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from sepv.properties import drift_of_energy

from benchmarks import start
from sepv import problems, schemes
from sepv.console import markdown
from sepv.problem import Array, PolynomialSystem, Problem, noise_vectors, vector_field
from sepv.schemes import as_lanes, implicit, pushed_by_noise, quiet_step

PATH_PAIRS, SEED, ADDITIVE_T = 10_000, 1, 1.0
ADDITIVE_STEPS = (2, 16)
# The last argument holds the increments over the first half of the step, which only one of the
# schemes uses.
Step = Callable[[Problem, Array, float, Array, Array], Array]

_implicit = implicit(lambda fields, y, z, step: step[0] * fields.field(y + z), parts=quiet_step.parts)


def euler_maruyama(problem: Problem, y: Array, h: float, dW: Array, first: Array | None = None) -> Array:  # noqa: ARG001
    """Euler-Maruyama: y1 = y0 + h f(y0) + Σ c_j g_j ΔW_j."""
    state, noise = as_lanes(problem, y, h, dW)
    return pushed_by_noise(problem, state + h * vector_field(problem, state), noise).reshape(y.shape)


def implicit_euler(problem: Problem, y: Array, h: float, dW: Array, first: Array | None = None) -> Array:  # noqa: ARG001
    """The drift-implicit Euler scheme: y1 = y0 + h f(y1) + Σ c_j g_j ΔW_j."""
    state, noise = as_lanes(problem, y, h, dW)
    return _implicit(problem, pushed_by_noise(problem, state, noise), h, noise).reshape(y.shape)


ADDITIVE_SCHEMES: dict[str, Step] = {
    "drift-preserving": schemes.drift_preserving.step,
    "Euler-Maruyama": euler_maruyama,
    "implicit Euler-Maruyama": implicit_euler,
}


def exact_rates(problem: Problem) -> Array:
    """The rates of E|y|² and E[H], (2,), by the trace formula."""
    assert isinstance(problem.data, PolynomialSystem)
    casimir = float(problem.c**2 @ np.sum(noise_vectors(problem) ** 2, axis=1))
    return np.array([casimir, drift_of_energy(problem.data)])


def rates(step: Step, problem: Problem, steps: int) -> tuple[Array, Array]:
    """The growth of E|y|² and of E[H] per unit of time, (2,), with standard errors."""
    rng, h, origin = np.random.default_rng(SEED), ADDITIVE_T / steps, np.asarray(problem.initial)
    y = np.repeat(origin[:, None], 2 * PATH_PAIRS, axis=1)
    for _ in range(steps):
        halves = np.sqrt(h / 2) * rng.standard_normal((2, problem.noises, PATH_PAIRS))
        halves = np.concatenate([halves, -halves], axis=2)
        y = step(problem, y, h, halves.sum(axis=0), halves[0])
    changes = np.stack(
        [np.sum(y * y, axis=0) - origin @ origin, problem.hamiltonian(y) - problem.hamiltonian(origin)]
    )
    means = changes.reshape(2, 2, PATH_PAIRS).mean(axis=1) / ADDITIVE_T
    return means.mean(axis=1), means.std(axis=1) / np.sqrt(PATH_PAIRS)


def table() -> str:
    """The table of the rates of each scheme at each step size, with a row for the exact rates."""
    problem = problems.pushed_rigid_body()
    names = [f"{of}, h = {h}" for of in ("E\\|y\\|²", "E[H]") for h in ("½", "1/16")]
    rows: list[Sequence[str]] = [
        ["exact", *(f"{v:.3f}" for v in np.repeat(exact_rates(problem), len(ADDITIVE_STEPS)))]
    ]
    for name, step in ADDITIVE_SCHEMES.items():
        found = [rates(step, problem, n) for n in ADDITIVE_STEPS]
        rows.append([name, *(f"{mean[k]:.3f} ± {error[k]:.3f}" for k in (0, 1) for mean, error in found)])
    return markdown(["scheme", *names], rows)


def main() -> None:
    """Print the table."""
    print(table())


if __name__ == "__main__":
    start(main)
