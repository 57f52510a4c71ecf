"""What does not hold as printed, as a page: python -m benchmarks.errata > docs/errata.md."""

from __future__ import annotations

from benchmarks import start
from sepv.studies._reproduce.errata import errata


def to_markdown() -> str:
    """docs/errata.md."""
    lines = [
        "# What does not hold as printed",
        "",
        "D. Cohen and G. Dujardin, *Energy-preserving integrators for stochastic Poisson systems* "
        "(2014). None of these entries touches",
        "a theorem's conclusion for the problems of §4 at the step sizes used there, but where it is "
        "said. `sepv reproduce --errata`",
        "computes and prints them; this page is its output as Markdown.",
    ]
    for e in errata():
        lines += ["", f"## {e.place}", "", f"- printed: {e.printed}", f"- right: {e.right}"]
        lines += [f"- evidence: {e.evidence}", f"- command: `{e.command}`"]
    return "\n".join(lines) + "\n"


def main() -> None:
    """Print it."""
    print(to_markdown(), end="")


if __name__ == "__main__":
    start(main)
