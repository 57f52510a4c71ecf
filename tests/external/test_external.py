"""The door for other languages: real children, well-behaved and not. Whatever one does,
it ends as an error of its own, soon, and no process is left.
"""

import shlex
import signal
import subprocess
import sys
import time
from dataclasses import replace

import numpy as np
import pytest
from doors import ended

from sepv import SchemeFault, Skipped, UsageError, problems
from sepv.errors import ProtocolWarning
from sepv.external import _errors as errors
from sepv.external import check_protocol, load_program
from sepv.verification import LAWS, Effort, Run, Verdict, load_laws, measure, verify

# These programs end as they like.
pytestmark = pytest.mark.filterwarnings("ignore::sepv.errors.ProtocolWarning")
OSCILLATOR = problems.harmonic_oscillator()
Y, DW = np.array([1.0, 0.5]), np.array([0.25])
# Far below the time that any of these children would sleep, far above what a loaded machine needs.
SOON = 30.0
# What answers, answers; only where nothing comes a test waits for all of its time-out.
PATIENT = {"call_timeout": 20.0, "start_timeout": 20.0}
SHORT = 0.5
# A grandchild holds the pipe open, so that its parent's exit is seen when the time is over.
HELD_OPEN = 5.0

# What the children start with: every process notes its number, so that the test can look for it
# afterwards.
PREAMBLE = """
import json, os, signal, sys, time
from pathlib import Path
def note():
    with open(Path(__file__).with_suffix(".pids"), "a") as file: file.write(f"{os.getpid()}\\n")
note()
def read():
    return json.loads(sys.stdin.readline() or "null")
def put(text):
    os.write(1, text.encode() if isinstance(text, str) else text)
def say(**answer):
    put(json.dumps(answer) + "\\n")
def hello(**more):
    named = ["harmonic-oscillator", "rigid-body", "pendulum", "lotka-volterra"]
    say(**{"id": read()["id"], "protocol": 1, "scheme": "bad", "problems": named, **more})
def states(message):
    say(id=message["id"], y_next=[step["y"] for step in message["steps"]])
"""


@pytest.fixture
def child(tmp_path):
    """A function that makes a command of a child's code; in the end none of its processes may
    live.
    """
    script = tmp_path / "child.py"

    def make(code: str) -> str:
        script.write_text(PREAMBLE + code)
        return shlex.join([sys.executable, "-I", "-S", str(script)])

    yield make
    pids = script.with_suffix(".pids")
    assert not pids.exists() or ended(map(int, pids.read_text().split()))


def ask(command: str, lanes: int = 1, **options: float) -> np.ndarray:
    """One call of the program: the oscillator, one step or as many as lanes."""
    with load_program(command, **{**PATIENT, **options}) as scheme:
        if lanes == 1:
            return scheme.step(OSCILLATOR, Y, 0.5, DW)
        return scheme.step(OSCILLATOR, np.repeat(Y[:, None], lanes, 1), 0.5, np.repeat(DW[:, None], lanes, 1))


MISBEHAVIOUR = {
    "crashes": ("hello(); read(); os.kill(os.getpid(), signal.SIGSEGV)", errors.ProgramExit, "SIGSEGV"),
    "exits": ("hello(); read(); sys.exit(7)", errors.ProgramExit, "exit code 7"),
    "raises": ("hello(); read(); 1 / 0", errors.ProgramExit, "ZeroDivisionError"),
    "exits before hello": ("sys.exit(3)", errors.ProgramExit, "exit code 3"),
    "closes its stdout": ("hello(); read(); os.close(1); time.sleep(60)", errors.ProgramExit, "closed its output"),
    "sleeps": ("hello(); read(); time.sleep(60)", errors.CallTimeout, "nothing"),
    "sleeps through SIGTERM":
        ("signal.signal(signal.SIGTERM, signal.SIG_IGN); hello(); read(); time.sleep(60)",
         errors.CallTimeout, "nothing"),
    "ends no line": ("hello(); read(); put('{'); time.sleep(60)", errors.CallTimeout, "1 bytes without"),
    "leaves a grandchild":
        ("hello(); read()\nif os.fork() == 0:\n    note(); time.sleep(60)\nsys.exit(5)",
         errors.ProgramExit, "exit code 5"),
    "prints text": ("hello(); read(); put('step 1 of 1\\n')", errors.NotJson, "step 1 of 1"),
    "greets": ("put('Welcome\\n'); hello()", errors.NotJson, "Welcome"),
    "prints an empty line": ("hello(); read(); put('\\n')", errors.NotJson, "Expecting value"),
    "prints bytes": ("hello(); read(); put(b'\\xff\\xfe\\n')", errors.NotJson, "xff"),
    "prints a bare NaN": ("hello(); say(id=read()['id'], y_next=[[float('nan')]])", errors.NotJson, "NaN is not"),
    "prints half of it": ('hello(); read(); put(\'{"id":1,"y_n\\n\')', errors.NotJson, "Unterminated"),
    "nests deeply": ("hello(); read(); put('[' * 500000 + '\\n')", errors.NotJson, "deep to be read"),
    "prints a long integer": ("hello(); read(); put('9' * 10000 + '\\n')", errors.NotJson, "beyond binary64"),
    "prints a list": ("hello(); read(); put('[1]\\n')", errors.BadAnswer, "JSON object"),
    "takes another id": ("hello(); read(); say(id=99, skip='')", errors.WrongId, "message 1"),
    "gives no id": ("hello(); read(); say(skip='')", errors.WrongId, "message 1"),
    "gives true as id": ("hello(); read(); say(id=True, skip='')", errors.WrongId, "message 1"),
    "prints 10 MB": ("hello(); read(); put('x' * 10_000_000)", errors.LineTooLong, "1048576 bytes"),
    "prints a JSON line of 10 MB":
        ("hello(); say(id=read()['id'], skip='x' * 10_000_000)", errors.LineTooLong, "1048576 bytes"),
    "prints without end": ("hello(); read()\nwhile True: put('x' * 4096)", errors.LineTooLong, "1048576 bytes"),
    "answers nothing": ("hello(); say(id=read()['id'])", errors.BadAnswer, "exactly one of"),
    "answers twice over": ("hello(); say(id=read()['id'], skip='', error='')", errors.BadAnswer, "exactly one"),
    "skips without words": ("hello(); say(id=read()['id'], skip=1)", errors.BadAnswer, "exactly one of"),
    "answers decimals": ("hello(); say(id=read()['id'], y_next=[['0.1', '1']])", errors.BadAnswer, "hex float"),
    "answers numbers": ("hello(); say(id=read()['id'], y_next=[[1.0, 2.0]])", errors.BadAnswer, "hex float"),
    "answers null": ("hello(); say(id=read()['id'], y_next=None)", errors.WrongShape, "None"),
    "forgets a component": ("hello(); say(id=read()['id'], y_next=[['0x1p+0']])", errors.WrongShape, "2 numbers"),
    "forgets the outer list":
        ("hello(); say(id=read()['id'], y_next=['0x1p+0', '0x1p+0'])", errors.WrongShape, "1 states"),
    "answers nan": ("hello(); say(id=read()['id'], y_next=[['nan', '0x1p+0']])", errors.NotFiniteAnswer, "nan"),
    "answers -inf": ("hello(); say(id=read()['id'], y_next=[['-inf', '0x1p+0']])", errors.NotFiniteAnswer, "-inf"),
    "overflows": ("hello(); say(id=read()['id'], y_next=[['0x1p+0', '0x1p+1024']])", errors.NotFiniteAnswer, "1024"),
    "refuses": ("hello(); say(id=read()['id'], error='no \\x1b[31m root')", errors.StepRefused, r"\x1b[31m root"),
    "skips": ("hello(); say(id=read()['id'], skip='only d = 3')", Skipped, "only d = 3"),
    "takes other problems": ("hello(problems=['rigid-body']); read()", Skipped, "does not name"),
    "speaks protocol 2": ("hello(protocol=2)", errors.BadAnswer, "the number 1"),
    "has no name": ("hello(scheme='')", errors.BadAnswer, "1 to 80 printable"),
    "has escapes in its name": ("hello(scheme='\\x1b[31m')", errors.BadAnswer, "1 to 80 printable"),
    "claims an escape": ("hello(claims=['\\x1b[31m'])", errors.BadAnswer, "claims in hello"),
    "has a tolerance beyond binary64":
        ("hello(solver_tolerance='0x1p+999999')", errors.BadAnswer, "solver_tolerance in hello"),
    "greets with NaN": ("put('{\"id\": 0, \"protocol\": NaN}\\n')", errors.NotJson, "NaN is not"),
    "misspells a member": ("hello(claim=['energy'])", errors.BadAnswer, "claim in hello"),
    "claims a text": ("hello(claims='energy')", errors.BadAnswer, "a list of names"),
    "takes no problem": ("hello(problems=[])", errors.BadAnswer, "what the program can be asked"),
    "takes no steps": ("hello(max_steps=0)", errors.BadAnswer, "an integer ≥ 1"),
}  # fmt: skip


@pytest.mark.parametrize("name", MISBEHAVIOUR)
def test_each_misbehaviour_has_its_own_error_and_leaves_no_process(child, name):
    code, kind, text = MISBEHAVIOUR[name]
    command, start = child(code), time.perf_counter()
    wait = HELD_OPEN if "grandchild" in name else PATIENT["call_timeout"]
    with pytest.raises(kind) as caught:
        ask(command, call_timeout=SHORT if kind is errors.CallTimeout else wait)
    assert time.perf_counter() - start < SOON
    assert type(caught.value) is kind
    assert text in str(caught.value)
    assert "\x1b" not in str(caught.value)


@pytest.mark.parametrize("lanes", [1, 4000], ids=["a short message", "a message longer than a pipe holds"])
def test_a_child_that_never_reads_does_not_block(child, lanes):
    # It answers hello unasked, so that a step is sent at all.
    answer = "id=0, protocol=1, scheme='deaf', problems=['harmonic-oscillator'], max_steps=1024"
    command = child(f"say({answer}); time.sleep(60)")
    start = time.perf_counter()
    with pytest.raises((errors.NeverReads, errors.CallTimeout)) as caught:
        ask(command, lanes, call_timeout=SHORT)
    assert time.perf_counter() - start < SOON
    # Only Linux tells how much of a short message lies in the pipe.
    if lanes > 1 or sys.platform == "linux":
        assert type(caught.value) is errors.NeverReads


@pytest.mark.parametrize(
    ("code", "kind", "words"),
    [
        ("\nwhile True: put('{}\\n' * 1000)", errors.LineTooLong, "bytes"),
        ("; os.close(0); time.sleep(60)", errors.ProgramExit, "closed its input"),
    ],
    ids=["prints without end", "closes its stdin"],
)
def test_a_child_that_never_reads_a_long_message_is_found_out(child, code, kind, words):
    with pytest.raises(kind, match=words):
        ask(child(f"hello(max_steps=1024){code}"), lanes=4000)


def test_a_child_that_writes_before_it_reads_does_not_deadlock(child):
    # Both pipes are full at once: the child's answer and the message are longer than a pipe holds.
    code = """
hello(max_steps=1024)
put('{"id":1,"y_next":[' + ",".join('["0x1p+0","0x1.0000000000000000000000000000p+0"]' for _ in range(1024)))
read()
put(']}\\n')
time.sleep(60)
"""
    with load_program(child(code), **PATIENT) as scheme:
        answer = scheme.step(OSCILLATOR, np.ones((2, 1024)), 0.5, np.zeros((1, 1024)))
    assert np.array_equal(answer, np.ones((2, 1024)))


def test_stderr_is_free_and_its_end_is_shown(child):
    code = """
sys.stderr.write("x" * 1_000_000); hello(); read()
sys.stderr.write("\\nout of \\x07 memory"); sys.exit(1)
"""
    with pytest.raises(errors.ProgramExit, match=r"\| out of \\x07 memory") as caught:
        ask(child(code))
    assert len(str(caught.value)) < 3000


def test_a_line_too_many_is_found_out_at_the_next_message(child):
    code = "hello()\nwhile True: message = read(); states(message); states(message)"
    with load_program(child(code), **PATIENT) as scheme:
        assert np.array_equal(scheme.step(OSCILLATOR, Y, 0.5, DW), Y)
        with pytest.raises(errors.WrongId, match="message 2"):
            scheme.step(OSCILLATOR, Y, 0.5, DW)


def test_after_a_crash_a_fresh_program_is_asked(child):
    code = """
hello()
while True:
    message = read()
    if message["steps"][0]["y"][0] == (2.0).hex(): os.abort()
    states(message)
"""
    with load_program(child(code), **PATIENT) as scheme:
        for _ in range(3):
            with pytest.raises(errors.ProgramExit, match="SIGABRT"):
                scheme.step(OSCILLATOR, 2 * Y, 0.5, DW)
            assert np.array_equal(scheme.step(OSCILLATOR, Y, 0.5, DW), Y)


def test_the_run_has_a_time_of_its_own(child):
    with load_program(child("hello(); read(); time.sleep(60)"), call_timeout=60.0, run_timeout=3.0) as scheme:
        start = time.perf_counter()
        for _ in range(2):
            with pytest.raises(errors.RunTimeout, match="at most 3 s"):
                scheme.step(OSCILLATOR, Y, 0.5, DW)
        assert time.perf_counter() - start < SOON


def test_a_batch_is_split_into_messages_that_the_program_takes(child):
    code = """
hello(max_steps=3)
while message := read():
    assert len(message["steps"]) <= 3
    states(message)
"""
    y = np.random.default_rng(1).standard_normal((2, 10))
    with load_program(child(code), **PATIENT) as scheme:
        assert scheme.batched
        assert np.array_equal(scheme.step(OSCILLATOR, y, 0.5, np.zeros((1, 10))), y)
        with pytest.raises(Skipped, match="cannot travel"):
            scheme.step(replace(OSCILLATOR, data=None), Y, 0.5, DW)
    with pytest.raises(UsageError, match="within `with"):
        scheme.step(OSCILLATOR, Y, 0.5, DW)


@pytest.mark.parametrize(
    "command", ["./no-such-program", "{folder}", "{folder}/not-executable", "a\0b", "", "'unclosed"]
)
def test_a_program_that_cannot_be_started_is_named(tmp_path, command):
    (tmp_path / "not-executable").write_text("text")
    kind = UsageError if command in ("", "'unclosed") else errors.StartFailure
    with pytest.raises(kind, match="Expected"), load_program(command.format(folder=tmp_path)):
        pass


def test_wrong_shapes_and_nan_are_faults_of_the_scheme_and_all_else_is_not():
    for kind in (errors.WrongShape, errors.NotFiniteAnswer):
        assert issubclass(kind, SchemeFault)
    for kind in errors.ProgramError.__subclasses__():
        assert not issubclass(kind, SchemeFault)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_to_sepv_ends_the_program_too(child, number):
    command = child("hello(); read(); time.sleep(60)")
    script = (
        "import numpy as np; from sepv import external, problems\n"
        f"with external.load_program({command!r}) as scheme:\n"
        "    print('ready', flush=True)\n"
        "    scheme.step(problems.harmonic_oscillator(), np.ones(2), 0.5, np.ones(1))"
    )
    # A shell that starts jobs in the background has them ignore SIGINT, and nohup SIGHUP: here they
    # shall not.
    default = signal.default_int_handler if number == signal.SIGINT else signal.SIG_DFL
    before = signal.signal(number, default)
    process = subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True)
    signal.signal(number, before)
    with process:
        assert process.stdout.readline() == "ready\n"
        time.sleep(0.2)
        process.send_signal(number)
        assert process.wait(SOON) == -number


def test_a_law_that_runs_out_of_time_ends_the_program(child):
    """The law's time alone: what a scheme takes to be loaded is no part of it."""
    (law,) = load_laws(["energy"])
    with load_program(child("hello(); read(); time.sleep(60)"), call_timeout=60.0) as scheme:
        start = time.perf_counter()
        finding = measure(law, scheme, Run(Effort()), timeout=1.0)
        assert time.perf_counter() - start < SOON
    assert finding.verdict is Verdict.ERROR
    assert "stopped after 1 s" in finding.message


FEW = Effort(examples=3, paths=64, shrink_checks=3, corpus=False)


@pytest.mark.parametrize(
    ("code", "laws"),
    [
        ("os.abort()", "contract,energy,mean-square-order"),
        ("time.sleep(60)", "energy"),
        ("put('?\\n')", "contract"),
        ("put('x' * 2_000_000)", "mean-square-order"),
    ],
)
def test_a_broken_program_ends_in_the_verdict_error_and_exit_code_3(child, code, laws):
    command = child(f"hello(polynomial=True); read(); {code}")
    with load_program(command, call_timeout=0.2) as scheme:
        report = verify(scheme, laws=laws, effort=FEW)
    assert {f.verdict for f in report.findings} == {Verdict.ERROR}
    assert report.exit_code == 3


def test_a_crash_is_not_hidden_by_a_violation_of_the_same_law(child):
    code = (
        "hello(polynomial=True)\nwhile m := read():\n"
        "    if len(m['steps'][0]['y']) % 2 == 0: os.abort()\n"
        "    say(id=m['id'], y_next=[[(2 * float.fromhex(v)).hex() for v in s['y']] for s in m['steps']])"
    )
    with load_program(child(code), **PATIENT) as scheme:
        report = verify(scheme, laws=["energy"], effort=FEW)
    (finding,) = report.findings
    assert finding.verdict is Verdict.ERROR
    assert report.exit_code == 3
    crash, violation = finding.message.split("violated, elsewhere:\n")
    assert crash.startswith("crashed:\n")
    assert "SIGABRT" in crash
    assert "Its replay: --law energy --replay " in crash
    assert "h = " in violation
    # What is replayed beside the message is the violation.
    assert finding.defect > finding.bound
    assert finding.replay not in crash


def test_a_program_that_skips_everything_violates_nothing_and_holds_nothing(child):
    command = child("hello(polynomial=True)\nwhile m := read(): say(id=m['id'], skip='not today')")
    with load_program(command, **PATIENT) as scheme:
        report = verify(scheme, laws=["energy", "casimir", "mean-square-order"], effort=FEW)
    assert [f.verdict for f in report.findings] == [Verdict.NOT_APPLICABLE] * 3
    assert all("not today" in f.message for f in report.findings)


def test_a_program_without_polynomial_data_is_judged_on_the_problems_that_it_names(child):
    # A search over polynomials would be skipped 117 times and ask 8 cases. The child stays where it
    # is.
    command = child("hello(problems=['rigid-body', 'unheard-of'])\nwhile m := read(): states(m)")
    with load_program(command, **PATIENT) as scheme:
        assert scheme.problems == ("rigid-body",)
        (finding,) = verify(scheme, laws=["casimir"], effort=Effort(examples=5, paths=64)).findings
    assert finding.skipped == 0
    assert finding.checks >= 20


STAYS = "hello()\nwhile m := read(): states(m)"


@pytest.mark.parametrize(
    ("code", "line", "message"),
    [
        ("sys.exit(3)", '"type":"hello"', "exit code 3"),
        ("hello(claims=['enregy'])", '"type":"hello"', "enregy"),
        ("hello(problems=['rigid_body'])", '"type":"hello"', "rigid_body"),
        ("hello()\nwhile m := read(): say(id=m['id'], y_next=[['nan', 'nan']])", '"type":"step"', "finite"),
        ("hello(max_steps=8)\nn = 0\nwhile m := read():\n    n += 1\n    say(id=m['id'], "
         "y_next=[[(n * 1.0).hex()] * 2 for s in m['steps']])", '"type":"step"', "keep no state"),
        ("hello()\nwhile m := read(): say(id=m['id'], y_next=[['0x0p+0'] * 2 for s in m['steps']])",
         '"type":"step"', "print y, h and dW"),
        (STAYS, "no-such-problem", '"skip"'),
        (STAYS, "no-such-type", "KeyError"),
        (STAYS, '"type":"stop"', "exit code 0"),
        (f"{STAYS}\ntime.sleep(60)", "end of stdin", "no end within 2 s"),
    ],
)  # fmt: skip
def test_the_check_names_the_line_and_what_is_wrong(child, code, line, message):
    checks = check_protocol(child(code), call_timeout=5.0, laws=LAWS)
    found = [c for c in checks if not c.ok and line in c.line]
    assert found
    assert any(message in c.message for c in found)


@pytest.mark.parametrize(
    ("end", "how"), [("time.sleep(60)", "no end within 2 s"), ("sys.exit(5)", "exit code 5")]
)
def test_a_program_that_does_not_end_at_stop_is_told_so(child, end, how):
    with pytest.warns(ProtocolWarning, match=f"broke rule 7 of docs/protocol.md: {how} after stop"):
        ask(child(f"hello()\nwhile (m := read())['type'] != 'stop': states(m)\n{end}"))


def test_a_fork_starts_a_program_of_its_own(child):
    command = child("hello()\nwhile m := read(): say(id=m['id'], y_next=[[float(os.getpid()).hex()] * 2])")
    script = f"""
import os, numpy as np
from sepv import external, problems
def ask(): return scheme.step(problems.harmonic_oscillator(), np.ones(2), 0.5, np.ones(1))[0]
with external.load_program({command!r}) as scheme:
    first = ask()
    pid = os.fork()
    if pid == 0:
        other = ask()
        scheme.step.__self__.stop()
        os._exit(0 if other != first else 1)
    assert os.waitpid(pid, 0)[1] == 0, "the same program"
    assert ask() == first
"""
    # In a process of its own: one with threads should not fork.
    subprocess.run([sys.executable, "-c", script], check=True, timeout=60)


def test_a_check_shows_the_programs_own_error_first_and_blames_no_step_size(child):
    program = child("hello(); say(id=read()['id'], error='y is 0 and not a hex float')")
    (refused,) = [c for c in check_protocol(program, **PATIENT) if "hex float" in c.message and not c.ok][:1]
    assert refused.message.startswith("y is 0 and not a hex float\n")
    assert "smaller h" not in refused.message
    assert "print y, h and dW" in refused.message
