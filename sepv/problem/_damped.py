"""Linear damping, dy = (B(y)∇H − γy) dt + Σ_j c_j B(y)∇H ∘dW_j:
systems of arXiv 2503.01540 with all H_j equal to H.

In Stratonovich's form the chain rule holds, and the terms with B∇H change neither H nor a
Casimir C. So on each path

    dH = −γ yᵀ∇H dt,    dC = −γ yᵀ∇C dt.

If F = H or F = C is homogeneous of degree p, yᵀ∇F = pF, and F decays as e^{−pγt}. Let B
be homogeneous of degree β, H of degree p, and κ = β + p − 2. Then u = e^{γt}y satisfies
du = e^{−κγt}f(u)(dt + Σ c_j ∘dW_j), so that

    y(t) = e^{−γt} φ_{θ(t)}(y(0)),    θ(t) = ∫₀ᵗ e^{−κγs}(ds + Σ_j c_j dW_j(s)),

where φ is the flow of f = B∇H. This solution depends on the whole Wiener path, and not on its end
alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sepv._arguments import is_number
from sepv.core.arrays import EPS, Array
from sepv.core.problem import Channel
from sepv.errors import ProblemError
from sepv.problem._data import Matrix
from sepv.problem._facts import damping_matrix
from sepv.problem._problem import Problem


@dataclass(frozen=True, eq=False, repr=False)
class DampedProblem(Problem):
    """A system (1.1) with linear damping, dy = (B∇H − γy) dt + Σ_j c_j B∇H ∘dW_j;
    `casimirs` are those of B.

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

    def _channels(self) -> tuple[Channel, ...]:
        own, *noises = super()._channels()
        return (own._replace(damping=self.damping), *noises)


def conformal_rate(problem: Problem, y: Array) -> float | None:
    """The number κ with ΓB + BΓᵀ = κB for the constant B of a problem, read at a state y;
    None if there is none.

    Then the flow of B∇H − Γy has φ′Bφ′ᵀ = e^{−κt}B (R. McLachlan and M. Perlmutter, J. Geom.
    Phys. 39, 2001): d/dt of φ′Bφ′ᵀ is (BH″ − Γ)X + X(BH″ − Γ)ᵀ with X = φ′Bφ′ᵀ, which is −κX for
    X = e^{−κt}B. For −γy κ is 2γ, for −γp it is γ.
    """
    Gamma, B = damping_matrix(problem), problem.structure(y)
    both, size = Gamma @ B + B @ Gamma.T, np.abs(Gamma) @ np.abs(B)
    if not both.any():
        return 0.0
    at = np.unravel_index(int(np.argmax(np.abs(both))), both.shape)
    kappa = float(both[at] / B[at]) if B[at] else np.nan
    return kappa if np.all(np.abs(both - kappa * B) <= 4 * EPS * np.max(size + size.T)) else None


def scaled_damping(damping: float | Matrix, factor: float) -> float | Matrix:
    """The damping γ or Γ of a `PolynomialSystem`, times `factor`."""
    if isinstance(damping, tuple):
        return tuple(tuple(factor * v for v in row) for row in damping)
    return factor * damping
