"""Linear damping, dy = (B(y)∇H − γy) dt + Σ_j c_j B(y)∇H ∘dW_j: systems of arXiv 2503.01540 with all H_j equal to H.

In Stratonovich's form the chain rule holds, and the terms with B∇H change neither H nor a Casimir C. So on each path

    dH = −γ yᵀ∇H dt,    dC = −γ yᵀ∇C dt.

If F = H or F = C is homogeneous of degree p, yᵀ∇F = pF, and F decays as e^{−pγt}. Let B be homogeneous of degree β, H
of degree p, and κ = β + p − 2. Then u = e^{γt}y satisfies du = e^{−κγt}f(u)(dt + Σ c_j ∘dW_j), so that

    y(t) = e^{−γt} φ_{θ(t)}(y(0)),    θ(t) = ∫₀ᵗ e^{−κγs}(ds + Σ_j c_j dW_j(s)),

where φ is the flow of f = B∇H. This solution depends on the whole Wiener path, and not on its end alone.
"""

from __future__ import annotations

from dataclasses import dataclass

from sepv._arguments import is_number
from sepv.core.arrays import Array
from sepv.errors import ProblemError, SystemsError
from sepv.problem._problem import Problem


@dataclass(frozen=True, eq=False, repr=False)
class DampedProblem(Problem):
    """A system (1.1) with linear damping, dy = (B∇H − γy) dt + Σ_j c_j B∇H ∘dW_j; `casimirs` are those of B.

    Parameters
    ----------
    damping : float
        The rate γ.

    Raises
    ------
    ProblemError
        As for `Problem`, and if γ is not a finite number.
    """

    damping: float = 0.0

    def __post_init__(self, check: bool) -> None:
        super().__post_init__(check)
        if not is_number(self.damping):
            raise ProblemError(
                expected="damping: a finite number γ",
                received=f"{self.damping!r:.80}",
                remedy="give the rate of −γy dt, such as damping=0.5",
            )
        self._checked_invariants(check)

    def random_step(self, h: float, dW: Array) -> Array:  # noqa: ARG002  (the signature of `Problem`)
        """Raise SystemsError: a damped step depends on h, and not on Δ = h + Σ c_jΔW_j alone."""
        raise SystemsError(
            expected="a scheme for damped systems, such as conformal",
            received=f"a scheme for (1.1), which would leave out the damping of {self.name}",
            remedy="use a scheme with systems='damped'",
        )


def damping_of(problem: Problem) -> float:
    """The rate γ of a problem's damping −γy dt; zero for a problem without damping."""
    return float(problem.damping)
