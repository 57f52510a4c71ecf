"""torchsde milstein: with scalar noise and several components, not the Stratonovich solution.

For dy = Jy ∘dW with J a quarter turn, the exact solution is y0 turned by the angle W(T). The error does not decrease.
The default, which differentiates g by itself, adds ½ΔW² (∂g/∂y)ᵀg where Milstein's term is ½ΔW² (∂g/∂y)g: a
vector-Jacobian product in the place of a Jacobian-vector product. For one component both are the same, and so they
are where ∂g/∂y is symmetric, as in ExScalar of the library's tests.

Exit code 1 while this is so, 0 where the error falls as declared.
"""

import sys

import torch
import torchsde

NOTES = [
    (
        "DOCUMENTATION.md of 0.2.6, list of SDE solvers; it states no orders (github.com/google-research/torchsde)",
        "2023-09-26",
        "Note that Milstein and SRK don't support general noise.",
    ),
    ("source of 0.2.6, torchsde/_core/methods/milstein.py", "2023-09-26", "strong_order = 1.0"),
    (
        "source of 0.2.6, torchsde/_core/base_sde.py, comment on the term that is computed",
        "2023-09-26",
        "Computes: g_prod and sum_{j, l} g_{j, l} d g_{j, l} d x_i v2_l.",
    ),
    (
        "pull request 31, description by its author",
        "2020-08-18",
        "I will finish writing diagnostics when fix for `gdg_prod` bug is merged.",
    ),
]


class Rotation(torch.nn.Module):
    noise_type, sde_type = "scalar", "stratonovich"

    def f(self, _t, y):
        return torch.zeros_like(y)

    def g(self, _t, y):
        return torch.stack([-y[:, 1], y[:, 0]], dim=1).unsqueeze(-1)


y0 = torch.tensor([[1.0, 0.0]], dtype=torch.float64).repeat(2000, 1)
errors = {}
for method in ("heun", "milstein"):
    for steps in (16, 64, 256):
        W = torchsde.BrownianInterval(0.0, 1.0, size=(2000, 1), dtype=torch.float64, entropy=1, dt=1 / steps)
        y = torchsde.sdeint(Rotation(), y0, [0.0, 1.0], bm=W, method=method, dt=1 / steps)[-1]
        angle = W(0.0, 1.0)[:, 0]
        exact = torch.stack([angle.cos(), angle.sin()], dim=1)
        errors[method, steps] = (y - exact).square().sum(dim=1).mean().sqrt().item()
        print(
            f"torchsde {torchsde.__version__} {method:8} {steps:4} steps: rms error {errors[method, steps]:.4f}"
        )
sys.exit(errors["milstein", 256] > errors["milstein", 16] / 2)
