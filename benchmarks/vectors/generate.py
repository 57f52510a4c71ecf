"""Make the reference vectors, or check them: ``python -m benchmarks.vectors [--check [--all]]
[SCHEME …]``.

The files under reference/vectors hold the cases, and this program their answers. Each answer is
computed by mpmath and proved by ball arithmetic (the extra `certify`) before it is written; a file
is written whole or not at all. A new case is a copy of a stored one with an id and a step of its
own: `answer` computes the rest, and `to_text` the file.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Iterable, Sequence
from dataclasses import replace
from fractions import Fraction
from math import isfinite
from pathlib import Path
from typing import Any

from sepv.reference.arithmetic import Vector, context
from sepv.reference.balls import available, from_mpf, precision, require_flint
from sepv.reference.branch import follow
from sepv.reference.certify import certify
from sepv.reference.equations import Equation, make_step
from sepv.reference.flow import enclosed, taylor
from sepv.reference.problem import binary64_problem
from sepv.reference.solve import FLOAT_ERRORS
from sepv.reference.steps import ReferenceStep, find_equation, reference_step
from sepv.reference.vector import (
    FLOW,
    VECTOR_DIGITS,
    VECTOR_FOLDER,
    VECTOR_FORMAT,
    ReferenceVector,
    load,
    schemes_with_vectors,
    to_json,
)

from benchmarks.vectors.rounding import UNIT, error_units
from sepv.errors import SepvError
from sepv.files import write_atomically

# The number of digits computed beyond those printed; a proof by balls may leave three of them
# undecided.
_EXTRA_DIGITS = 10
# If a component is much smaller than the largest, _SMALL_COMPONENT_DIGITS digits are computed;
# below 1e-390 of the largest it is 0.
_USUAL_DIGITS, _SMALL_COMPONENT_DIGITS = VECTOR_DIGITS + _EXTRA_DIGITS, 460
_ZERO_BELOW_DIGITS = 390


class GenerationError(SepvError):
    """A case whose answer could not be computed or proved; nothing was written."""


def to_text(scheme: str, source: str, vectors: Iterable[ReferenceVector]) -> str:
    """The text of a whole file: a head, then one case a line."""
    head = {"format": VECTOR_FORMAT, "scheme": scheme, "source": source, "digits": VECTOR_DIGITS}
    lines = ",\n".join(json.dumps(to_json(v), separators=(",", ":"), ensure_ascii=True) for v in vectors)
    return json.dumps(head, ensure_ascii=True, indent=1)[:-2] + ',\n "cases": [\n' + lines + "\n ]\n}\n"


def answer(case: ReferenceVector) -> ReferenceVector:
    """Compute the result of a case, whatever it has, prove it if python-flint is installed,
    and round it.

    Raises
    ------
    GenerationError
        If the vector cannot be computed or proved; the message names the case.
    """
    try:
        return _flow_answer(case) if case.scheme == FLOW else _step_answer(case)
    except (SepvError, ArithmeticError, ValueError) as error:
        raise GenerationError(f"{case.id}: {case.note}\n{error}") from error


def _step_answer(case: ReferenceVector) -> ReferenceVector:
    equation = find_equation(case.scheme)
    arguments = (case.problem, case.y, case.h, case.dW)
    start, flags = _on_the_branch(equation, case)
    step = reference_step(equation, *arguments, _USUAL_DIGITS, start=start)
    digits = _USUAL_DIGITS
    if _uneven(step.y1):
        digits = _SMALL_COMPONENT_DIGITS
        step = reference_step(equation, *arguments, digits, start=[float(v) for v in step.x] or None)
    y1 = _without_noise(step.y1)
    proof = "none"
    if available():
        proof = _proved(case, step, y1, digits)
    units = error_units(case.problem, list(case.y), case.h, list(case.dW), step)
    return _vector(case, y1, max(map(sum, step.condition)), units, flags, proof)


def _on_the_branch(equation: Equation, case: ReferenceVector) -> tuple[Vector | None, tuple[str, ...]]:
    """The start of Newton's iteration on the branch of solutions from y, and the flags,
    perhaps with "overflow".
    """
    flags = tuple(f for f in case.flags if f != "overflow")
    if equation.residual is None:
        return None, flags if _fits_binary64(equation, case) else (*flags, "overflow")
    if not {"large-step", "near-fold"} & set(flags):
        return None, flags
    branch = follow(equation, case.problem, case.y, case.h, case.dW)
    if not branch.whole:
        raise GenerationError(f"the branch of solutions ends at the share {branch.reached} of this step")
    return branch.x, flags


def _fits_binary64(equation: Equation, case: ReferenceVector) -> bool:
    """True if no intermediate result of an explicit formula overflows."""
    problem = binary64_problem(case.problem)
    try:
        step = make_step(problem, case.h, case.dW)
        return all(map(isfinite, equation.result(problem, list(case.y), step, [])))
    except FLOAT_ERRORS:
        return False


def _uneven(y1: Vector) -> bool:
    sizes = [abs(v) for v in y1]
    return min(sizes) < max(sizes) * 1e-5


def _without_noise(y1: Vector) -> Vector:
    """Replace components that are only rounding errors of the others by 0."""
    ctx = context(_SMALL_COMPONENT_DIGITS)
    scale = max(abs(v) for v in y1)
    return [ctx.zero if abs(v) < scale * ctx.mpf(10) ** -_ZERO_BELOW_DIGITS else v for v in y1]


def _proved(case: ReferenceVector, step: ReferenceStep, y1: Vector, digits: int) -> str:
    """Prove the step by Krawczyk's test, with balls that determine each printed digit;
    return the kind of proof.
    """
    bits = max(500, int(7 * digits))
    proof = certify(case.problem, case.y, case.h, case.dW, step, bits)
    with precision(bits):
        for k, (value, enclosure) in enumerate(zip(y1, proof.y1, strict=True)):
            _require_digits_of(value, enclosure, k)
        if step.equation.name in _KEEP_ENERGY and not proof.energy.contains(0):
            raise GenerationError(f"H(y1) − H(y0) is in {proof.energy.str(10)}, which does not hold 0")
    return "balls" if step.equation.residual is None else "krawczyk"


_KEEP_ENERGY = {"energy-preserving", "discrete-gradient", *(f"collocation-{s}" for s in range(1, 7))}


def _require_digits_of(value: Any, enclosure: Any, k: int) -> None:
    flint = require_flint()
    if not value:
        if not enclosure.contains(0):
            raise GenerationError(f"component {k + 1} is printed as 0 and is {enclosure.str(5)}")
        return
    off = abs((enclosure - from_mpf(value)) / from_mpf(value)).upper()
    if not off < flint.arb(10) ** (-VECTOR_DIGITS - 5):
        raise GenerationError(f"component {k + 1}: only {off.str(3)} of it is proved")
    ends = {_rounded(_fraction_of(end)) for end in (enclosure.lower(), enclosure.upper())}
    if ends != {to_binary64(value)}:
        raise GenerationError(f"component {k + 1} lies too close to the middle of two binary64 numbers")


def _fraction_of(end: Any) -> Fraction:
    man, exp = end.man_exp()
    return Fraction(int(man)) * Fraction(2) ** int(exp)


def _rounded(value: Fraction) -> float:
    # The quotient of two integers is correctly rounded in Python, subnormal or not.
    return value.numerator / value.denominator


def to_binary64(value: Any) -> float:
    """Round an mpmath number to the nearest binary64 number, ties to even,
    subnormal numbers included.
    """
    sign, man, exp, _ = value._mpf_
    return _rounded(Fraction(-int(man) if sign else int(man)) * Fraction(2) ** int(exp))


def _flow_answer(case: ReferenceVector) -> ReferenceVector:
    """Compute the vector of an exact flow by Taylor series;
    prove it by an enclosure if python-flint is installed.
    """
    arguments = (case.problem, case.y, case.h)
    digits = _USUAL_DIGITS
    y1 = taylor(*arguments, digits)
    if _uneven(y1):
        digits = 2 * _USUAL_DIGITS
        y1 = taylor(*arguments, digits)
    scale = max(abs(v) for v in y1)
    y1 = [v if abs(v) > scale * context(30).mpf(10) ** (-digits + 5) else 0 * v for v in y1]
    proof = "none"
    if available():
        bits = int(3.33 * (digits + 15 + 4 * abs(case.h))) + 200
        balls = enclosed(*arguments, digits)
        with precision(bits):
            for k, (value, enclosure) in enumerate(zip(y1, balls, strict=True)):
                _require_digits_of(value, enclosure, k)
        proof = "balls"
    unit = max(1.0, abs(case.h)) * float(scale)
    return _vector(case, y1, 1.0, [4 * UNIT * unit] * len(y1), case.flags, proof)


def _vector(
    case: ReferenceVector,
    y1: Vector,
    condition: float,
    units: Sequence[float],
    flags: tuple[str, ...],
    proof: str,
) -> ReferenceVector:
    ctx = context(_SMALL_COMPONENT_DIGITS)
    return replace(
        case,
        y1=tuple(_decimal(ctx, v) for v in y1),
        y1_hex=tuple(map(to_binary64, y1)),
        condition=float(f"{condition:.3g}"),
        rounding=tuple(float(f"{1.005 * u:.3g}") for u in units),
        flags=flags,
        proof=proof,
    )


def _decimal(ctx: Any, v: Any) -> str:
    return str(ctx.nstr(v, VECTOR_DIGITS, strip_zeros=False, min_fixed=-6, max_fixed=16)) if v else "0.0"


def source_of(scheme: str) -> str:
    """The description of a scheme's equation for the head of its file of vectors."""
    return "y' = B(y) grad H(y) at time theta" if scheme == FLOW else find_equation(scheme).source


def differences(new: ReferenceVector, old: ReferenceVector) -> list[str]:
    """The fields in which two vectors differ; `condition` and `rounding` may differ by 2 %."""
    found = []
    for key in ("y1", "y1_hex", "flags"):
        if getattr(new, key) != getattr(old, key):
            found.append(key)
    if new.proof not in (old.proof, "none"):
        found.append("proof")
    estimates = zip((new.condition, *new.rounding), (old.condition, *old.rounding), strict=True)
    if not all(abs(a - b) <= 0.02 * abs(b) for a, b in estimates):
        found.append("condition or rounding")
    return found


def check(schemes: Sequence[str], every: int, folder: Path = VECTOR_FOLDER) -> tuple[int, list[str]]:
    """Compute each `every`-th case of each file again, from the first on.
    Return their number and the differences.
    """
    cases = [case for scheme in schemes for case in load(scheme, folder)[::every]]
    odd = {case.id: differences(answer(case), case) for case in cases}
    return len(cases), [f"{name}: {', '.join(found)} differ" for name, found in odd.items() if found]


FAST_DIGITS = 13


def main(arguments: Sequence[str] | None = None) -> int:
    """Write or check the vectors; return 1 if something differs or a case failed, else 0."""
    known = schemes_with_vectors()
    parser = argparse.ArgumentParser(prog="benchmarks.vectors", description=__doc__)
    parser.add_argument(
        "schemes", nargs="*", metavar="SCHEME", help=f"one of {', '.join(known)}; default all"
    )
    parser.add_argument("--check", action="store_true", help="make vectors again and compare, write nothing")
    parser.add_argument("--all", action="store_true", help=f"check all of them, not every {FAST_DIGITS}th")
    options = parser.parse_args(arguments)
    for scheme in options.schemes:
        if scheme not in known:
            parser.error(f"unknown scheme {scheme!r}; there are {', '.join(known)}")
    chosen, start = options.schemes or known, time.perf_counter()
    try:
        if options.check:
            return _checked(chosen, 1 if options.all else FAST_DIGITS, start)
        require_flint()
        for scheme in chosen:
            vectors = [answer(case) for case in load(scheme)]
            write_atomically(
                str(VECTOR_FOLDER / f"{scheme}.json"), to_text(scheme, source_of(scheme), vectors)
            )
            print(f"{scheme}: {len(vectors)} vectors, {time.perf_counter() - start:.1f} s", flush=True)
    except SepvError as error:
        print(f"benchmarks.vectors: {error}", file=sys.stderr)
        return 1
    return 0


def _checked(schemes: Sequence[str], every: int, start: float) -> int:
    count, wrong = check(schemes, every)
    for line in wrong:
        print(line)
    proved = "computed and proved" if available() else "computed, not proved: python-flint is not installed"
    print(f"{count} vectors {proved} again in {time.perf_counter() - start:.1f} s; {len(wrong)} differ")
    return 1 if wrong else 0
