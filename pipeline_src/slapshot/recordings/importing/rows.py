"""Rows of one CSV file: the named columns as numbers and texts, whatever stands in the others.

Read with Python's csv and not pandas: a row knows its line, rows may differ in length, and columns that
nobody named may hold anything.
"""

import csv
import io
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from slapshot.errors import InputError
from slapshot.recordings.importing.mapping import Column, CsvStyle, TrackMapping

Array = NDArray[np.float64]

_NOT_SEEN = {"", "nan", "na", "null", "none"}
# Memory that nobody wrote to reads as numbers like 1e-310 or 1e160. No tracker reports these.
_TINIEST, _LARGEST = 1e-30, 1e6
_LARGEST_TIME = 1e11  # s; clocks may count from 1970, in any unit


@dataclass(frozen=True)
class Rows:
    """The named columns of a file.

    Attributes:
        file: where they stand.
        lines: (n,) number of each row's line in the file, from 1.
        numbers: role -> (n,), in the recording's units, NaN where nothing was seen.
        texts: field -> n texts.
        cut_short: whether the last line was, which is then left out.
    """

    file: Path
    lines: NDArray[np.int64]
    numbers: dict[str, Array]
    texts: dict[str, list[str]]
    cut_short: bool


def read_rows(mapping: TrackMapping, file: Path) -> Rows:
    """Read the columns that a mapping names.

    Raises:
        InputError: The file cannot be read, lacks a column, or a named one holds what cannot be.
    """
    style = mapping.csv
    text = _text(file)
    if not text.strip():
        raise InputError(f"{file}: is empty; leave the file out, or export it again")
    rows = _split(text, style, file)
    names = _header(rows, mapping, file) if style.header else None
    places = {role: column.place for role, column in mapping.numbers.items()} | mapping.texts
    numbers = {role: _index(place, names, role, file) for role, place in places.items()}
    found = list(rows)
    # A number that is cut short is still a number, so the whole row goes.
    cut_short = len(found) > 1 and text[-1] not in "\r\n" and len(found[-1][1]) < len(found[-2][1])
    if cut_short:
        found.pop()
    last = max(numbers, key=lambda role: numbers[role])
    for line, row in found:
        if len(row) <= numbers[last]:
            raise InputError(
                f"{file}: line {line} has {len(row)} columns, but {last.strip('<>')} is column "
                f"{places[last]!r}, number {numbers[last]} (the first is 0); correct the mapping, "
                "csv.delimiter or that line"
            )
    cells = [[row[i] for i in numbers.values()] for _, row in found]
    columns = dict(zip(numbers, zip(*cells, strict=True), strict=True)) if cells else {}
    if not columns:
        raise InputError(f"{file}: has no rows; leave the file out, or correct csv in the mapping")
    number = np.array([line for line, _ in found])
    return Rows(
        file=file,
        lines=number,
        numbers={
            role: _numbers(columns[role], column, role, style, file, number)
            for role, column in mapping.numbers.items()
        },
        texts={role: [text.strip() for text in columns[role]] for role in mapping.texts},
        cut_short=cut_short,
    )


def _text(file: Path) -> str:
    try:
        raw = file.read_bytes()
    except OSError as error:
        raise InputError(f"{file}: cannot be read ({error.strerror}); check the path") from None
    if b"\0" in raw[:4096]:
        raise InputError(f"{file}: is binary or UTF-16, not plain text; save it as CSV in UTF-8")
    # Damaged letters matter in no number, and a damaged number is refused with its line.
    return raw.decode("utf-8-sig", errors="replace")


def _split(text: str, style: CsvStyle, file: Path) -> Iterator[tuple[int, list[str]]]:
    """Line numbers and cells of all rows that are not blank."""
    if style.delimiter is None:
        for number, whole in enumerate(io.StringIO(text), 1):
            if number > style.skip_rows and whole.strip():
                yield number, whole.split()
        return
    source = io.StringIO(text, newline="")
    for _ in range(style.skip_rows):
        source.readline()
    reader = csv.reader(source, delimiter=style.delimiter)
    try:
        for row in reader:
            if any(cell.strip() for cell in row):
                yield style.skip_rows + reader.line_num, row
    except csv.Error as error:
        line = style.skip_rows + reader.line_num
        raise InputError(f"{file}: line {line} is no CSV ({error}); mend that line") from None


def _header(rows: Iterator[tuple[int, list[str]]], mapping: TrackMapping, file: Path) -> list[str]:
    names = [name.strip() for name in next(rows, (0, []))[1]]
    if names and all(re.fullmatch(r"[-+.,\deE]*", name) for name in names):
        raise InputError(
            f"{file}: the first row holds numbers, no names; write csv: {{header: false}} in {mapping.file}"
        )
    return names


def _index(place: str | int, names: list[str] | None, role: str, file: Path) -> int:
    """Number of a column."""
    if isinstance(place, int):
        return place
    names = names or []
    if names.count(place) != 1:
        problem = "stands there twice; name it by its number" if place in names else "is missing"
        raise InputError(
            f"{file}: column {place!r} ({role.strip('<>')}) {problem}; correct the mapping or the file "
            f"(columns: {', '.join(names)[:200]})"
        )
    return names.index(place)


def _numbers(
    cells: tuple[str, ...], column: Column, role: str, style: CsvStyle, file: Path, lines: NDArray[np.int64]
) -> Array:
    """One column in the recording's unit; refuses what is no number or cannot be one."""
    values = np.empty(len(cells))
    limit = _LARGEST_TIME if role == "t" else _LARGEST
    for i, cell in enumerate(cells):
        text = cell.strip()
        if text.lower() in _NOT_SEEN or text in style.missing:
            values[i] = math.nan
            continue
        where = f"{file}: line {lines[i]}, column {column.place!r} ({role})"
        try:
            value = float(text.replace(",", ".") if style.decimal == "," else text)
        except ValueError:
            raise InputError(
                f"{where}: {text[:40]!r} is no number; mend the line, or list the text under csv.missing"
            ) from None
        scaled = column.factor * value + column.offset
        if 0 < abs(value) < _TINIEST or not abs(scaled) <= limit:
            raise InputError(
                f"{where}: {text[:40]} cannot be: it looks like memory that nobody wrote to; name another "
                "column, mend the line, or list the text under csv.missing"
            )
        values[i] = scaled
    return values
