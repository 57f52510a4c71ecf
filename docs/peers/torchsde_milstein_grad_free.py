"""torchsde milstein grad_free: strong order ½, not the declared 1.0.

torchsde declares strong order 1.0 for it (`strong_order` of the solver). For dy = √(1 + y²) ∘dW from 0 the exact
solution is y = sinh W. When the step is quartered the error should fall by 4, and comes to fall by 2; so does its
mean. The one-sided difference (g(y + g√h) − g(y))/(2√h) · ΔW² contains ¼ g″(g, g) √h ΔW², whose mean is of order
h^1.5 in each step. (In the Itô form it is multiplied by ΔW² − h, which has mean zero.)

Exit code 1 while this is so, 0 where the error falls as declared.
"""

import sys

import torch
import torchsde


class Hyperbolic(torch.nn.Module):
    noise_type, sde_type = "scalar", "stratonovich"

    def f(self, _t, y):
        return torch.zeros_like(y)

    def g(self, _t, y):
        return torch.sqrt(1 + y * y).unsqueeze(-1)


y0 = torch.zeros(2000, 1, dtype=torch.float64)
errors = {}
for grad_free in (False, True):
    for steps in (16, 64, 256):
        W = torchsde.BrownianInterval(0.0, 1.0, size=(2000, 1), dtype=torch.float64, entropy=1, dt=1 / steps)
        options = {"grad_free": grad_free}
        y = torchsde.sdeint(
            Hyperbolic(), y0, [0.0, 1.0], bm=W, method="milstein", dt=1 / steps, options=options
        )
        error = y[-1] - W(0.0, 1.0).sinh()
        errors[grad_free, steps] = error.square().mean().sqrt().item()
        print(
            f"torchsde {torchsde.__version__} milstein, grad_free={grad_free!s:5} {steps:4} steps: "
            f"rms error {errors[grad_free, steps]:.4f}, mean error {error.mean().item():+.4f}"
        )
sys.exit(errors[True, 256] > errors[True, 64] / 3)
