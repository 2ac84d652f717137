"""Waiting fails at once when there is nothing to wait for, and no test brings a limit of its own."""

import ast
import fcntl
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
import waiting
from hypothesis import HealthCheck, settings
from waiting import join, started, wait_until

TESTS = Path(__file__).parent
LIMITS = {"timeout", "deadline"}  # arguments that end something after a time
CLOCKS = {"time", "timeit", "sched"}  # modules
ALARMS = {"alarm", "setitimer"}  # methods


@pytest.fixture
def no_patience(monkeypatch):
    """Whatever makes no progress hangs."""
    monkeypatch.setattr(waiting, "HANG_S", 0.0)


def python(code: str, output: Path):
    return started(sys.executable, "-c", code, output=output)


def test_a_command_that_ends_before_what_is_waited_for_fails_with_its_output(tmp_path):
    with python("print('so far', flush=True); 1 / 0", tmp_path / "output.txt") as running:
        with pytest.raises(AssertionError, match=r"ended before the file is there:\nso far\n(.|\n)*division"):
            running.wait_until((tmp_path / "file").exists, "the file is there")
        assert running.wait() == 1


def test_what_comes_true_as_the_command_ends_is_seen(tmp_path):
    file = tmp_path / "file"
    with python(f"open({str(file)!r}, 'w')", tmp_path / "output.txt") as running:
        running.wait_until(lambda: not running.runs() and file.exists(), "the file is there")


def test_a_command_that_is_not_needed_any_more_is_killed_with_its_children(tmp_path):
    file = tmp_path / "held"
    child = f"""
import fcntl, threading
with open({str(file)!r}, "w") as file:
    fcntl.flock(file, fcntl.LOCK_EX)
    print("child", flush=True)
    threading.Event().wait()
"""
    code = f"import subprocess, sys; subprocess.run([sys.executable, '-c', {child!r}])"
    with python(code, tmp_path / "output.txt") as running:
        running.wait_until(lambda: "child" in running.said(), "the child begins")
        assert not is_free(file)
    wait_until(lambda: is_free(file), "the child ends")


def is_free(file: Path) -> bool:
    """Whether nobody holds the lock on a file."""
    with file.open("w") as opened:
        try:
            fcntl.flock(opened, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
    return True


@pytest.mark.usefixtures("no_patience")
def test_a_hang_is_named_with_the_output(tmp_path):
    with (
        python("import threading; threading.Event().wait()", tmp_path / "output.txt") as running,
        pytest.raises(AssertionError, match="no progress for 0 s before its end"),
    ):
        running.wait()


@pytest.mark.usefixtures("no_patience")
def test_progress_is_no_hang():
    numbers = iter(range(100))
    done = []
    wait_until(lambda: len(done) == 50, "50 looks", progress=lambda: done.append(next(numbers)) or len(done))


def test_a_thread_is_joined():
    event = threading.Event()
    thread = threading.Thread(target=event.wait)
    thread.start()
    event.set()
    join(thread)
    assert not thread.is_alive()


def limits(code: str) -> Iterator[tuple[int, str]]:
    """Line and text of every limit in seconds and every use of a clock in a test's source."""
    for node in ast.walk(ast.parse(code)):
        if isinstance(node, ast.Import):
            found = any(alias.name in CLOCKS for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            found = node.module in CLOCKS
        else:
            found = isinstance(node, ast.Call) and has_limit(node)
        if found:
            yield node.lineno, ast.unparse(node)


def has_limit(call: ast.Call) -> bool:
    method = call.func.attr if isinstance(call.func, ast.Attribute) else ""
    given = [keyword.value for keyword in call.keywords if keyword.arg in LIMITS]
    if method == "wait" or (method == "join" and call.args and isinstance(call.args[0], ast.Constant)):
        given += call.args[:1]
    return method in ALARMS or any(is_limit(part) for value in given for part in ast.walk(value))


def is_limit(value: ast.AST) -> bool:
    """A number, or a constant that is not the one in waiting.py."""
    if isinstance(value, ast.Constant):
        return isinstance(value.value, int | float)
    name = value.id if isinstance(value, ast.Name) else getattr(value, "attr", "")
    return name.isupper() and name != "HANG_S"


@pytest.mark.parametrize(
    "code",
    [
        "subprocess.run(command, timeout=60)",
        "subprocess.run(command, timeout=LONGEST)",
        "thread.join(0.2)",
        "event.wait(LONGEST)",
        "process.wait(timeout=60)",
        "process.wait(3 * 60)",
        "process.wait(workspace.LONGEST)",
        "settings(deadline=200)",
        "import time",
        "from time import sleep",
        "signal.alarm(3)",
    ],
)
def test_a_limit_is_found(code):
    assert [line for line, _ in limits(f"\n{code}\n")] == [2]


@pytest.mark.parametrize(
    "code",
    [
        "subprocess.run(command, timeout=HANG_S)",
        "event.wait(HANG_S)",
        "event.wait()",
        "', '.join(NAMES)",
        "subprocess.run(command, timeout=waiting.HANG_S)",
        "settings(deadline=None)",
    ],
)
def test_what_is_no_limit_is_allowed(code):
    assert list(limits(code)) == []


def test_no_test_has_a_limit_in_seconds():
    """See waiting.py for how to wait; what must be fast is a ratio in the benchmark."""
    found = [
        f"{path.relative_to(TESTS)}:{line}: {text}"
        for path in sorted(TESTS.rglob("*.py"))
        if path.name != "waiting.py"
        for line, text in limits(path.read_text())
    ]
    assert found == []


def test_generated_examples_are_the_same_every_time_and_may_take_any_time():
    assert settings.default.derandomize
    assert settings.default.deadline is None
    assert HealthCheck.too_slow in settings.default.suppress_health_check
