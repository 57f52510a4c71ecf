"""Hypothesis strategies for random Poisson systems and steps,
for your own tests (docs/random-systems.md).
"""

from sepv.law.strategies import (
    CONTRACTION,
    any_steps,
    casimir_systems,
    coefficients,
    hamiltonians,
    noises,
    paper_problems,
    paper_steps,
    poisson_systems,
    polynomials,
    skew_structures,
    steps,
)

__all__ = [
    "CONTRACTION", "any_steps", "casimir_systems", "coefficients", "hamiltonians", "noises", "paper_problems",
    "paper_steps", "poisson_systems", "polynomials", "skew_structures", "steps",
]  # fmt: skip
