"""Lists of cases with hidden effects: CSV files, read with one-line error messages, written, and drawn once.

Only a lab reads the hidden effects of a row: a case is named by its number only, and rows are in random
order, so that nothing that a diagnosis reads reveals the condition of a case.
"""

import argparse
import csv
import io
import sys
from collections.abc import Callable, Collection, Iterable, Sequence
from pathlib import Path
from typing import Protocol, TypeVar

from slapshot.errors import InputError, check_writable, reading, writing
from slapshot.validation import short

JOIN = "+"
_LONGEST = 10_000_000  # bytes, far more than any list needs


class _Named(Protocol):
    @property
    def case(self) -> str: ...


_Case = TypeVar("_Case", bound=_Named)


def read_list(
    file: Path, columns: Sequence[str], case_of: Callable[[dict[str, str], str], _Case], example: str
) -> list[_Case]:
    """The cases of a list, in its order.

    Args:
        file: CSV file.
        columns: required columns.
        case_of: makes a case from a row's values by column, and from its file and line, for messages.
        example: an existing list, for messages.

    Raises:
        InputError: there is no such file, or a row is invalid; the message is one line.
    """
    with reading(file, f"name a list of cases (CSV), such as {example}", _LONGEST):
        data = file.read_bytes()
    reader = csv.reader(io.StringIO(_text(data, file), newline=""), strict=True)
    cases: dict[str, _Case] = {}
    expected = ", ".join(columns)
    try:
        head = next(reader, [])
        if head != list(columns):
            raise InputError(f"{file}:1: columns are {short(', '.join(head))}; write {expected}")
        for values in filter(None, reader):
            where = f"{file}:{reader.line_num}"
            if len(values) != len(columns):
                raise InputError(f"{where}: has {len(values)} values; write {len(columns)}: {expected}")
            case = case_of(dict(zip(columns, values, strict=True)), where)
            if case.case in cases:
                raise InputError(f"{where}: case {case.case} stands twice; give every case a name of its own")
            cases[case.case] = case
    except csv.Error as error:
        raise InputError(f"{file}:{reader.line_num}: not valid CSV ({error}); mend that line") from None
    if not cases:
        raise InputError(f"{file}: holds no case; add a row")
    return list(cases.values())


def _text(data: bytes, file: Path) -> str:
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise InputError(f"{file}:{line}: not a text in UTF-8; save it as one") from None


def number(text: str) -> int | float | str:
    """A text as a number, or unchanged if it is none."""
    for read in (int, float):
        try:
            return read(text)
        except ValueError:
            continue
    return text


def concealed_of(text: str, size: str) -> list[dict[str, int | float | str]]:
    """Hidden effects of a cell, each with its kind and, under the key `size`, its size."""
    pairs = [part.partition(":") for part in text.split(JOIN) if part]
    return [{"kind": kind, size: number(value)} for kind, _, value in pairs]


def concealed_text(conceals: Iterable[tuple[str, float]]) -> str:
    """The cell for hidden effects given by kind and size."""
    return JOIN.join(f"{kind}:{size:g}" for kind, size in conceals)


def write_list(rows: Iterable[Iterable[object]], columns: Sequence[str], file: Path) -> None:
    """Write a list."""
    with file.open("w", newline="", encoding="utf-8") as out:
        writer = csv.writer(out, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(rows)


def write_new(file: Path, write: Callable[[Path], None]) -> None:
    """Write a drawn list to a new file, completely or not at all.

    Raises:
        InputError: the file exists, or cannot be written.
    """
    if file.exists():
        raise InputError(f"{file}: exists already; seeds are drawn once, so name another file or remove it")
    check_writable(file)
    with writing(file):
        file.parent.mkdir(parents=True, exist_ok=True)
        aside = file.with_name(f".{file.name}")
        write(aside)
        aside.rename(file)


def draw_command(program: str, lists: Collection[str], draw: Callable[[str, Path], None]) -> None:
    """Command line that draws one of several lists."""
    parser = argparse.ArgumentParser(prog=f"python -m {program}")
    parser.add_argument("file", type=Path)
    parser.add_argument("--list", choices=lists, default="full")
    args = parser.parse_args()
    try:
        draw(args.list, args.file)
    except InputError as error:
        print(error, file=sys.stderr)
        sys.exit(1)
