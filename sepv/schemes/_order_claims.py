"""Claims of order that depend on the noise, for schemes of several Hamiltonians that use only
increments.

A plain number is a claim for every kind of noise. `Orders` claims a higher order where terms of the
stochastic Taylor expansion vanish (P. Kloeden and E. Platen, Numerical Solution of Stochastic
Differential Equations, 1992, §10.3, §11): for example, Lévy areas of two noises are multiplied by
the bracket of their fields, which is 0 if the fields commute.
"""

from __future__ import annotations

from sepv.errors import UsageError

COLUMNS = ("general", "commutative", "one", "additive")


class Orders(float):
    """A claimed order of convergence: a float for noise in general,
    with further orders for special kinds of noise.

    Parameters
    ----------
    general : float
        The order for any noises, which is the value of the float.
    commutative, one, additive : float, optional
        The orders for noises whose fields commute, for one noise, and for constant fields. An order
        left out is that of the next wider kind: `general` for `commutative`, and `commutative` for
        `one` and `additive`.

    Examples
    --------
    >>> order = Orders(0.5, commutative=1.0)
    >>> order, order.of("general"), order.of("one"), order.of("additive")
    (Orders(0.5, commutative=1, one=1, additive=1), 0.5, 1.0, 1.0)
    """

    commutative: float
    one: float
    additive: float

    def __new__(
        cls,
        general: float,
        *,
        commutative: float | None = None,
        one: float | None = None,
        additive: float | None = None,
    ) -> Orders:
        self = super().__new__(cls, general)
        self.commutative = float(general if commutative is None else commutative)
        self.one = float(self.commutative if one is None else one)
        self.additive = float(self.commutative if additive is None else additive)
        if not self <= self.commutative <= min(self.one, self.additive):
            raise UsageError(
                expected="general ≤ commutative ≤ one and additive: the wider claim is the weaker one",
                received=repr(self),
                remedy="a claim for any noises holds for special ones too",
            )
        return self

    def of(self, column: str) -> float:
        """The order for noises of the kind `column`, one of `COLUMNS`."""
        return float(self) if column == "general" else float(getattr(self, column))

    def __repr__(self) -> str:
        return f"Orders({float(self):g}, " + ", ".join(f"{k}={getattr(self, k):g}" for k in COLUMNS[1:]) + ")"

    def __getnewargs_ex__(self) -> tuple[tuple[float], dict[str, float]]:
        # Without this method a pickle, such as one for another process, would hold the float alone.
        return (float(self),), {key: getattr(self, key) for key in COLUMNS[1:]}


def order_of(claimed: float | None, column: str, unclaimed: float = 1.0) -> float:
    """The order that `claimed` has for noises of the kind `column`, one of `COLUMNS`;
    `unclaimed` if there is none.
    """
    if claimed is None:
        return unclaimed
    return claimed.of(column) if isinstance(claimed, Orders) else float(claimed)
