"""diffrax's solvers under the best driver we know, for `sepv compare`. Needs the extra ``peers``.

All paths are one state (d, M) and one compiled loop over the given increments, which lie on the device beforehand. All
noises drive one field, so that a solver that needs nothing but products of a field with an increment is given the
equation as what it is, dy = f(y)∘dθ with θ = t + Σ c_j W_j: half the evaluations of a drift and a noise posed apart.
Names with vmap are the driver of diffrax's own examples, one path at a time under `jax.vmap`, drift and noise apart.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import diffrax
import jax
import jax.numpy as jnp
import numpy as np

from sepv.peers.diffrax import _paths
from sepv.peers.posing import Formulas, pose
from sepv.problem import Array, Problem
from sepv.studies._compare.method import Method, from_states


class _Field(diffrax.AbstractTerm):
    """f(y) for a batch (d, M), multiplied by an increment (M,) of its clock."""

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
    """The same field under a Wiener process (M,) beside a drift term, with its space-time Lévy area."""

    area: Any

    def contr(self, t0: Any, t1: Any, **options: Any) -> Any:
        if options.get("use_levy"):
            return diffrax.SpaceTimeLevyArea(dt=t1 - t0, W=self.increment, H=self.area)
        return self.increment


def _batched(solver: Any, terms: Any, h: Any, y: Any, more: Any, keep: bool) -> Any:
    """A loop over increments: `terms` makes the terms of a step of its slice of `more`."""
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
    """dy = f(y)∘dθ, for solvers of ordinary differential equations."""

    def vector(y: Any) -> Any:
        return formulas.field(jnp, arrays, y)

    return _batched(
        solver, lambda delta: _Field(vector, delta), h, y, h + jnp.einsum("j,njl->nl", c, dW), keep
    )


@partial(jax.jit, static_argnames=("solver", "formulas", "keep"))
def _apart(
    solver: Any, formulas: Formulas, keep: bool, arrays: Any, c: Any, h: Any, y: Any, dW: Any, H: Any
) -> Any:
    """Drift and noise apart, the m noises as the one that they are, in one batch."""

    def vector(y: Any) -> Any:
        return formulas.field(jnp, arrays, y)

    def terms(slice_: Any) -> Any:
        drift = diffrax.ODETerm(lambda _t, y, _args: vector(y))
        return diffrax.MultiTerm(drift, _Noise(vector, *slice_))

    # Σ c_j W_j is √Σc_j² times a Wiener process, and its area the same combination of theirs.
    return _batched(
        solver, terms, h, y, (jnp.einsum("j,njl->nl", c, dW), jnp.einsum("j,njl->nl", c, H)), keep
    )


def _vmapped(solver: Any, formulas: Formulas, keep: bool, *given: Any) -> Any:
    """Path by path under vmap, as diffrax's examples do."""
    return _paths(solver, formulas, *given[:-1], keep=keep)


def _method(name: str, solver: Any, program: Any, evaluations: float | None, how: str) -> Method:
    def run(problem: Problem, y0: Array, h: float, dW: Array, keep: bool) -> Callable[[], Array]:
        formulas, numbers = pose(problem, padded=False)
        start = np.repeat(y0[:, None], dW.shape[2], axis=1)
        H = np.sqrt(h / 12) * np.random.default_rng(0).standard_normal(dW.shape)
        with jax.enable_x64(True):
            given = jax.tree.map(
                jnp.asarray, (numbers, problem.c, np.float64(h), start, np.ascontiguousarray(dW), H)
            )

        def call() -> Array:
            with jax.enable_x64(True):
                found = np.asarray(program(solver, formulas, keep, *given))
            return np.concatenate([start[None], found]) if keep else found[None]

        return call

    source = f"diffrax {diffrax.__version__} {type(solver).__name__}, {how}"
    return from_states(name, run, source, evaluations=evaluations)


_CLOCK = "all paths in one state, dy = f∘dθ"
_APART = "all paths in one state, drift and noise apart"
_VMAP = "path by path under vmap, drift and noise apart"

heun = _method("diffrax-heun", diffrax.Heun(), _on_the_clock, 2, _CLOCK)
tsit5 = _method("diffrax-tsit5", diffrax.Tsit5(), _on_the_clock, 6, _CLOCK)
dopri8 = _method("diffrax-dopri8", diffrax.Dopri8(), _on_the_clock, 13, _CLOCK)
reversible_heun = _method("diffrax-reversible-heun", diffrax.ReversibleHeun(), _on_the_clock, 1, _CLOCK)
euler_heun = _method("diffrax-euler-heun", diffrax.EulerHeun(), _apart, None, _APART)
spark = _method("diffrax-spark", diffrax.SPaRK(), _apart, None, _APART)
slow_rk = _method("diffrax-slow-rk", diffrax.SlowRK(), _apart, None, _APART)
heun_vmap = _method("diffrax-heun-vmap", diffrax.Heun(), _vmapped, None, _VMAP)
dopri8_vmap = _method("diffrax-dopri8-vmap", diffrax.Dopri8(), _vmapped, None, _VMAP)
