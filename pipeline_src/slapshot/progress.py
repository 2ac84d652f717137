"""Progress of long steps: a bar on a terminal, elsewhere lines at intervals with the time left."""

import logging
import sys
import time
from collections.abc import Iterable, Iterator
from contextlib import ExitStack
from typing import Self, TypeVar

from rich.console import Console
from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn
from tqdm import tqdm

from slapshot.text import printable

T = TypeVar("T")
log = logging.getLogger("slapshot")

_SECONDS_BETWEEN_LINES = 10.0


def progress(items: Iterable[T], total: int, what: str, done: int = 0) -> Iterator[T]:
    """Yield the items, and show progress as they are consumed.

    Args:
        items: to yield.
        total: number of items, including those of earlier runs.
        what: name of the step.
        done: number of items that an earlier run finished.
    """
    if sys.stderr.isatty():
        yield from tqdm(items, total=total, initial=done, desc=what)
        return
    started = last = time.monotonic()
    for count, item in enumerate(items, start=1):
        yield item
        now = time.monotonic()
        if now - last >= _SECONDS_BETWEEN_LINES or done + count == total:
            left = (now - started) / count * (total - done - count)
            log.info("%s %d/%d, ETA %s", what, done + count, total, _readable(left))
            last = now


class Steps:
    """Steps of unknown duration: on a terminal one line with the elapsed time, elsewhere one line per step.

    with Steps() as steps:
        steps("fitting")
    """

    def __init__(self) -> None:
        self._began = time.monotonic()
        self._stack, self._line = ExitStack(), _line() if sys.stderr.isatty() else None

    def __enter__(self) -> Self:
        self._began = time.monotonic()
        if self._line is not None:
            self._stack.enter_context(self._line)
            self._line.add_task("starting")
        return self

    def __exit__(self, *error: object) -> None:
        self._stack.close()

    def __call__(self, text: str) -> None:
        """Begin a step described by `text`."""
        text = printable(text)
        if self._line is None:
            print(f"{time.monotonic() - self._began:5.0f} s  {text}", file=sys.stderr, flush=True)
        else:
            self._line.update(self._line.task_ids[0], description=text)


def _line() -> Progress:
    columns = (SpinnerColumn(), TextColumn("{task.description}", markup=False), TimeElapsedColumn())
    return Progress(*columns, console=Console(stderr=True), transient=True)


def _readable(seconds: float) -> str:
    if seconds < 100:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 6000 else f"{seconds / 3600:.1f} h"
