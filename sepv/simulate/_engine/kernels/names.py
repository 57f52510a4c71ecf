"""What a generated module defines for the functions of this folder; the values here are never used."""

from __future__ import annotations

from typing import Any

# Lanes of a block, lanes that go on together, unknowns.
L = GROUP = UNKNOWNS = 0
# Lanes in the first loop of `newton`, whose piece may take two at a time, what it counts for, and further iterations.
TOGETHER = STEPS = FAST = 0
# Offsets in the integers of a block, and of the unknowns in its scratch buffer.
BUSY = ALIVE = STATUS = EVALUATIONS = STRUCTURES = LIVING = WORK = UNKNOWN_ROWS = 0
# Statuses of `sepv.solve._solution`, and what `sepv.simulate._engine.careful` asks for.
NO_CONVERGENCE = LEFT_DOMAIN = BROKEN = EQUATION = INSIDE = GRADIENT = HESSIAN = STRUCTURE = 0
INF = 0.0
# `stages`: sweeps, and the nodes of the quadratures.
STAGES = RULES = BLIND = FUSED = TESTED = 0
EXACT = CHECKED = STRAIGHT = False
COUNTS: Any = None
FIRSTS: Any = None
NODES: Any = None
# `projected`: evaluations of the first iterations and of each further one.
FIRST_GRADIENTS = FIRST_STRUCTURES = AVERAGES = 0

loaded: Any = None
loaded_node: Any = None
# Pieces f(S, I, buffer, n, k, first, h, bound, q) of lane k in step n, and what they add up.
first_steps: Any = None
iteration: Any = None
blind: Any = None
check: Any = None
clear: Any = None
add_node: Any = None
quick: Any = None
masked: Any = None
invariants: Any = None
# Pieces f(x, v, A, b, q) of a state x.
equation: Any = None
gradient: Any = None
hessian: Any = None
structure: Any = None
turned: Any = None
domain: Any = None
# Functions of this folder in the module's own copy.
ahead: Any = None
some: Any = None
moved: Any = None
left_over: Any = None
