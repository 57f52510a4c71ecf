"""Records of the benchmark: in a JSON file (hex floats, sorted so that differences are readable),
and as a table.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from sepv.console import Table, columns
from sepv.files import read_json, require_schema
from sepv.schemes import Scheme
from sepv.studies._bench import measure as measuring
from sepv.studies._bench.gate import TOLERANCE_OF_KIND, rms
from sepv.studies._compare.run import environment

BENCH_FORMAT = 1
# The counters in the order of the columns, and their headings.
COUNTER_HEADINGS = {
    "gradient": "∇H", "structure": "B", "hamiltonian": "H", "hessian": "H″", "structure derivative": "B′",
    "iterations": "Newton", "failed solves": "failed",
}  # fmt: skip
# Columns that are dropped on a narrow terminal, in order.
BENCH_DROPPED = ("H″", "B′", "H", "failed", "Newton", "ΔC", "B", "ΔH")


def record(target: str, scheme: Scheme, cases: Iterable[dict[str, Any]]) -> dict[str, Any]:
    """The record of one target: its name, and the measurement of `scheme` in each of the cases."""
    return {"target": target, "cases": [measuring.measure(scheme, case) for case in cases]}


def document(records: list[dict[str, Any]]) -> dict[str, Any]:
    """The content of the file that `sepv bench --save` writes: the records,
    the format and the environment.
    """
    return {"format": BENCH_FORMAT, "environment": environment(), "records": records}


def load(path: str) -> list[dict[str, Any]]:
    """Read the records of a file; UsageError if `sepv bench --save` did not write the file."""
    words = {
        "expected": f"a file that `sepv bench --save` wrote, of format {BENCH_FORMAT}",
        "remedy": "save it again with this release",
    }
    record = read_json(path, **words)
    require_schema(record, "bench", path, **words)
    records: list[dict[str, Any]] = record["records"]
    return records


def record_table(record: dict[str, Any]) -> Table:
    """The table of one record: for each case a row with counts of work,
    rms error and rms defects of H and Casimirs.
    """
    rows = [
        (
            case["case"]["name"].replace("harmonic-", "harmonic-\n"),
            *("–" if (n := case["counters"].get(name)) is None else str(n) for name in COUNTER_HEADINGS),
            *(
                f"{rms(case[kind]):.1e}".replace("e-0", "e-").replace("e+00", "")
                for kind in TOLERANCE_OF_KIND
            ),
        )
        for case in record["cases"]
    ]
    heads = columns(["case"], [*COUNTER_HEADINGS.values(), "error", "ΔH", "ΔC"], goes=BENCH_DROPPED)
    return Table(heads, rows, f"{record['target']}: evaluations over all paths and steps, rms over paths")
