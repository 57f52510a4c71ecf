"""Released versions that were installed and measured, each with the companions of its time.

A library says the oldest companion that it takes, and seldom the newest. What is listed is what pip must be told so
that a version runs; nothing where it runs with the newest of all.
"""

from __future__ import annotations

VERSIONS: dict[str, dict[str, tuple[str, ...]]] = {
    "diffrax": {"0.5.1": ("jax==0.4.38", "jaxlib==0.4.38", "equinox==0.11.12"), "0.6.2": (), "0.7.2": ()},
    "torchsde": {"0.2.5": (), "0.2.6": ()},
    "sdeint": {"0.2.4": (), "0.3.0": ()},
}


def companions(library: str, version: str) -> tuple[str, ...]:
    """What is installed beside a version, as pip takes it."""
    return VERSIONS.get(library, {}).get(version, ())
