"""Environments, made and kept by uv, with one version of another library and the sepv of this
checkout.
"""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Sequence

from benchmarks import ROOT
from sepv.errors import SepvError

# Addresses and names of hosts, which are left out of messages, because they are the user's own.
_ADDRESS = re.compile(r"\w+://\S+|host='[^']*'")

# Released versions that were measured, each with the versions of other packages that it needs: a
# library states the oldest versions that it accepts, but seldom the newest. () means that it runs
# with the newest versions of all.
VERSIONS: dict[str, dict[str, tuple[str, ...]]] = {
    "diffrax": {"0.5.1": ("jax==0.4.38", "jaxlib==0.4.38", "equinox==0.11.12"), "0.6.2": (), "0.7.2": ()},
    "torchsde": {"0.2.5": (), "0.2.6": ()},
    "sdeint": {"0.2.4": (), "0.3.0": ()},
}


class EnvironmentFailure(SepvError, RuntimeError):
    """An environment could not be made, or nothing could be measured in it."""

    def __init__(self, what: str, remedy: str) -> None:
        self.what, self.remedy = what, remedy
        super().__init__(f"{what}\nRemedy: {remedy}.")


def measure(requirements: Sequence[str], arguments: Sequence[str], python: str = sys.executable) -> None:
    """Run ``python -m benchmarks.peers.one_release`` with these requirements of uv,
    such as ``"diffrax==0.6.2"``.

    Raises
    ------
    EnvironmentFailure
        The message has the last words of uv or of the measurement, but no addresses.
    """
    beside = [word for text in requirements for word in ("--with", text)]
    command = [
        "uv",
        "run",
        "--quiet",
        "--no-project",
        "--isolated",
        "--python",
        python,
        "--with-editable",
        str(ROOT),
        *beside,
    ]
    try:
        done = subprocess.run(
            [*command, "python", "-m", "benchmarks.peers.one_release", *arguments],
            cwd=ROOT, stderr=subprocess.PIPE, text=True, check=False,
        )  # fmt: skip
    except FileNotFoundError:
        raise EnvironmentFailure("there is no uv, which makes the environments", "pip install uv") from None
    if done.returncode:
        said = "\n".join(_ADDRESS.sub("…", line) for line in done.stderr.splitlines()[-4:])
        remedy = (
            "uv needs an index that has this version for this Python; with --with NAME==VERSION an older companion is "
            "installed beside it, with --python another Python; --keep goes on with what was measured"
        )
        raise EnvironmentFailure(f"{' '.join(requirements)} was not measured\n{said}", remedy)
