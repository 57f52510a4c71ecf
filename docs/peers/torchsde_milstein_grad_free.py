"""torchsde milstein grad_free: strong order ½, where the source declares 1.0.

For dy = √(1 + y²) ∘dW from 0 the exact solution is y = sinh W. When the step is quartered the error should fall by 4,
and comes to fall by 2; so does its mean. The one-sided difference (g(y + g√h) − g(y))/(2√h) · ΔW² contains ¼ g″(g, g)
√h ΔW², whose mean is of order h^1.5 in each step. (In the Itô form it is multiplied by ΔW² − h, which has mean zero.)
In StochasticDiffEq.jl such a difference had order ½ as well, and was mended (SciML/StochasticDiffEq.jl, issue 19,
2017-08-18).

Exit code 1 while this is so, 0 where the error falls as declared.
"""

import sys

import torch
import torchsde

NOTES = [
    (
        "DOCUMENTATION.md of 0.2.6, list of SDE solvers; it states no orders (github.com/google-research/torchsde)",
        "2023-09-26",
        "Additionally, gradient-free Milstein can be used by selecting Milstein, and then also passing in the keyword "
        "argument `sdeint(..., options=dict(grad_free=True))`.",
    ),
    ("source of 0.2.6, torchsde/_core/methods/milstein.py", "2023-09-26", "strong_order = 1.0"),
    (
        "source of 0.2.6, torchsde/_core/methods/milstein.py, comment on the difference",
        "2023-09-26",
        "TODO: This y_prime_f_factor looks unnecessary: whether it's there or not we get the correct Taylor expansion. "
        "I've (Patrick) not been able to find a reference making clear why it's sometimes included.",
    ),
    (
        "pull request 31, description by its author",
        "2020-08-18",
        "I think that usage of grad-free variant changes order to 0.5, right? (I can `if` it in code)",
    ),
    ("pull request 31, its author in the review", "2020-08-19", "But with those fixes slope is still 0.6"),
]


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
