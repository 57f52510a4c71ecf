"""The suite: measure the laws on a scheme, one after the other or in several processes."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import partial
from pathlib import Path
from traceback import format_exc
from typing import Any

from sepv._arguments import MAX_SECONDS, is_number, require_whole
from sepv._kept import save_all
from sepv.children import Crashed, TimedOut, attempted, deadline, interruption_answered, overheard
from sepv.errors import ClusterFailure, SepvError, Skipped, TargetError, UsageError
from sepv.law import Effort, Finding, Law, Run, Verdict
from sepv.law.along_paths import replays, taken
from sepv.law.cases import case as cases
from sepv.law.cases.users_problems import items
from sepv.law.fresh import asked_afresh, words_of
from sepv.properties import listed, load_laws
from sepv.schemes import (
    ALL_LAWS,
    LOCAL_LAWS,
    OF_TWINS,
    Scheme,
    Step,
    Twin,
    as_twin,
    load_scheme,
    require_one_return,
    require_trusted,
    restored_names,
    words_for,
)
from sepv.verification import _side_by_side as side_by_side
from sepv.verification._expected_failures import Expectations, ExpectedFailure
from sepv.verification._expected_failures import load as load_expected
from sepv.verification._laws import SAMPLED_LAWS, laws_of, soonest
from sepv.verification._profiles import requirements
from sepv.verification._shown import Report
from sepv.verification._side_by_side import WORKER

INTERRUPTED_UNDECIDED = "interrupted before it was decided"
LawProgress = Callable[[Law, "Finding | None"], None]


def verify(
    scheme: str | Scheme | Step,
    *,
    laws: Iterable[str] | None = None,
    claims: Iterable[str] = (),
    effort: Effort | None = None,
    timeout: float = 600.0,
    progress: LawProgress | None = None,
    expected: str | Path | None = None,
    jobs: int = 1,
    problems: Any = None,
    workers: Any = None,
    require: str | Iterable[str] = (),
    agrees_with: Any = None,
    bits: bool = False,
) -> Report:
    """Measure every law on a scheme, whether the scheme claims the law or not.

    Parameters
    ----------
    scheme : str, Scheme or function
        The scheme, in any form that `sepv.schemes.load_scheme` takes.
    laws : iterable of str, or one string with commas, optional
        The laws to measure; all by default.
    claims : iterable of str, or one string with commas
        Laws that the scheme must obey, in addition to the laws that it claims itself.
    timeout : float
        The time limit of each law in seconds. If the scheme does not return in time, the verdict is
        `error`. With ``jobs=1`` the limit interrupts Python code, but no compiled loop, and no code
        that catches every exception: a line on stderr then says what does. With more jobs, as on
        the command line, the process of such a law is killed.
    progress : callable (law, finding or None), optional
        Called before each law with None, and after the law with its finding.
    expected : path, optional
        A file of claims and of expected failures (docs/ci.md). Its claims are added. A law that is
        expected to fail is measured only on the witness (a stored counterexample) in the file.
    jobs : int
        The number of processes that measure laws; the verdicts do not depend on it. With several
        processes, the scheme must be one that another process can import.
    problems : problem or strategy, or a list of them, optional
        The problems that the scheme is for, if they are not all systems of its class: built-in
        names, families such as "mechanical", ``module:attribute``, ``.json`` files, `Problem`
        records, Hypothesis strategies of `PolynomialSystem` or `Problem`. Laws draw their cases
        from these alone.
    workers : executor, map-like callable, Dask client or its address, optional
        Workers on other machines (docs/clusters.md), as for `sepv.ensemble`. If a cluster is lost,
        laws without a finding are not measured, and `exit_code` is 3.
    effort : Effort, optional
        The numbers of examples and paths; ``Effort().deeper()`` is for a nightly run.
    require : iterable of str, or one string with commas
        Profiles (named sets of laws, docs/profiles.md) that the scheme must have, such as
        "energy,order-1". Only the laws of these profiles and of the profile "method" are measured.
        `laws` cannot be given as well.
    agrees_with : str, Scheme or function, optional
        A second program whose steps must be the same: the scheme then claims the law "agreement"
        with it.
    bits : bool
        True if the steps of both programs must have the same bits.

    Returns
    -------
    Report
        A finding for each law. `print` shows the table; `exit_code` is the exit code of
        ``sepv verify``.

    Raises
    ------
    TargetError, UsageError
        For a scheme that cannot be loaded, and for an unknown law or claim.

    Examples
    --------
    >>> import sepv
    >>> report = sepv.verify("midpoint", laws="energy,casimir")
    >>> report.counts["holds"], report.counts["violated"], report.exit_code
    (1, 1, 0)
    >>> report.finding("energy").verdict.text  # its message has the counterexample
    'violated'
    """
    required = requirements(require) if require else ()
    twin = as_twin(agrees_with, bits)
    chosen, effort = laws_of(laws, required, twin=twin is not None), effort or Effort()
    _check_arguments(jobs, timeout, effort, expected)
    known = load_expected(expected, ALL_LAWS) if expected is not None else Expectations()
    if problems is None and known.problems:
        require_trusted(known.problems, (), scheme)
        problems = list(known.problems)
    target = words_for(scheme, problems)
    candidate = load_in_time(
        scheme, {*listed(claims), *(known.claims or ())}, timeout, problems, target, twin
    )
    load_laws(candidate.claims)
    for failure in known.failures.values():
        cases.require_named(failure.witness, candidate)
    by_law: dict[str, Finding] = {}

    def receive(law: Law, finding: Finding | None) -> None:
        if finding is not None:
            finding = by_law[law.name] = replace(finding, claimed=law.claimed_by(candidate))
        if progress:
            progress(law, finding)

    interrupted, why = False, INTERRUPTED_UNDECIDED
    try:
        if workers is not None or (jobs > 1 and len(chosen) > 1):
            named = scheme if isinstance(scheme, str) else candidate
            claimed = frozenset(candidate.claims)
            task = side_by_side.LawJob(named, claimed, effort, timeout, known.failures, problems, twin)
            _side_by_side(task, chosen, jobs if workers is None else workers, receive)
        else:
            run = Run(effort, **words_of(scheme, problems, WORKER))
            with overheard(timeout) as begin:
                for law in soonest(chosen):
                    receive(law, None)
                    begin()
                    ask = partial(measure, law, candidate, run, timeout, known.failures.get(law.name))
                    receive(law, survived(law, f"{law.name} of {target}", ask, effort, timeout))
    except KeyboardInterrupt:
        interruption_answered()
        interrupted = True
    except ClusterFailure as error:
        interrupted, why = True, str(error)
    for law in chosen:
        if law.name not in by_law:
            unmeasured = law.finding(Verdict.NOT_MEASURED, message=why)
            by_law[law.name] = replace(unmeasured, claimed=law.claimed_by(candidate))
    if not interrupted:
        along_paths(candidate, chosen, by_law, target, timeout)
    save_all()
    findings = asked_afresh(scheme, [by_law[law.name] for law in chosen], WORKER, problems, twin)
    named = target + twin.options if target and twin else target
    report = Report(candidate, findings, effort, interrupted, known.claims, named, required=required)
    gaps = known.gaps((law.name for law in chosen), candidate.name, report.problems)
    lost = why if why != INTERRUPTED_UNDECIDED else ""
    return replace(report, gaps=tuple(gaps), lost=lost)


def along_paths(
    scheme: Scheme,
    laws: Iterable[Law],
    findings: dict[str, Finding],
    target: str = "",
    timeout: float = 600.0,
) -> None:
    """Measure laws on the steps of paths that `findings` keep,
    and replace findings that these steps violate.
    """

    def on_step(law: Law, number: int, witness: dict[str, Any]) -> Finding:
        def replayed() -> Finding:
            try:
                with deadline(timeout):
                    return law.replay(law, scheme, witness)
            except (TimedOut, SepvError) as error:  # the law does not judge the step
                return law.finding(Verdict.NOT_MEASURED, message=str(error))

        return survived(law, f"{law.name} of {target} on step {number} of paths", replayed)

    replays(laws, findings, on_step)


def _check_arguments(jobs: Any, timeout: Any, effort: Any, expected: Any) -> None:
    require_whole("jobs", jobs, "jobs=2 for two cores")
    if not is_number(timeout) or not 0 < timeout <= MAX_SECONDS:
        raise UsageError(
            expected=f"timeout, seconds > 0 and ≤ {MAX_SECONDS:g}",
            received=f"{timeout!r:.80}",
            remedy="timeout=600",
        )
    if not isinstance(effort, Effort):
        raise UsageError(
            expected="effort, a sepv.Effort",
            received=f"{effort!r:.80}",
            remedy="effort=sepv.Effort(examples=20)",
        )
    if not isinstance(expected, str | Path | None):
        raise UsageError(
            expected="expected, a path", received=f"{expected!r:.80}", remedy='expected="pin.toml"'
        )


def _side_by_side(
    task: side_by_side.LawJob, chosen: list[Law], workers: Any, receive: Callable[[Law, Finding | None], None]
) -> None:
    """Measure groups of laws in workers; first the group of laws that share paths and the group
    that share steps.
    """
    by_name = {law.name: law for law in chosen}
    shared = [[name for name in by_name if name in family] for family in (SAMPLED_LAWS, LOCAL_LAWS)]
    groups = [group for group in shared if group]
    groups += [[name] for name in by_name if name not in (*SAMPLED_LAWS, *LOCAL_LAWS)]

    def take(name: str, result: Finding | Crashed | None) -> None:
        law = by_name[name]
        receive(law, crashed(law, result, task.effort) if isinstance(result, Crashed) else result)

    if isinstance(workers, int):
        side_by_side.run(task, groups, workers, take)
        return

    def arrived(_number: int, results: list[tuple[str, Any]]) -> None:
        for name, finding in results:
            take(name, None)
            take(name, finding)

    from sepv.workers import run_all  # imported here, because laws in one process do not need it

    run_all(partial(side_by_side.measured, task), groups, workers, threads=False, receive=arrived)


def load_in_time(
    scheme: str | Scheme | Step, claims: Iterable[str], timeout: float, problems: Any = None, target: str = "",
    twin: Twin | None = None,
) -> Scheme:  # fmt: skip
    """Load the scheme under a time limit: loading calls a bare function twice, to test batches;
    a call may hang.
    """
    try:
        with overheard(timeout), deadline(timeout):
            load = partial(load_candidate, scheme, listed(claims), problems, twin)
            return attempted(f"loading {target}", load, kept=False, seconds=timeout)
    except Crashed as crash:
        raise TargetError(
            expected="a scheme that can be loaded, and a step that comes back",
            received=f"nothing: the process {crash.status} while it was loaded",
            remedy="python -X faulthandler shows the line: import the module and call the step there",
        ) from None
    except TimedOut:
        raise TargetError(
            expected="a scheme that can be loaded, and a step that comes back",
            received=f"nothing: it did not come back within {timeout:g} s",
            remedy="a step of a small problem takes milliseconds; look for a loop that does not end",
        ) from None
    except Exception as error:
        if isinstance(error, SepvError) or not (changed := restored_names()):
            raise
        raise TargetError(
            expected="a step that leaves other modules as they are",
            received=f"a change of {changed}, and {type(error).__name__} in sepv, which uses it too",
            remedy="take nothing from NumPy that others use",
        ) from error


def load_candidate(
    scheme: str | Scheme | Step, claims: Iterable[str], problems: Any = None, twin: Twin | None = None
) -> Scheme:
    """Load the scheme under verification, with its problems and its twin,
    which it then claims to agree with.
    """
    given = () if problems is None else items(problems)
    fixed = [p for item in given for p in item.problems]
    found = load_scheme(scheme, (*claims, *OF_TWINS) if twin else claims, fixed)
    changes: dict[str, Any] = {} if problems is None else {"problems": given}
    if twin is not None:
        changes["twin"] = replace(twin, scheme=load_scheme(twin.scheme, (), fixed))
    return replace(found, **changes) if changes else found


def replay(
    scheme: str | Scheme | Step, law: str, witness: dict[str, Any], problems: Any = None, twin: Twin | None = None
) -> Finding:  # fmt: skip
    """Measure one law on one witness of a report; a UsageError if the witness belongs to another
    law.

    If the witness names its problem as module:attribute, `problems` must name it too, as for
    `verify`.
    """
    candidate = load_candidate(scheme, (), problems, twin)
    cases.require_named(witness, candidate)
    (chosen,) = load_laws([law])
    try:
        finding = survived(chosen, "the replay", partial(chosen.replay, chosen, candidate, witness))
    except KeyError as error:
        raise _wrong_witness(chosen, f"one without {error}") from error
    return replace(finding, claimed=chosen.claimed_by(candidate))


def survived(
    law: Law, key: str, ask: Callable[[], Finding], effort: Effort | None = None, seconds: float = math.inf
) -> Finding:
    """Return the finding of `ask`; if a crashed run is repeated, the stored finding or,
    for the crash, an error.
    """
    try:
        return attempted(key, ask, seconds=seconds)
    except Crashed as crash:
        return crashed(law, crash, effort or Effort())


def crashed(law: Law, crash: Crashed, effort: Effort) -> Finding:
    """The finding for a law whose process crashed, or was killed at its time limit:
    an error with the last case.
    """
    cause = "the scheme, or a library that it uses, crashed it"
    if crash.late:
        cause = "a step did not come back, or there were too many, and nothing interrupts compiled code, nor code "
        cause += "that catches every exception"
    lines = [f"the process {crash.status}: {cause}"]
    seen: dict[str, Any] = {"replay": f"--law {law.name} --seed {effort.seed} --paths {effort.paths}"}
    if isinstance(crash.note, dict):
        case = cases.from_json(crash.note)
        lines.append(case.describe())
        seen = {"witness": crash.note, "replay": f"--law {law.name} --replay {cases.to_token(case)}"}
    elif crash.note is not None:
        lines.append(crash.note)
    if crash.violated is not None:
        before = cases.from_json(crash.violated)
        again = f"Its replay: --law {law.name} --replay {cases.to_token(before)}"
        lines += ["violated, before:", before.describe(), again]
    if not crash.late:
        lines.append("Remedy: python -X faulthandler -m sepv verify … with the replay below shows the line")
    return law.finding(Verdict.ERROR, message="\n".join(lines), **seen)


def measure(
    law: Law, scheme: Scheme, run: Run, timeout: float = 600.0, failure: ExpectedFailure | None = None
) -> Finding:
    """Measure one law on one scheme: by a search, or on the stored witness alone if `failure` says
    that it fails.
    """
    start = time.perf_counter()
    try:
        with deadline(timeout):
            finding = law.replay(law, scheme, failure.witness) if failure else law.run(law, scheme, run)
        require_one_return()
    except TimedOut:
        text = f"stopped after {timeout:g} s (--timeout): a step did not come back, or there were too many steps; "
        text += "if the scheme divides long steps, state the longest one: Scheme(…, longest_step=…)"
        finding = law.finding(Verdict.ERROR, message=text)
    except Skipped as skipped:
        finding = law.finding(Verdict.NOT_APPLICABLE, message=str(skipped), skipped=1)
    except KeyError as error:
        if failure is None:
            raise
        raise _wrong_witness(law, f"one without {error}") from error
    except SepvError as error:
        if failure is not None and type(error) is UsageError:
            raise _wrong_witness(law, error.received) from error
        finding = law.finding(Verdict.ERROR, message=str(error), traceback=getattr(error, "traceback", ""))
    except Exception as error:
        if not (changed := restored_names()):
            raise  # a defect of sepv itself
        text = f"the scheme changed {changed}, which sepv uses too: {type(error).__name__} there. It is restored.\n"
        text += "Remedy: leave other modules as they are"
        finding = law.finding(Verdict.ERROR, message=text, traceback=format_exc())
    if failure:
        finding = replace(finding, expected=failure.reason)
        if finding.verdict is not Verdict.VIOLATED:
            note = f"expected to be violated ({failure.reason}), but its witness is not: remove the entry"
            finding = replace(finding, message=f"{note}\n{finding.message}".strip())
    return replace(finding, seconds=time.perf_counter() - start, along=taken(run, scheme))


def _wrong_witness(law: Law, received: str) -> UsageError:
    return UsageError(
        expected=f"a witness of the law {law.name}",
        received=received,
        remedy="copy what the report prints after --replay, or write the file anew with --pin or --write-expected",
    )
