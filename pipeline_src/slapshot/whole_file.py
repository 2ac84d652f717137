"""Files that are there whole or not at all, whenever a process is ended."""

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A hidden path beside `path` to write a file or a folder to, which takes its place at the end.

    Args:
        path: what is to be written; a file that is there stays until then, a folder must not be.
    """
    aside = Path(tempfile.mkdtemp(prefix=f".{path.name}-", dir=path.parent))
    try:
        yield aside / path.name
        (aside / path.name).replace(path)
    finally:
        shutil.rmtree(aside, ignore_errors=True)


def write_whole(path: Path, text: str) -> None:
    """Write a text file at once."""
    with replacing(path) as aside:
        aside.write_text(text)
