"""The process of one checkout in a paired measurement: it measures or times a scheme on request.

It runs as a script, with the checkout first on the import path. `measure.py` and
`_evaluation_count.py` are loaded from the checkout of this file, so that the same code measures
both checkouts, however old the other one is. Questions and answers are JSON lines on stdin and
stdout; what a scheme prints goes to stderr.
"""

from __future__ import annotations

import importlib.util
import json
import os
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

BENCH_FOLDER = Path(__file__).resolve().parent


def _from_file(name: str, path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


def main() -> None:
    """Answer the questions on stdin (load, measure or time a scheme), one JSON object per line,
    until stdin ends.
    """
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    import sepv  # noqa: F401  (what follows belongs to the checkout's sepv)

    _from_file("sepv.studies._evaluation_count", BENCH_FOLDER.parent / "_evaluation_count.py")
    measuring = _from_file("sepv.studies._bench.measure", BENCH_FOLDER / "measure.py")
    scheme = None
    for line in sys.stdin:
        question: dict[str, Any] = json.loads(line)
        answer: dict[str, Any]
        try:
            if "load" in question:
                from sepv.schemes import load_scheme

                scheme = load_scheme(question["load"])
                home = sys.modules[question["load"].partition(":")[0] if ":" in question["load"] else "sepv"]
                answer = {"origin": home.__file__}
            elif "measure" in question:
                answer = measuring.measure(scheme, question["measure"])
            else:
                answer = {
                    "seconds": measuring.seconds(
                        scheme, question["time"], question["loops"], question["call"]
                    )
                }
        except Exception as error:
            answer = {"failed": f"{type(error).__name__}: {error}"}
        answers.write(json.dumps(answer) + "\n")
        answers.flush()


if __name__ == "__main__":
    main()
