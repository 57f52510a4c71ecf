"""The part of a problem that its checks read: a system, its initial state,
and the invariants that it states.
"""

from __future__ import annotations

from collections.abc import Mapping

from numpy.typing import ArrayLike

from sepv.core.problem import Function, System


class Stated(System):
    """A system with what a problem states beside its functions;
    `sepv.problem.Problem` documents both fields.
    """

    initial: ArrayLike | None
    invariants: Mapping[str, Function]
