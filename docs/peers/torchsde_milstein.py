"""torchsde milstein: with scalar noise and several components, not the Stratonovich solution.

torchsde declares strong order 1.0 for it (`strong_order` of the solver). For dy = Jy ∘dW with J a quarter turn, the
exact solution is y0 turned by the angle W(T). The error does not decrease. The default, which differentiates g by
itself, adds ½ΔW² (∂g/∂y)ᵀg where Milstein's term is ½ΔW² (∂g/∂y)g: a vector-Jacobian product in the place of a
Jacobian-vector product. For one component both are the same.

Exit code 1 while this is so, 0 where the error falls as declared.
"""

import sys

import torch
import torchsde


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
