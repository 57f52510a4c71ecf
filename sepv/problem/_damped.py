"""Linear damping: dy = (B(y)∇H − γy) dt + Σ_j c_j B(y)∇H ∘dW_j, the conformal systems of arXiv 2503.01540 with one H.

Stratonovich's rule is the chain rule. The terms with B∇H leave H and every Casimir C alone, so that, along each path,

    dH = −γ yᵀ∇H dt,    dC = −γ yᵀ∇C dt:    a homogeneous F of degree p decays as F(y(t)) = e^{−pγt}F(y(0)).

Of a quadratic Casimir that is e^{−2γt}, of a linear one e^{−γt} (Euler's theorem on homogeneous functions). With B
homogeneous of degree β, H of degree p and κ = β + p − 2, y = e^{−γt}u has du = e^{−κγt}f(u)(dt + Σ c_j ∘dW_j):

    y(t) = e^{−γt} φ_{θ(t)}(y(0)),    θ(t) = ∫₀ᵗ e^{−κγs}(ds + Σ_j c_j dW_j(s)),

φ the flow of f = B∇H: a solution that needs the whole path.
"""

from __future__ import annotations

from dataclasses import dataclass

from sepv._arguments import is_number
from sepv.errors import ProblemError, Skipped, SystemsError
from sepv.problem._problem import Array, Problem


@dataclass(frozen=True, eq=False)
class DampedProblem(Problem):
    """A system (1.1) with linear damping, dy = (B∇H − γy) dt + Σ_j c_j B∇H ∘dW_j; `casimirs` are those of B.

    Parameters
    ----------
    damping : float
        The rate γ.

    Raises
    ------
    ProblemError
        As for `Problem`, and where γ is not a finite number.
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

    def random_step(self, h: float, dW: Array) -> Array:  # noqa: ARG002  (the signature of `Problem`)
        """Raise SystemsError: with damping a step is not one of a random length alone."""
        raise SystemsError(
            expected="a scheme for damped systems, such as conformal",
            received=f"a scheme for (1.1), which would leave out the damping of {self.name}",
            remedy="use a scheme with systems='damped'",
        )


def require_undamped(problem: Problem) -> None:
    """Raise Skipped for a damped problem: a formula without a term for damping would leave it out."""
    if damping_of(problem):
        raise Skipped(f"the scheme leaves out the damping of {problem.name}")


def damping_of(problem: Problem) -> float:
    """The rate γ of a problem's damping −γy dt; zero for a problem without damping."""
    return float(getattr(problem, "damping", 0.0))
