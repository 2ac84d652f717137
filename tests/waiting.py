"""How tests wait: for an event or for progress. The only limit in seconds of all tests stands here."""

import contextlib
import os
import signal
import subprocess
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from threading import Thread

HANG_S = 3600.0  # without any progress, so that a machine that is slow or busy never reaches it
_LOOK_S = 0.005  # between two looks at what is waited for


def wait_until(
    condition: Callable[[], bool],
    what: str,
    alive: Callable[[], bool] = lambda: True,
    progress: Callable[[], object] = lambda: None,
    said: Callable[[], str] = lambda: "",
) -> None:
    """Wait until a condition holds.

    Args:
        condition: what is waited for.
        what: the condition in words, for the message.
        alive: whether who brings it about still runs; once they have ended, the wait fails at once.
        progress: any value; the limit starts again whenever it changes.
        said: output of who brings it about, for the message.

    Raises:
        AssertionError: they ended before the condition held, or made no progress for `HANG_S`.
    """
    since, last = time.monotonic(), progress()
    while True:
        lives = alive()  # before the condition, which may come true just before the end
        if condition():
            return
        assert lives, f"ended before {what}:\n{said()}"
        now, new = time.monotonic(), progress()
        if new != last:
            since, last = now, new
        assert now - since <= HANG_S, f"no progress for {HANG_S:g} s before {what}:\n{said()}"
        time.sleep(_LOOK_S)


def join(thread: Thread) -> None:
    """Wait until a thread has ended."""
    wait_until(lambda: not thread.is_alive(), f"{thread.name} ends")


class Command:
    """A command whose output goes to a file; new output is its progress.

    Attributes:
        process: leader of a process group of its own.
        output: file with its output and errors.
    """

    def __init__(self, process: subprocess.Popen[bytes], output: Path) -> None:
        self.process = process
        self.output = output

    def runs(self) -> bool:
        return self.process.poll() is None

    def said(self) -> str:
        return self.output.read_text(errors="replace")

    def wait_until(self, condition: Callable[[], bool], what: str) -> None:
        """Wait for something that the command brings about before it ends."""
        wait_until(condition, what, self.runs, lambda: self.output.stat().st_size, self.said)

    def wait(self) -> int:
        """Wait until the command has ended; its exit code."""
        self.wait_until(lambda: not self.runs(), "its end")
        return self.process.returncode


@contextlib.contextmanager
def started(
    *command: str | Path, output: Path, cwd: Path | None = None, env: Mapping[str, str] | None = None
) -> Iterator[Command]:
    """A command that runs, and is killed with all its children when the block ends."""
    with output.open("w") as file:
        process = subprocess.Popen(
            command,
            cwd=cwd,
            env=env,
            stdin=subprocess.DEVNULL,
            stdout=file,
            stderr=file,
            start_new_session=True,
        )
    try:
        yield Command(process, output)
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
