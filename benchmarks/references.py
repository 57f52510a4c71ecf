"""Contents and costs of the references, and errors of float64 against them:
``python -m benchmarks.references``.
"""

from __future__ import annotations

import time
from statistics import median

import numpy as np
from sepv.reference.arithmetic import context
from sepv.reference.balls import available
from sepv.reference.certify import certify
from sepv.reference.equations import EQUATIONS
from sepv.reference.steps import reference_step
from sepv.reference.vector import FLOW, ReferenceVector, load

from benchmarks import over, start
from benchmarks.vectors.selection import SCHEMES
from sepv import problems, schemes
from sepv.errors import SepvError, StepFailure
from sepv.law import Case, state_ulp
from sepv.record import EPS, TINY


def family(v: ReferenceVector) -> str:
    """The family of a vector's problem: its name, or "polynomial"."""
    return getattr(v.problem, "name", "polynomial")


def error(v: ReferenceVector, y1: np.ndarray) -> tuple[float, float]:
    """The largest error of a component of y1 in ulp of the largest component,
    and the largest ratio to its bound.
    """
    ctx, unit = context(60), state_ulp(np.array(v.y), np.array(v.y1_hex))
    floor = EPS * EPS * max(map(abs, (*v.y, *v.y1_hex))) + TINY
    off = [abs(float(ctx.mpf(a) - float(b))) for a, b in zip(v.y1, y1, strict=True)]
    return max(off) / unit, max(e / (4 * r + floor) for e, r in zip(off, v.rounding, strict=True))


def counts() -> None:
    """Print how many vectors there are, and how they are proved."""
    print("vectors            all  krawczyk  balls")
    total = [0, 0, 0]
    for scheme in SCHEMES:
        proofs = [v.proof for v in load(scheme)]
        row = [len(proofs), proofs.count("krawczyk"), proofs.count("balls")]
        total = [a + b for a, b in zip(total, row, strict=True)]
        print(f"{scheme:18} {row[0]:4} {row[1]:9} {row[2]:6}")
    print(f"{'all':18} {total[0]:4} {total[1]:9} {total[2]:6}\n")


def errors() -> None:
    """Print the errors of the float64 core against the vectors, by scheme and problem."""
    print("float64 against the vectors: largest error in ulp of y, and as a share of the bound (median)")
    for name in over(s for s in SCHEMES if s != FLOW):
        try:
            scheme = schemes.by_name(name)
        except SepvError:
            continue
        found: dict[str, list[tuple[float, float, str]]] = {}
        refused, others = [], []
        for v in load(name):
            if "overflow" in v.flags:
                continue
            problem, y, h, dW = Case(v.problem, v.y, v.h, v.dW).build()
            try:
                y1 = scheme.step(problem, y, h, dW)
            except StepFailure:
                refused.append(v.id)
                continue
            ulp, share = error(v, y1)
            if share > 1 and "near-fold" in v.flags:
                others.append(v.id)
            else:
                found.setdefault(family(v), []).append((share, ulp, v.id))
        for kind, rows in found.items():
            share, _, worst = max(rows)
            middle = median(r[0] for r in rows)
            ulps = max(r[1] for r in rows)
            print(f"{name:18} {kind:20} {ulps:9.3g} ulp  {share:6.3f} ({middle:.3f})  {worst}")
        if refused:
            print(f"{name:18} {'refused':20} {len(refused)}: {', '.join(refused)}")
        if others:
            # tests/reference/test_reference.py tests that these solutions solve the equation.
            print(f"{name:18} {'another solution':20} {len(others)}: {', '.join(others)}")
    print()


def speed() -> None:
    """Print the time of one reference step at 50 digits, with its set-up."""
    print("one step at 50 digits from y, h and dW to y1 (least of 200, µs)")
    names = [n for n in EQUATIONS if n != "averaged-vector-field"]
    for problem in over((p() for p in problems.PAPER.values()), lambda p: p.name):
        y, dW = tuple(map(float, problem.initial)), (0.05,) * problem.noises
        row = []
        for name in names:
            times = []
            for _ in range(200 if "-" not in name[-2:] else 20):
                start = time.perf_counter()
                reference_step(name, problem.data, y, 0.1, dW)
                times.append(time.perf_counter() - start)
            row.append(f"{name} {min(times) * 1e6:.0f}")
        print(f"{problem.name}: {', '.join(row)}")
    print()


def proof() -> None:
    """Print one certificate in words."""
    v = next(v for v in load("energy-preserving") if "near-fold" in v.flags and v.condition > 50)
    step = reference_step("energy-preserving", v.problem, v.y, v.h, v.dW, start=[float(x) for x in v.y1_hex])
    print(f"{v.id}: {v.note}, condition {v.condition}\n{certify(v.problem, v.y, v.h, v.dW, step).describe()}")


def main() -> None:
    """Print the four parts, or three if ball arithmetic is not installed."""
    for part in over((counts, errors, speed, *((proof,) if available() else ())), lambda f: f.__name__):
        part()


if __name__ == "__main__":
    start(main)
