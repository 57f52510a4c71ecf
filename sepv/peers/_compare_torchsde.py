"""torchsde's solvers under the best driver we know, for `sepv compare`. Needs the extra ``peers``.

All paths are one batch of `torchsde.sdeint` over the whole interval, with given increments in torch's arrays.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import torch
import torchsde

from sepv.peers.torchsde import Given, _System
from sepv.problem import Array, Problem
from sepv.studies._compare.method import Method, from_states


def _method(method: str) -> Method:
    def run(problem: Problem, y0: Array, h: float, dW: Array, keep: bool) -> Callable[[], Array]:
        # Several noises of one field are the one process Σ c_j W_j.
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
    return from_states(f"torchsde-{method.replace('_', '-')}", run, source)


heun = _method("heun")
midpoint = _method("midpoint")
reversible_heun = _method("reversible_heun")
