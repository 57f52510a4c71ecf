"""torchsde's Stratonovich solvers, one step at a time and in batches of whole paths.
Needs the extra ``peers``.

torchsde has no public step. A step here is `torchsde.sdeint` over (0, h) with dt = h and a Brownian
motion that returns the given increment.

torchsde's noise type is "scalar" for one noise and "general" for several. Milstein does not support
the general type. It gets the one Wiener process c·W/|c|, which drives the same equation. Lévy areas
are zero here: all noises drive one field, so the commutators that areas multiply vanish. In a
comparison all paths are one batch of `torchsde.sdeint` over the whole interval.
"""

from __future__ import annotations

from collections.abc import Callable
from operator import itemgetter
from typing import Any

import numpy as np
import torch
import torchsde

from sepv.errors import Skipped
from sepv.peers.peer import Peer
from sepv.posing import LANES, in_blocks, pose
from sepv.problem import Array, Problem
from sepv.schemes import Scheme, StatefulStep
from sepv.studies import Method, from_states


class _System(torch.nn.Module):
    """The system dy = f dt + Σ_j weights_j f ∘dW_j in torchsde's interface, for L states y
    (L, d).
    """

    sde_type = "stratonovich"

    def __init__(self, problem: Problem, weights: Any, noise_type: str) -> None:
        super().__init__()
        self.weights, self.noise_type = weights, noise_type
        self.formulas, numbers = pose(problem, padded=False)
        self.numbers = tuple(torch.as_tensor(a) for a in numbers)

    def f(self, _t: Any, y: Any) -> Any:
        return self.formulas.field(torch, self.numbers, y.T).T

    def g(self, t: Any, y: Any) -> Any:
        return self.f(t, y)[:, :, None] * self.weights


class Given(torchsde.BaseBrownian):
    """A Brownian motion with given increments (N, L, m) over N equal steps of length h,
    and no Lévy area.
    """

    levy_area_approximation = "foster"
    dtype, device = torch.float64, torch.device("cpu")

    def __init__(self, increments: Any, h: float) -> None:
        self.increments, self.h = increments, h

    @property
    def shape(self) -> Any:
        """The shape of one increment, which torchsde asks for."""
        return self.increments.shape[1:]

    def __repr__(self) -> str:
        return f"given increments of shape {tuple(self.increments.shape)}"

    def __call__(self, ta: Any, tb: Any = None, return_U: bool = False, return_A: bool = False) -> Any:
        """The increment of the step that starts at time ta; if `return_A`, also Lévy areas,
        which are zero.
        """
        del tb, return_U
        dW = self.increments[round(float(ta) / self.h)]
        return (dW, dW.new_zeros((*dW.shape, dW.shape[-1]))) if return_A else dW


def _solved(
    method: str, options: dict[str, Any], problem: Problem, y: Array, h: float, dW: Array, **more: Any
) -> Any:
    """Call torchsde.sdeint from y (d, L) with increments dW (N, m, L);
    the result is a tensor (N + 1, L, d).
    """
    weights, noise_type = problem.c, "scalar" if problem.noises == 1 else "general"
    if problem.noises != 1 and method == "milstein":
        size = float(np.linalg.norm(weights))
        dW = np.einsum("j,njl->nl", weights / size if size else weights, dW)[:, None]
        weights, noise_type = np.array([size]), "scalar"
    system = _System(problem, torch.as_tensor(weights.copy()), noise_type)
    noise = Given(torch.as_tensor(np.ascontiguousarray(dW.transpose(0, 2, 1))), h)
    times = torch.arange(len(dW) + 1, dtype=torch.float64) * h
    with torch.no_grad():
        start = torch.as_tensor(np.ascontiguousarray(y.T))
        return torchsde.sdeint(system, start, times, bm=noise, method=method, dt=h, options=options, **more)


def _positive(h: float) -> None:
    if not h > 0:
        raise Skipped("torchsde wants times that increase: h > 0")


def _step_by(method: str, options: dict[str, Any]) -> Callable[[Problem, Array, float, Array], Array]:
    def step(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        _positive(h)

        def block(y: Array, dW: Array) -> Any:
            return _solved(method, options, problem, y, h, dW[None])[-1].numpy().T.copy()

        return in_blocks(block, y, dW, LANES)

    return step


def _handed_on(problem: Problem, state: tuple[Array, Any], h: float, dW: Array) -> tuple[Array, Any]:
    """One step of reversible Heun on one path, from `state`: y (d,),
    and the solver's state as torchsde returns it.
    """
    _positive(h)
    more = {"extra": True, "extra_solver_state": state[1]}
    states, own = _solved("reversible_heun", {}, problem, state[0][:, None], h, dW[None, :, None], **more)
    return states[-1, 0].numpy().copy(), own


def _source(order: float, note: str = "") -> str:
    return f"torchsde, the solver's strong_order {order:g} for scalar noise and weak_order 1{note}"


def _scheme(method: str, order: float = 1.0, note: str = "", name: str = "", **options: Any) -> Scheme:
    return Scheme(
        name=f"torchsde {name or method}", step=_step_by(method, options), mean_square_order=order, weak_order=1.0,
        source=_source(order, note), truncation=None, batched=True,
    )  # fmt: skip


_SEVERAL = "; strong_order 0.5 for general noise, and 1 if the noise commutes"

euler_heun = _scheme("euler_heun", note=_SEVERAL)
heun = _scheme("heun", note=_SEVERAL)
midpoint = _scheme("midpoint", note=_SEVERAL)
log_ode = _scheme("log_ode", note=_SEVERAL)
milstein = _scheme("milstein")
milstein_grad_free = _scheme("milstein", name="milstein grad_free", grad_free=True)
# The solver's state holds a second solution beside y.
reversible_heun = Scheme(
    name="torchsde reversible_heun", step=StatefulStep(lambda _, y: (y, None), _handed_on, itemgetter(0)),
    mean_square_order=0.5, weak_order=1.0, source=_source(0.5), truncation=None,
)  # fmt: skip


def _method(method: str) -> Method:
    def run(problem: Problem, y0: Array, h: float, dW: Array, keep: bool) -> Callable[[], Array]:
        # Several noises of one field act as the one process Σ c_j W_j.
        system = _System(problem, torch.ones(1, dtype=torch.float64), "scalar")
        sums = np.einsum("j,njl->nl", problem.c, dW)[:, :, None]
        noise = Given(torch.as_tensor(sums), h)
        y = torch.as_tensor(np.repeat(y0[None], dW.shape[2], axis=0))
        grid = torch.arange(len(dW) + 1, dtype=torch.float64) * h
        times = grid if keep else grid[[0, -1]]

        def call() -> Array:
            with torch.no_grad():
                states: Any = torchsde.sdeint(system, y, times, bm=noise, method=method, dt=h)
            return np.asarray(states.numpy().transpose(0, 2, 1))

        return call

    source = f"torchsde {torchsde.__version__} {method}, all paths in one batch"
    return from_states(f"torchsde-{method.replace('_', '-')}", run, source, called_each_step=True)


PEER = Peer(
    library="torchsde",
    schemes={
        "euler-heun": euler_heun, "heun": heun, "midpoint": midpoint, "log-ode": log_ode, "milstein": milstein,
        "milstein-grad-free": milstein_grad_free, "reversible-heun": reversible_heun,
    },
    methods={name.replace("_", "-"): _method(name) for name in ("heun", "midpoint", "reversible_heun")},
)  # fmt: skip
