"""diffrax's Stratonovich solvers for general noise, one step at a time and over whole paths.
Needs the extra ``peers``.

A step is the solver's own `init` and `step`, compiled by JAX, on a driving path with the given
increment. Polynomial problems are data to the compiled code, so that a new random problem compiles
nothing.

JAX computes in float64 only where its switch is on. JAX's own context manager turns it on around
each call, for one thread; importing this module changes nothing in JAX.

ShARK, SRA1 and SEA need additive noise, and the noise of (1.1) is not additive. ALIGN, ShOULD and
QUICSORT are for Langevin dynamics. Older releases have fewer solvers: a missing one is None here,
and its name is in `PEER.absent`.

In a comparison all paths are one state (d, M) and one compiled loop over given increments. All
noises drive one field, so that most solvers can be given dy = f(y)∘dθ with θ = t + Σ c_j W_j, which
halves the evaluations of f. The other solvers get a drift term and a noise term. Methods with
"vmap" in their names follow diffrax's examples: each path is solved alone with a drift term and a
noise term, and jax.vmap joins the paths.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from operator import itemgetter
from typing import Any

import diffrax
import jax
import jax.numpy as jnp
import numpy as np

from sepv.peers._diffrax_ode import INTEGRATORS
from sepv.peers._jax import enable_x64
from sepv.peers.peer import Peer
from sepv.posing import LANES, Formulas, in_blocks, pose, size
from sepv.problem import Array, PolynomialSystem, Problem
from sepv.schemes import Scheme, StatefulStep
from sepv.studies import Method, from_states


class _Given(diffrax.AbstractPath):
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


def _terms(formulas: Formulas, arrays: Any, c: Any, control: _Given) -> Any:
    """The right side of a step in diffrax's form: the drift f = B∇H,
    and noise fields c_j f as columns (d, m).
    """

    def drift(_t: Any, y: Any, _args: Any) -> Any:
        return formulas.field(jnp, arrays, y)

    def noise(t: Any, y: Any, args: Any) -> Any:
        return jnp.outer(drift(t, y, args), c)

    return diffrax.MultiTerm(diffrax.ODETerm(drift), diffrax.ControlTerm(noise, control))


def _one_step(
    solver: Any, formulas: Formulas, arrays: Any, c: Any, h: Any, y: Any, dW: Any, state: Any
) -> Any:
    """One step of a solver: y_next and the solver's state after it. If `state` is None,
    the solver starts anew.
    """
    levy = isinstance(solver, getattr(diffrax, "AbstractSRK", ()))
    terms = _terms(formulas, arrays, c, _Given(dW, _space_time_area(h, dW) if levy else dW))
    t0 = jnp.zeros_like(h)
    if state is None:
        state = solver.init(terms, t0, h, y, None)
    y_next, _error, _dense, state, _result = solver.step(terms, t0, h, y, None, state, made_jump=False)
    return y_next, state


@partial(jax.jit, static_argnames=("solver", "formulas"))
def _steps(solver: Any, formulas: Formulas, arrays: Any, c: Any, h: Any, y: Any, dW: Any) -> Any:
    """One step from each of L states: y (d, L) with increments dW (m, L)."""

    def lane(y: Any, dW: Any) -> Any:
        return _one_step(solver, formulas, arrays, c, h, y, dW, None)[0]

    return jax.vmap(lane, in_axes=1, out_axes=1)(y, dW), None


@partial(jax.jit, static_argnames=("solver", "formulas", "keep"))
def _paths(
    solver: Any, formulas: Formulas, arrays: Any, c: Any, h: Any, y: Any, dW: Any, keep: bool = True
) -> Any:
    """L whole paths, in which the solver keeps its state: y (d, L), dW (N, m, L) -> (N, d, L),
    or the last states.
    """

    def lane(y: Any, dW: Any) -> Any:
        def advance(carry: Any, dW: Any) -> Any:
            carry = _one_step(solver, formulas, arrays, c, h, carry[0], dW, carry[1])
            return carry, carry[0] if keep else None

        first = _one_step(solver, formulas, arrays, c, h, y, dW[0], None)
        last, rest = jax.lax.scan(advance, first, dW[1:])
        return jnp.concatenate([first[0][None], rest]) if keep else last[0]

    return jax.vmap(lane, in_axes=(1, 2), out_axes=-1)(y, dW)


_next = jax.jit(_one_step, static_argnames=("solver", "formulas"))


def _wide(rows: Array, count: int) -> Array:
    """Pad an array (…, n, L) or (n,) with zeros, so that n becomes `count`."""
    axis = max(rows.ndim - 2, 0)
    missing = (*rows.shape[:axis], count - rows.shape[axis], *rows.shape[axis + 1 :])
    return np.concatenate([rows, np.zeros(missing)], axis=axis)


def _call(
    program: Any, solver: Any, problem: Problem, y: Array, h: float, dW: Array, *state: Any
) -> tuple[Any, Any]:
    """Run a compiled `program` in float64 on y (d, L), dW (m, L) or (d,), (m,);
    return y_next and solver state.
    """
    formulas, numbers = pose(problem, wide=True)
    d, m = problem.dimension, problem.noises
    if formulas.kind == "polynomial":
        y, dW = _wide(y, formulas.width), _wide(dW, size(m, 4))
    c = _wide(problem.c, dW.shape[0])
    with enable_x64(True):
        y_next, own = program(solver, formulas, numbers, c, np.float64(h), y, dW, *state)
        return np.asarray(y_next)[:d], own


def _step_by(solver: Any) -> Callable[[Problem, Array, float, Array], Array]:
    def step(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        # The laws step one state of each random problem, and batches of the paper's problems.
        lanes = 1 if isinstance(problem.data, PolynomialSystem) else LANES
        return in_blocks(lambda y, dW: _call(_steps, solver, problem, y, h, dW)[0], y, dW, lanes)

    return step


def _stateful(solver: Any) -> StatefulStep:
    """The step, on one path at a time, of a solver with a state of its own,
    which is kept from step to step.
    """

    def step(problem: Problem, state: tuple[Array, Any], h: float, dW: Array) -> tuple[Array, Any]:
        return _call(_next, solver, problem, state[0], h, dW, state[1])

    return StatefulStep(lambda _, y: (y, None), step, itemgetter(0))


_absent: list[str] = []


def _scheme(name: str, order: float, weak: float = 1.0, batched: bool = True) -> Any:
    """The diffrax solver called `name` as a `Scheme` of strong order `order`;
    None if this release does not have it.
    """
    make = getattr(diffrax, name, None)
    if make is None:
        _absent.append(name)
        return None
    return Scheme(
        name=f"diffrax {name}", step=_step_by(make()) if batched else _stateful(make()), mean_square_order=order,
        source=f'diffrax, "SDE solver table": order {order:g} strong and {weak:g} weak for commutative noise',
        weak_order=weak, truncation=None, batched=batched,
    )  # fmt: skip


euler_heun = _scheme("EulerHeun", 0.5)
heun = _scheme("Heun", 1.0)
midpoint = _scheme("Midpoint", 1.0)
ralston = _scheme("Ralston", 1.0)
milstein = _scheme("StratonovichMilstein", 1.0)
spark = _scheme("SPaRK", 1.0)
general_shark = _scheme("GeneralShARK", 1.0)
slow_rk = _scheme("SlowRK", 1.5, 2.0)
# The solver's state holds a second solution beside y.
reversible_heun = _scheme("ReversibleHeun", 1.0, batched=False)


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


@partial(jax.jit, static_argnames=("solver", "formulas", "keep"))
def _on_the_clock(
    solver: Any, formulas: Formulas, keep: bool, arrays: Any, c: Any, h: Any, y: Any, dW: Any, _H: Any
) -> Any:
    """Paths of dy = f(y)∘dθ in the random time θ = t + Σ c_j W_j,
    by a solver of ordinary differential equations.
    """

    def vector(y: Any) -> Any:
        return formulas.field(jnp, arrays, y)

    return _batched(
        solver, lambda delta: _Field(vector, delta), h, y, h + jnp.einsum("j,njl->nl", c, dW), keep
    )


@partial(jax.jit, static_argnames=("solver", "formulas", "keep"))
def _apart(
    solver: Any, formulas: Formulas, keep: bool, arrays: Any, c: Any, h: Any, y: Any, dW: Any, H: Any
) -> Any:
    """Paths with a drift term and a noise term, in one batch; the one noise is Σ c_j W_j,
    which drives f.
    """

    def vector(y: Any) -> Any:
        return formulas.field(jnp, arrays, y)

    def terms(slice_: Any) -> Any:
        drift = diffrax.ODETerm(lambda _t, y, _args: vector(y))
        return diffrax.MultiTerm(drift, _Noise(vector, *slice_))

    # Σ c_j W_j is √Σc_j² times a Wiener process, and its area is the same combination of areas.
    return _batched(
        solver, terms, h, y, (jnp.einsum("j,njl->nl", c, dW), jnp.einsum("j,njl->nl", c, H)), keep
    )


def _vmapped(solver: Any, formulas: Formulas, keep: bool, *given: Any) -> Any:
    """Paths with a drift term and a noise term, each solved alone and joined by jax.vmap,
    as in diffrax's examples.
    """
    return _paths(solver, formulas, *given[:-1], keep=keep)


def _method(name: str, solver: Any, program: Any, evaluations: float | None, how: str) -> Method:
    def run(problem: Problem, y0: Array, h: float, dW: Array, keep: bool) -> Callable[[], Array]:
        formulas, numbers = pose(problem, padded=False)
        start = np.repeat(y0[:, None], dW.shape[2], axis=1)
        H = np.sqrt(h / 12) * np.random.default_rng(0).standard_normal(dW.shape)
        with enable_x64(True):
            given = jax.tree.map(
                jnp.asarray, (numbers, problem.c, np.float64(h), start, np.ascontiguousarray(dW), H)
            )

        def call() -> Array:
            with enable_x64(True):
                states = np.asarray(program(solver, formulas, keep, *given))
            return np.concatenate([start[None], states]) if keep else states[None]

        return call

    source = f"diffrax {diffrax.__version__} {type(solver).__name__}, {how}"
    return from_states(name, run, source, evaluations=evaluations)


_CLOCK = "all paths in one state, dy = f∘dθ"
_APART = "all paths in one state, drift and noise apart"
_VMAP = "path by path under vmap, drift and noise apart"
# Rows: a solver, the program that drives it, and its evaluations of f per step if the method
# determines them.
_DRIVEN = {
    "heun": ("Heun", _on_the_clock, 2, _CLOCK),
    "tsit5": ("Tsit5", _on_the_clock, 6, _CLOCK),
    "dopri8": ("Dopri8", _on_the_clock, 13, _CLOCK),
    "reversible-heun": ("ReversibleHeun", _on_the_clock, 1, _CLOCK),
    "euler-heun": ("EulerHeun", _apart, None, _APART),
    "spark": ("SPaRK", _apart, None, _APART),
    "slow-rk": ("SlowRK", _apart, None, _APART),
    "heun-vmap": ("Heun", _vmapped, None, _VMAP),
    "dopri8-vmap": ("Dopri8", _vmapped, None, _VMAP),
}
_SCHEMES = {
    "euler-heun": euler_heun, "heun": heun, "midpoint": midpoint, "ralston": ralston, "milstein": milstein,
    "spark": spark, "general-shark": general_shark, "slow-rk": slow_rk, "reversible-heun": reversible_heun,
}  # fmt: skip

PEER = Peer(
    library="diffrax",
    schemes={name: scheme for name, scheme in _SCHEMES.items() if scheme is not None},
    methods={
        name: _method(f"diffrax-{name}", getattr(diffrax, solver)(), *driver)
        for name, (solver, *driver) in _DRIVEN.items()
        if hasattr(diffrax, solver)
    },
    drawing=tuple(scheme for scheme in (spark, general_shark, slow_rk) if scheme is not None),
    absent=tuple(_absent),
    integrators=INTEGRATORS,
)
