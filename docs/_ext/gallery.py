"""Pages that are made when the site is built: a path of each problem,
and H along a path of each scheme.
"""

from __future__ import annotations

import inspect
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

import sepv
from sepv.errors import SepvError
from sepv.pictures import Axis, content, figure, frame

# Steps in a unit of time of the paths of problems and of schemes.
FINE, COARSE = 64, 32
SIZE = (6.4, 3.0)


def generate(app: Any) -> None:
    """Write `_generated/problems.md` and `_generated/schemes.md`, and their pictures."""
    folder = Path(app.srcdir) / "_generated"
    folder.mkdir(exist_ok=True)
    T = float(app.config.gallery_time)
    _write(folder / "example.txt", _example())
    for name, title, entries in (
        ("problems", "Gallery of problems", _problems(folder, T)),
        ("schemes", "Gallery of schemes", _schemes(folder, T)),
    ):
        text = (
            f"# {title}\n\n{INTRODUCTIONS[name].format(T=T, steps=round(COARSE * T))}\n\n"
            + "\n\n".join(entries)
            + "\n"
        )
        _write(folder / f"{name}.md", text)


def _write(path: Path, text: str) -> None:
    """Only what is new: Sphinx reads what has changed."""
    if not path.exists() or path.read_text(encoding="utf-8") != text:
        path.write_text(text, encoding="utf-8")


def _example() -> str:
    """The example of the first page, measured as it is built."""
    report = sepv.verify("midpoint", laws="energy,casimir")
    return f"$ sepv verify midpoint --law energy,casimir\n{report}\n"


INTRODUCTIONS = {
    "problems": "One path of each problem that sepv brings, up to T = {T:g}: the exact solution, which is the "
    "deterministic flow at the random time t + Σ c_j W_j(t).",
    "schemes": "Each picture shows the energy error along one path of the pendulum, T = {T:g} in {steps} steps with "
    "the same increments for each scheme. `sepv verify NAME` says what a scheme keeps to rounding.",
}


def _problems(folder: Path, T: float) -> Iterator[str]:
    steps = round(FINE * T)
    for name in (*sepv.problems.PAPER, *sepv.problems.EXTENSIONS):
        problem = sepv.problems.by_name(name)
        increments = np.random.default_rng(1).normal(scale=np.sqrt(T / steps), size=(problem.noises, steps))
        times = np.linspace(0.0, T, steps + 1)
        theta = times + np.concatenate([[0.0], np.cumsum(problem.c @ increments)])
        path = sepv.exact_flow(problem, theta)
        with figure(*SIZE, layout="constrained") as drawn:
            axes = drawn.add_subplot()
            for i, component in enumerate(path.y):
                axes.plot(times, component, label=f"y{i + 1}", linewidth=1)
            frame(axes, Axis("t"), Axis("y"))
            drawn.legend(loc="outside upper right", ncols=problem.dimension)
            (folder / f"{name}.png").write_bytes(content(drawn, ".png", dpi=120))
        what = (inspect.getdoc(inspect.getmodule(_maker(name))) or "").partition("\n\n")[0]
        facts = f"d = {problem.dimension}, {problem.noises} noise" + ("s" if problem.noises > 1 else "")
        yield f"## {name}\n\n{what} {facts}.\n\n![The components of one path of {name} against time]({name}.png)"


def _maker(name: str) -> Any:
    return {**sepv.problems.PAPER, **sepv.problems.EXTENSIONS}[name]


def _schemes(folder: Path, T: float) -> Iterator[str]:
    problem = sepv.problems.by_name("pendulum")
    for name, scheme in {**sepv.schemes.PAPER, **sepv.schemes.EXTENSIONS}.items():
        heading = f"## {name}\n\n{scheme.source}."
        try:
            path = sepv.integrate(scheme, problem, h=1 / COARSE, T=T, seed=1)
        except SepvError as error:
            yield f"{heading} Not shown: {str(error).splitlines()[0]}"
            continue
        energy = problem.hamiltonian(path.y)
        with figure(*SIZE, {"lines.linewidth": 1}, layout="constrained") as drawn:
            axes = drawn.add_subplot()
            axes.plot(path.t, energy - energy[0])
            frame(axes, Axis("t"), Axis("H(y) − H(y₀)"))
            (folder / f"{name}.png").write_bytes(content(drawn, ".png", dpi=120))
        largest = float(np.max(np.abs(energy - energy[0])))
        yield (
            f"{heading} Largest energy error on this path: {largest:.1e}.\n\n"
            f"![The energy error of {name} against time]({name}.png)"
        )


def setup(app: Any) -> dict[str, bool]:
    """Called by Sphinx."""
    app.add_config_value("gallery_time", "16", "env")  # how long the paths are; -D gives texts
    app.connect("builder-inited", generate)
    app.connect("autodoc-process-docstring", _plain)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _plain(_app: Any, _kind: str, _name: str, _object: Any, _options: Any, lines: list[str]) -> None:
    """Docstrings write |y| and yᵀ as they are: a bar is no markup there."""
    lines[:] = [
        line.replace("|", r"\|") if "|" in line and not line.startswith(">>>") else line for line in lines
    ]
