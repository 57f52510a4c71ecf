"""diffrax's Stratonovich solvers for general noise, one step at a time and over whole paths.
Needs the extra ``peers``.

A step is the solver's own `init` and `step`, compiled by JAX, on a driving path with the given
increment. Polynomial problems are data to the compiled code, so that a new random problem compiles
nothing.

JAX computes in float64 only where its switch is on. JAX's own context manager turns it on around
each call, for one thread; importing this module changes nothing in JAX.

ShARK, SRA1 and SEA need additive noise, and the noise of (1.1) is not additive. ALIGN, ShOULD and
QUICSORT are for Langevin dynamics. Older releases have fewer solvers: a missing one is left out,
and its name is in `PEER.absent`.

In a comparison all paths are one state (d, M) and one compiled loop over given increments. All
noises drive one field, so that most solvers can be given dy = f(y)∘dθ with θ = t + Σ c_j W_j, which
halves the evaluations of f. The other solvers get a drift term and a noise term. Methods with
"vmap" in their names follow diffrax's examples: each path is solved alone with a drift term and a
noise term, and jax.vmap joins the paths.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from operator import itemgetter
from typing import Any

import diffrax
import jax
import jax.numpy as jnp
import numpy as np

from sepv.peers._diffrax_ode import INTEGRATORS
from sepv.peers._jax import enable_x64
from sepv.peers.peer import Peer, Solver
from sepv.posing import POSED_LANES, OneField, Path, in_blocks, pose_fields, pose_one_field
from sepv.problem import Array, Problem, one_field
from sepv.schemes import Scheme, StatefulStep, Step
from sepv.studies import Method, from_states


class _GivenPath(diffrax.AbstractPath):
    """The driving path of one step: the given increment dW, and its space-time Lévy area H."""

    dW: Any
    H: Any

    @property
    def t0(self) -> Any:
        return -jnp.inf

    @property
    def t1(self) -> Any:
        return jnp.inf

    def evaluate(self, t0: Any, t1: Any = None, left: bool = True, use_levy: bool = False) -> Any:
        del left
        return diffrax.SpaceTimeLevyArea(dt=t1 - t0, W=self.dW, H=self.H) if use_levy else self.dW


def _space_time_area(h: Any, dW: Any) -> Any:
    """The space-time Lévy area H ~ N(0, h/12) of a step, independent of dW,
    drawn with the bits of dW as the seed.

    Stochastic Runge-Kutta methods need it beside dW. A step must be a function of its arguments.
    Therefore equal increments get equal areas.
    """
    key = jax.random.key(0)
    for word in jax.lax.bitcast_convert_type(dW, jnp.uint32).reshape(-1):
        key = jax.random.fold_in(key, word)
    return jnp.sqrt(h / 12) * jax.random.normal(key, dW.shape, dtype=dW.dtype)


# The solvers of additive noise want noise fields that do not use y, which JAX sees in the formulas.
_ADDITIVE = ("ShARK", "SRA1", "SEA")


def _terms(solver: Any, fields: Any, numbers: Any, control: _GivenPath) -> Any:
    """The right side of a step in diffrax's form: the drift, and the noise fields as columns
    (d, m).
    """

    def drift(_t: Any, y: Any, _args: Any) -> Any:
        return fields.drift(jnp, numbers, y)

    def noise(_t: Any, y: Any, _args: Any) -> Any:
        at = jnp.zeros(y.shape, y.dtype) if type(solver).__name__ in _ADDITIVE else y
        return fields.noise(jnp, numbers, at).T

    return diffrax.MultiTerm(diffrax.ODETerm(drift), diffrax.ControlTerm(noise, control))


def _takes_areas(solver: Any) -> bool:
    """True for stochastic Runge-Kutta methods, which need a space-time Lévy area beside dW."""
    return isinstance(solver, getattr(diffrax, "AbstractSRK", ()))


def _one_step(solver: Any, fields: Any, numbers: Any, h: Any, y: Any, rows: Any, state: Any) -> Any:
    """One step of a solver: y_next and the solver's state after it. If `state` is None,
    the solver starts anew.

    The rows are dW (m,), and below them the space-time area H (m,). If it is left out, it is drawn
    for a solver that needs it.
    """
    dW, H = rows[: fields.noises], rows[fields.noises :]
    if _takes_areas(solver) and not len(H):
        H = _space_time_area(h, dW)
    terms, t0 = _terms(solver, fields, numbers, _GivenPath(dW, H)), jnp.zeros_like(h)
    if state is None:
        state = solver.init(terms, t0, h, y, None)
    y_next, _error, _dense, state, _result = solver.step(terms, t0, h, y, None, state, made_jump=False)
    return y_next, state


@partial(jax.jit, static_argnames=("solver", "fields"))
def _steps(solver: Any, fields: Any, numbers: Any, h: Any, y: Any, rows: Any) -> Any:
    """One step from each of L states: y (d, L) with rows (m or 2m, L)."""

    def lane(y: Any, rows: Any) -> Any:
        return _one_step(solver, fields, numbers, h, y, rows, None)[0]

    return jax.vmap(lane, in_axes=1, out_axes=1)(y, rows), None


@partial(jax.jit, static_argnames=("solver", "fields", "keep"))
def _paths(
    solver: Any, fields: Any, keep: bool, numbers: Any, h: Any, y: Any, rows: Any, _H: Any = None
) -> Any:
    """L whole paths, in which the solver keeps its state: y (d, L), rows (N, m, L) -> (N, d, L),
    or the last states. Each is solved alone with a drift term and a noise term, and jax.vmap joins
    them, as in diffrax's examples.
    """

    def lane(y: Any, rows: Any) -> Any:
        def advance(carry: Any, rows: Any) -> Any:
            carry = _one_step(solver, fields, numbers, h, carry[0], rows, carry[1])
            return carry, carry[0] if keep else None

        first = _one_step(solver, fields, numbers, h, y, rows[0], None)
        last, rest = jax.lax.scan(advance, first, rows[1:])
        return jnp.concatenate([first[0][None], rest]) if keep else last[0]

    return jax.vmap(lane, in_axes=(1, 2), out_axes=-1)(y, rows)


_next = jax.jit(_one_step, static_argnames=("solver", "fields"))


def _wide(rows: Array, count: int) -> Array:
    """Pad an array (n, L) or (n,) with zeros, so that n becomes `count`."""
    return np.concatenate([rows, np.zeros((count - len(rows), *rows.shape[1:]))])


def _call(
    program: Any, solver: Any, posed: Any, y: Array, h: float, rows: Array, *state: Any
) -> tuple[Any, Any]:
    """Run a compiled `program` in float64 on y (d, L), rows (m or 2m, L) or (d,), (m,);
    return y_next and solver state.
    """
    (fields, numbers), d = posed, len(y)
    if fields.width:
        y, rows = _wide(y, fields.width), _wide(rows, fields.noises)
    with enable_x64(True):
        y_next, own = program(solver, fields, numbers, np.float64(h), y, rows, *state)
        return np.asarray(y_next)[:d], own


def _posed(problem: Problem, ito: bool = False) -> Any:
    """The fields of (1.1), or of several Hamiltonians, and their numbers. Raises Skipped for Itô's
    form of (1.1).
    """
    one = one_field(problem) and not ito
    return pose_one_field(problem, wide=True) if one else pose_fields(problem, ito=ito)


def _step_by(solver: Any, ito: bool = False) -> Step:
    def step(problem: Problem, y: Array, h: float, dW: Array, H: Array | None = None) -> Array:
        posed, rows = _posed(problem, ito), dW if H is None else np.concatenate([dW, H])
        # The laws step one state of each random problem, and batches of the paper's problems.
        lanes = 1 if posed[0].width else POSED_LANES
        return in_blocks(lambda y, rows: _call(_steps, solver, posed, y, h, rows)[0], y, rows, lanes)

    return step


def _path_by(solver: Any) -> Path:
    def path(problem: Problem, y0: Array, h: float, dW: Array) -> Array:
        fields, numbers = pose_fields(problem)
        start = np.repeat(y0[:, None], dW.shape[2], axis=1)
        with enable_x64(True):
            states = np.asarray(_paths(solver, fields, True, numbers, np.float64(h), start, dW))
        return np.concatenate([start[None], states])

    return path


def _stateful(solver: Any) -> StatefulStep:
    """The step, on one path at a time, of a solver with a state of its own,
    which is kept from step to step.
    """

    def step(problem: Problem, state: tuple[Array, Any], h: float, dW: Array) -> tuple[Array, Any]:
        return _call(_next, solver, _posed(problem), state[0], h, dW, state[1])

    return StatefulStep(lambda _, y: (y, None), step, itemgetter(0))


def _orders(general: float, commutative: float, additive: float, weak: Mapping[str, float]) -> Any:
    """Strong and weak orders by kind of noise; one noise counts as commutative."""
    strong = {"general": general, "commutative": commutative, "one": commutative, "additive": additive}
    return {kind: (p, weak.get(kind, 1.0)) for kind, p in strong.items()}


_ADDITIVE_ORDERS = {"additive": 2.0}
_COMMUTATIVE_ORDERS = {"commutative": 2.0, "one": 2.0, "additive": 2.0}
# Strong and weak orders as the table of diffrax's documentation states them.
DOCUMENTED_ORDERS: dict[str, Any] = {
    "Euler": _orders(0.5, 0.5, 1.0, {}),
    "EulerHeun": _orders(0.5, 0.5, 1.0, {}),
    "Heun": _orders(0.5, 1.0, 1.0, {}),
    "Midpoint": _orders(0.5, 1.0, 1.0, {}),
    "Ralston": _orders(0.5, 1.0, 1.0, {}),
    "ItoMilstein": _orders(0.5, 1.0, 1.0, {}),
    "StratonovichMilstein": _orders(0.5, 1.0, 1.0, {}),
    "ReversibleHeun": _orders(0.5, 1.0, 1.0, {}),
    "SPaRK": _orders(0.5, 1.0, 1.5, _ADDITIVE_ORDERS),
    "GeneralShARK": _orders(0.5, 1.0, 1.5, _ADDITIVE_ORDERS),
    "SlowRK": _orders(0.5, 1.5, 1.5, _COMMUTATIVE_ORDERS),
    "ShARK": {"additive": (1.5, 2.0)},
    "SRA1": {"additive": (1.5, 2.0)},
    "SEA": {"additive": (1.0, 1.0)},
}
_SOURCE = 'diffrax, "SDE solver table"'


def _solver(name: str) -> Solver:
    made = getattr(diffrax, name)()
    step, path = _step_by(made, name in ("Euler", "ItoMilstein")), _path_by(made)
    return Solver(
        name=f"diffrax {name}",
        documented=DOCUMENTED_ORDERS[name],
        source=f"{_SOURCE} (docs.kidger.site/diffrax/devdocs/SDE_solver_table)",
        step=lambda _kind: step,
        ito=name in ("Euler", "ItoMilstein"),
        asks="space-time" if _takes_areas(made) else "",
        # The solver's state holds a second solution beside y.
        path=(lambda _kind: path) if name == "ReversibleHeun" else None,
    )


# Solvers that an older release lacks are left out.
DIFFRAX_SOLVERS = {name: _solver(name) for name in DOCUMENTED_ORDERS if hasattr(diffrax, name)}


def _scheme(solver: Solver, name: str) -> Scheme:
    """A solver as a `Scheme` for the laws, of the order documented for commutative noise."""
    strong, weak = DOCUMENTED_ORDERS[name]["commutative"]
    return Scheme(
        name=solver.name, step=_stateful(getattr(diffrax, name)()) if solver.path else solver.step("one"),
        mean_square_order=strong, weak_order=weak, truncation=None, batched=solver.path is None,
        source=f"{_SOURCE}: order {strong:g} strong and {weak:g} weak for commutative noise",
    )  # fmt: skip


class _Field(diffrax.AbstractTerm):
    """The field f(y) for a batch (d, M), to be multiplied by an increment of time or of a Wiener
    process, (M,).
    """

    vector: Any
    increment: Any

    def vf(self, t: Any, y: Any, args: Any) -> Any:
        del t, args
        return self.vector(y)

    def contr(self, t0: Any, t1: Any, **_: Any) -> Any:
        del t0, t1
        return self.increment

    def prod(self, vf: Any, control: Any) -> Any:
        return vf * control


class _Noise(_Field):
    """A noise term for the field f: it gives the Wiener increment (M,),
    and its space-time Lévy area if asked.
    """

    area: Any

    def contr(self, t0: Any, t1: Any, **options: Any) -> Any:
        if options.get("use_levy"):
            return diffrax.SpaceTimeLevyArea(dt=t1 - t0, W=self.increment, H=self.area)
        return self.increment


def _batched(solver: Any, terms: Any, h: Any, y: Any, more: Any, keep: bool) -> Any:
    """Loop over the steps of a path; `terms` makes the right side of one step from its slice of
    `more`.
    """
    t0 = jnp.zeros_like(h)
    state = solver.init(terms(jax.tree.map(lambda a: a[0], more)), t0, h, y, None)

    def advance(carry: Any, slice_: Any) -> Any:
        y, _error, _dense, state, _result = solver.step(
            terms(slice_), t0, h, carry[0], None, carry[1], made_jump=False
        )
        return (y, state), y if keep else None

    (y, _), states = jax.lax.scan(advance, (y, state), more)
    return states if keep else y


@partial(jax.jit, static_argnames=("solver", "fields", "keep"))
def _on_the_clock(
    solver: Any, fields: OneField, keep: bool, numbers: Any, h: Any, y: Any, dW: Any, _H: Any
) -> Any:
    """Paths of dy = f(y)∘dθ in the random time θ = t + Σ c_j W_j,
    by a solver of ordinary differential equations.
    """
    vector = partial(fields.drift, jnp, numbers)
    return _batched(
        solver, lambda delta: _Field(vector, delta), h, y, h + jnp.einsum("j,njl->nl", numbers[0], dW), keep
    )


@partial(jax.jit, static_argnames=("solver", "fields", "keep"))
def _apart(solver: Any, fields: OneField, keep: bool, numbers: Any, h: Any, y: Any, dW: Any, H: Any) -> Any:
    """Paths with a drift term and a noise term, in one batch; the one noise is Σ c_j W_j,
    which drives f.
    """
    vector, c = partial(fields.drift, jnp, numbers), numbers[0]

    def terms(slice_: Any) -> Any:
        drift = diffrax.ODETerm(lambda _t, y, _args: vector(y))
        return diffrax.MultiTerm(drift, _Noise(vector, *slice_))

    # Σ c_j W_j is √Σc_j² times a Wiener process, and its area is the same combination of areas.
    return _batched(
        solver, terms, h, y, (jnp.einsum("j,njl->nl", c, dW), jnp.einsum("j,njl->nl", c, H)), keep
    )


def _method(name: str, solver: Any, program: Any, evaluations: float | None, how: str) -> Method:
    def run(problem: Problem, y0: Array, h: float, dW: Array, keep: bool) -> Callable[[], Array]:
        fields, numbers = pose_one_field(problem)
        start = np.repeat(y0[:, None], dW.shape[2], axis=1)
        H = np.sqrt(h / 12) * np.random.default_rng(0).standard_normal(dW.shape)
        with enable_x64(True):
            given = jax.tree.map(jnp.asarray, (numbers, np.float64(h), start, np.ascontiguousarray(dW), H))

        def call() -> Array:
            with enable_x64(True):
                states = np.asarray(program(solver, fields, keep, *given))
            return np.concatenate([start[None], states]) if keep else states[None]

        return call

    source = f"diffrax {diffrax.__version__} {type(solver).__name__}, {how}"
    return from_states(name, run, source, evaluations=evaluations)


_CLOCK = "all paths in one state, dy = f∘dθ"
_PARTS_APART = "all paths in one state, drift and noise apart"
_VMAP = "path by path under vmap, drift and noise apart"
# Rows: a solver, the program that drives it, and its evaluations of f per step if the method
# determines them.
_DRIVERS = {
    "heun": ("Heun", _on_the_clock, 2, _CLOCK),
    "tsit5": ("Tsit5", _on_the_clock, 6, _CLOCK),
    "dopri8": ("Dopri8", _on_the_clock, 13, _CLOCK),
    "reversible-heun": ("ReversibleHeun", _on_the_clock, 1, _CLOCK),
    "euler-heun": ("EulerHeun", _apart, None, _PARTS_APART),
    "spark": ("SPaRK", _apart, None, _PARTS_APART),
    "slow-rk": ("SlowRK", _apart, None, _PARTS_APART),
    "heun-vmap": ("Heun", _paths, None, _VMAP),
    "dopri8-vmap": ("Dopri8", _paths, None, _VMAP),
}
# The names of the schemes for the laws.
_SCHEME_SOLVERS = {
    "euler-heun": "EulerHeun", "heun": "Heun", "midpoint": "Midpoint", "ralston": "Ralston",
    "milstein": "StratonovichMilstein", "spark": "SPaRK", "general-shark": "GeneralShARK", "slow-rk": "SlowRK",
    "reversible-heun": "ReversibleHeun",
}  # fmt: skip
_DIFFRAX_SCHEMES = {
    key: _scheme(DIFFRAX_SOLVERS[name], name)
    for key, name in _SCHEME_SOLVERS.items()
    if name in DIFFRAX_SOLVERS
}

PEER = Peer(
    library="diffrax",
    schemes=_DIFFRAX_SCHEMES,
    methods={
        name: _method(f"diffrax-{name}", getattr(diffrax, solver)(), *driver)
        for name, (solver, *driver) in _DRIVERS.items()
        if hasattr(diffrax, solver)
    },
    drawing=tuple(s for key, s in _DIFFRAX_SCHEMES.items() if DIFFRAX_SOLVERS[_SCHEME_SOLVERS[key]].asks),
    absent=tuple(name for name in _SCHEME_SOLVERS.values() if name not in DIFFRAX_SOLVERS),
    integrators=INTEGRATORS,
    solvers=tuple(DIFFRAX_SOLVERS.values()),
)
