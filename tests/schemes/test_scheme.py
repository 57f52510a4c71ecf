"""The scheme record, and what it makes of states and increments."""

import pytest

from sepv import Scheme, UsageError, schemes
from sepv.verification import load_laws


def stay(problem, y, h, dW):
    return y


def test_claims_are_names_however_they_are_written() -> None:
    for claims in (
        "noise_sum",
        ["noise-sum"],
        ("noise-sum ", "noise_sum"),
        {"noise-sum"},
        iter(["noise-sum"]),
    ):
        assert Scheme("mine", stay, claims=claims).claims == frozenset({"noise-sum"})
    assert Scheme("mine", stay).claims == frozenset()


def test_an_order_is_a_claim_beside_the_others() -> None:
    """With an order go its local conditions, (3.8) and (3.9), and the right limit."""
    strong = {"local-mean", "local-mean-square", "mean-square-order", "right-limit"}
    one = Scheme("mine", stay, claims=["energy"], mean_square_order=1.0)
    assert one.claims == {"energy", *strong}
    weak = {"local-weak", "weak-order"}
    assert Scheme("mine", stay, claims=["energy"], weak_order=1.0).claims == {"energy", *weak}
    assert Scheme("mine", stay, weak_order=2.0, mean_square_order=0.5).claims == strong | weak


def test_a_scheme_is_a_function() -> None:
    with pytest.raises(UsageError, match="hand over the function itself"):
        Scheme("mine", "step")


def test_every_built_in_scheme_says_what_it_is() -> None:
    """Where it comes from, its orders, k ≥ 2p (Remark 2.1), and only laws that there are."""
    laws = {law.name for law in load_laws()}
    families = [family(s) for family in (schemes.collocation, schemes.gauss) for s in range(1, 7)]
    several = map(schemes.by_name, schemes.HAMILTONIANS)
    for scheme in [*schemes.PAPER.values(), *schemes.EXTENSIONS.values(), *several, *families]:
        assert scheme.claims <= laws
        assert scheme.source
        assert scheme.mean_square_order is not None
        assert scheme.weak_order is not None
        assert scheme.truncation is None or scheme.truncation >= 2 * scheme.mean_square_order
        assert schemes.by_name(scheme.name) is schemes.by_name(scheme.name.replace("-", "_")) is scheme
