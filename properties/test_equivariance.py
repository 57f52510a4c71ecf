"""Affine covariance of (2.1): the change of variables z = Py + b, with PBPᵀ in place of B,
commutes with the step.
"""

from __future__ import annotations

import numpy as np

from sepv import problems
from sepv.law import Case, Cases, Effort, Measurement, Middle, require, searched, state_ulp, step_residual
from sepv.law.contraction import contraction_radius, has_majorants
from sepv.law.tolerance import CONTRACTION, correction_rounding
from sepv.problem import Array, PolynomialSystem
from sepv.problems import nambu_system
from sepv.record import Polynomial, poly
from sepv.schemes import Scheme, ask


def transformations(y: Array) -> list[tuple[str, Array, Array, Array]]:
    """Return (name, P, P⁻¹, b) of dyadic maps Py + b: axes reversed with a sign, a scaling,
    a shear, translations.

    Translations b are as long as y, because longer ones make H in the new variables a sum of large
    terms that cancel.
    """
    d, size = len(y), float(np.max(np.abs(y)))
    reversal = np.eye(d)[::-1].copy()
    reversal[0] *= -1
    scaling = np.diag([2.0 if k == 0 else 1.0 for k in range(d)])
    shear, back = np.eye(d), np.eye(d)
    shear[0, 1], back[0, 1] = 1.0, -1.0
    none = np.zeros(d)
    unit = 2.0 ** np.floor(np.log2(size)) if size else 0.0
    b = unit * np.array([(0.5, -0.25, 1.0)[k % 3] for k in range(d)])
    linear = [
        ("reversed axes", reversal, reversal.T.copy(), none),
        ("y1 doubled", scaling, np.linalg.inv(scaling), none),
        ("y1 + y2 for y1", shear, back, none),
    ]
    if not size:
        return linear
    return [
        *linear,
        (f"y + {b.tolist()}", np.eye(d), np.eye(d), b),
        (f"y1 + y2 for y1, then + {(-b).tolist()}", shear, back, -b),
    ]


def inverse_map(rows: Array, b: Array) -> list[Polynomial]:
    """Return the components of Q(z − b), as polynomials in z, for the matrix Q with the given
    rows.
    """
    d = len(b)
    return [
        poly.add(
            poly.constant(d, -float(row @ b)),
            *(poly.scale(q, poly.variable(d, k)) for k, q in enumerate(row.tolist())),
        )
        for row in rows
    ]


def substitute(p: Polynomial, forms: list[Polynomial]) -> Polynomial:
    """Substitute linear `forms` for the variables of p: exact for small dyadic coefficients,
    else with rounding.
    """
    products = [poly.polynomial(p.dimension, {})]
    for exponents, coefficient in p.terms:
        term = poly.constant(p.dimension, coefficient)
        for form, exponent in zip(forms, exponents, strict=True):
            for _ in range(exponent):
                term = poly.multiply(term, form)
        products.append(term)
    return poly.add(*products)


def transformed(system: PolynomialSystem, P: Array, inverse: Array, b: Array) -> PolynomialSystem:
    """Return the system in the variables z = Py + b, with H(P⁻¹(z − b)) and P B(P⁻¹(z − b)) Pᵀ."""
    d, forms = system.dimension, inverse_map(inverse, b)
    H = substitute(system.hamiltonian, forms)
    if system.nambu is not None:
        # With hat(c)v = v × c, P hat(c) Pᵀ = det(P) hat(P⁻ᵀc): det(P) multiplies g, and C is
        # transformed like H.
        g, C = (substitute(p, forms) for p in system.nambu)
        return nambu_system(H, poly.scale(float(round(np.linalg.det(P))), g), C, system.noise)
    B, *G = (_congruent(d, part, P, forms) for part in (system.structure, *system.noise_structures))
    others = tuple(substitute(p, forms) for p in system.noise_hamiltonians)
    vectors = tuple(tuple((P @ np.array(g)).tolist()) for g in system.noise_vectors)
    return PolynomialSystem(
        d, H, B, system.noise, noise_structures=tuple(G), noise_hamiltonians=others, noise_vectors=vectors
    )


def _congruent(
    d: int, structure: tuple[tuple[int, int, Polynomial], ...], P: Array, forms: list[Polynomial]
) -> tuple[tuple[int, int, Polynomial], ...]:
    """Return the entries of P B Pᵀ above the diagonal,
    with the forms substituted for the variables of B.
    """
    old = [(i, j, substitute(entry, forms)) for i, j, entry in structure]
    rows = P.tolist()
    entries = []
    for a, p in enumerate(rows):
        for b, q in enumerate(rows[a + 1 :], a + 1):
            minors = ((p[i] * q[j] - p[j] * q[i], entry) for i, j, entry in old)
            parts = [poly.scale(minor, entry) for minor, entry in minors if minor]
            entry = poly.add(poly.polynomial(d, {}), *parts)
            if entry.terms:
                entries.append((a, b, entry))
    return tuple(entries)


def check(scheme: Scheme, case: Case) -> Measurement:
    """Measure |Φ_z(Py + b) − PΦ_y(y) − b|, where Φ_y and Φ_z are short steps of the system in y and
    in z = Py + b.

    Both equations are contractions with factor κ. So a residual r causes an error of at most r/(1
    − κ) in the largest component, and |P|_∞ multiplies the error of y1. Py + b is rounded at most
    twice in each component, before the step and after it. A step multiplies the rounding before it
    by at most ‖∂z1/∂z0‖ ≤ (1 + κ)/(1 − κ). A scheme that does not claim *random-step* may compute
    an Itô correction. Its rounding is added to the bound, because H in the new variables has terms
    that cancel.
    """
    problem, y, h, dW = case.build()
    assert isinstance(case.problem, PolynomialSystem)
    others = [
        (name, P, b, problems.build(transformed(case.problem, P, inverse, b)))
        for name, P, inverse, b in transformations(y)
    ]
    length = abs(h) + float(np.abs(problem.c * dW).sum())
    shortest = min(contraction_radius(other, P @ y + b) for _, P, b, other in others)
    share = min(1.0, shortest / length)
    h, dW = share * h, share * dW
    y1 = ask(scheme, problem, y, h, dW)
    residual = float(step_residual(problem, y, y1, h, dW, scheme).max())
    apart = "random-step" not in scheme.claims
    if apart:
        residual += float(correction_rounding(problems.build(case.problem), y, y1, h).max())
    worst = Measurement(0.0, 0.0)
    for name, P, b, other in others:
        z = P @ y + b
        z1 = ask(scheme, other, z, h, dW)
        expected = P @ y1 + b
        start, end = (scheme.eps * float(np.max(np.abs(P) @ np.abs(v) + np.abs(b))) for v in (y, y1))
        allowed = float(np.abs(P).sum(axis=1).max()) * residual + (1 + CONTRACTION) * start + end
        allowed += float(step_residual(other, z, z1, h, dW, scheme).max())
        if apart:
            allowed += float(correction_rounding(other, z, z1, h).max())
        unit = state_ulp(z, z1)
        error = float(np.max(np.abs(z1 - expected)))
        detail = f"{name}: the step from there is {z1.tolist()}, the step from y goes to {expected.tolist()}"
        measurement = Measurement(error / unit, allowed / (1 - CONTRACTION) / unit, detail)
        worst = max(worst, measurement, key=lambda m: (m.ratio, m.bound))
    return worst


law = searched(
    name="equivariance",
    statement="the step commutes with changes of coordinates y → Py + b, if B and H are changed with y",
    source="(2.1)",
    unit="ulp of y",
    cost=1.1,
    steps=298,
    middle=Middle.MAP,
    cases=Cases(
        # Systems are limited in size, because substitution multiplies the number of terms.
        where={
            "d": ("2", "3", "4–6", "7–9"),
            "degree of H": ("1–2", "3–4", "5–6"),
            "terms of H": ("1–2", "3–9", "10–19"),
            "degree of B": ("0", "1", "2–3"),
            "degree of C": ("1", "2", "3–4"),
            "degree of g": ("0", "1–2"),
            "structures": ("any",),
        },
        adapt=lambda case: case if has_majorants(case) and len(case.y) > 1 else None,
        stays=False,
    ),
    check=check,
)


def test_equivariance(scheme: Scheme, effort: Effort) -> None:
    require(law, scheme, effort)
