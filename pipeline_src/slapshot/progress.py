"""Progress of long steps: a bar on a terminal, timed lines with the time left everywhere else."""

import logging
import sys
import time
from collections.abc import Iterable, Iterator
from typing import TypeVar

from tqdm import tqdm

T = TypeVar("T")
log = logging.getLogger("slapshot")

_SECONDS_BETWEEN_LINES = 10.0


def progress(items: Iterable[T], total: int, what: str, done: int = 0) -> Iterator[T]:
    """The items, with progress shown as they are consumed.

    Args:
        items: what to go through.
        total: number of items, those of earlier runs included.
        what: name of the step.
        done: items that an earlier run finished.
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


def _readable(seconds: float) -> str:
    if seconds < 100:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 6000 else f"{seconds / 3600:.1f} h"
