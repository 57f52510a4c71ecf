"""The schemes to which laws about sampled paths apply,
and the schemes for which these laws make fewer steps.
"""

from __future__ import annotations

from sepv.law import Effort, Finding, Law, Measure, Run, Verdict, about_noise
from sepv.schemes import Scheme, has_memory, point_law

# With at least DEEP_EXAMPLES examples a law (option `--deep`), long runs have DEEPER times as many
# steps.
DEEPER, DEEP_EXAMPLES = 8, 1000


def pathwise(run: Measure) -> Measure:
    """Wrap a law's `run`, so that the law is not applicable to schemes whose increments take only a
    few values.
    """

    def asked(law: Law, scheme: Scheme, this_run: Run) -> Finding:
        points = point_law(scheme.increments)
        if points is None:
            return run(law, scheme, this_run)
        text = f"{points.name} increments are no path of a Wiener process: see the laws about weak orders"
        return law.finding(Verdict.NOT_APPLICABLE, message=text)

    return about_noise(asked)


FIRST_STEP = (
    "a method with memory may make its first step with a lower order: its order is that of whole paths"
)


def of_one_step(run: Measure) -> Measure:
    """Wrap the `run` of a law about the local error, so that the law is not applicable to schemes
    with memory.
    """

    def asked(law: Law, scheme: Scheme, this_run: Run) -> Finding:
        if has_memory(scheme):
            return law.finding(Verdict.NOT_APPLICABLE, message=FIRST_STEP)
        return run(law, scheme, this_run)

    return asked


def sparing(scheme: Scheme, effort: Effort) -> bool:
    """True if laws make fewer steps: if the scheme takes one state a call and `effort` has no more
    paths than usual.
    """
    return not scheme.batched and effort.paths <= Effort.paths
