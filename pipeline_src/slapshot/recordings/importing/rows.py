"""Rows of one CSV file: the named columns as numbers and texts; other columns are ignored.

Read with Python's csv and not pandas: a row knows its line, rows may differ in length, and columns that
are not named may hold anything.
"""

import csv
import io
import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from slapshot.arrays import Array
from slapshot.errors import InputError, reading
from slapshot.recordings.importing.mapping import MAX_TEXT, CsvStyle, ScaledColumn
from slapshot.validation import short

_NOT_SEEN = {"", "nan", "na", "null", "none", "-nan", "nan(ind)", "-nan(ind)"}  # as C prints it, too
_MAX_FILE_BYTES = 200_000_000  # bytes
_DAMAGED = "\ufffd"
# A clock may define the order of hits, and the start position may be the first of the positions.
_MAY_SHARE = {("t", "order"), ("x", "start_x"), ("y", "start_y")}
_LARGEST_TIME = 1e11  # s; clocks may count from 1970, in any unit


class NamedColumns(Protocol):
    """The columns of a file, as defined by a mapping."""

    @property
    def csv(self) -> CsvStyle:
        """What the file looks like."""

    @property
    def file(self) -> Path:
        """The mapping's own."""

    @property
    def numbers(self) -> Mapping[str, ScaledColumn]:
        """Role -> column of numbers; t is the time in s."""

    @property
    def texts(self) -> Mapping[str, str | int]:
        """Field, or a role in brackets such as <hit> -> column of texts."""

    @property
    def sizes(self) -> tuple[float, float]:
        """Least and largest size of a number other than 0 and t: others are uninitialised memory."""

    def location_of(self, role: str) -> str:
        """File, line and key of the mapping where a role's column is named."""


@dataclass(frozen=True)
class Rows:
    """The named columns of a file.

    Attributes:
        file: where they stand.
        lines: (n,) number of each row's line in the file, from 1.
        numbers: role -> (n,), in the recording's units, NaN where nothing was seen.
        texts: field -> n texts.
        cut_short: whether the last line was, which is then left out.
        longest_row: lines that the longest row goes over; more than 1 only between quotes.
    """

    file: Path
    lines: NDArray[np.int64]
    numbers: dict[str, Array]
    texts: dict[str, list[str]]
    cut_short: bool
    longest_row: int


def read_rows(mapping: NamedColumns, file: Path) -> Rows:
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
    numbers = {role: _index(column.column, names, role, file) for role, column in mapping.numbers.items()}
    texts = {role: _index(place, names, role, file) for role, place in mapping.texts.items()}
    _check_apart(numbers, mapping)
    places = [*numbers.values(), *texts.values()]
    last = max(places)
    # Where rows are counted, one without any value took its time all the same.
    are_counted = "t" not in numbers and not texts
    found: list[_Row] = []
    lengths = [0]
    for row in rows:
        if row.is_blank:
            if not are_counted:
                continue
            row = replace(row, cells=[""] * max(len(row.cells), last + 1))
        _check_header_fits(row, names, style, file)
        lengths.append(len(row.cells))
        # A file may have a million columns, of which a few are wanted.
        found.append(replace(row, cells=[row.cells[i] for i in places] if lengths[-1] > last else []))
    # A number that is cut short is still a number, so the whole row goes.
    cut_short = len(found) > 1 and text[-1] not in "\r\n" and lengths[-1] < lengths[-2]
    if cut_short:
        found.pop()
    for row, length in zip(found, lengths[1:], strict=False):
        if not row.cells:
            role = next(role for role, place in (numbers | texts).items() if place == last)
            raise InputError(
                f"{file}: line {row.line} has {length} columns, but {role.strip('<>')} is number {last} (the "
                "first is 0); correct the mapping, csv.delimiter or that line"
            )
    if not found:
        raise InputError(f"{file}: has no rows; leave the file out, or correct csv in the mapping")
    columns = list(zip(*(row.cells for row in found), strict=True))
    lines = np.array([row.line for row in found])
    return Rows(
        file=file,
        lines=lines,
        numbers={
            role: _numbers(cells, role, mapping, file, lines)
            for role, cells in zip(numbers, columns, strict=False)
        },
        texts={
            role: _texts(cells, role, file, lines)
            for role, cells in zip(texts, columns[len(numbers) :], strict=True)
        },
        cut_short=cut_short,
        longest_row=max(row.over for row in found),
    )


@dataclass(frozen=True)
class _Row:
    """Cells of a row, its last line in the file, and how many lines it goes over."""

    line: int
    over: int
    cells: list[str]

    @property
    def is_blank(self) -> bool:
        """Whether it has no value."""
        return not any(cell.strip() for cell in self.cells)


def _text(file: Path) -> str:
    remedy = "give a CSV file, or the folder that holds such files"
    if file.is_file() and file.stat().st_size > _MAX_FILE_BYTES:
        remedy = "split it into episodes, or leave out columns and rows that are not needed"
    with reading(file, remedy, _MAX_FILE_BYTES):
        raw = file.read_bytes()
    if b"\0" in raw:
        raise InputError(f"{file}: is binary or UTF-16, not plain text; save it as CSV in UTF-8")
    # Damaged letters matter in no number, and a damaged number is refused with its line.
    return raw.decode("utf-8-sig", errors="replace")


def _split(text: str, style: CsvStyle, file: Path) -> Iterator[_Row]:
    """All rows that are not empty; those of blank cells among them."""
    if style.separator is None:
        for number, whole in enumerate(io.StringIO(text, newline=None), 1):
            if number > style.skip_rows and whole.strip():
                yield _Row(number, 1, whole.split())
        return
    source = io.StringIO(text, newline="")
    for _ in range(style.skip_rows):
        source.readline()
    # Strict: an unclosed quote would swallow all following rows.
    reader = csv.reader(source, delimiter=style.separator, strict=True)
    before = 0
    try:
        for cells in reader:
            if len(cells) > 1 or any(cell.strip() for cell in cells):
                yield _Row(style.skip_rows + reader.line_num, reader.line_num - before, cells)
            before = reader.line_num
    except csv.Error as error:
        line = style.skip_rows + before + 1
        raise InputError(f"{file}: line {line} is no CSV ({error}); correct that line") from None


def _check_apart(numbers: dict[str, int], mapping: NamedColumns) -> None:
    """Refuse a column that is to be two things at once."""
    for a, b in combinations(numbers, 2):
        if numbers[a] == numbers[b] and (a, b) not in _MAY_SHARE:
            raise InputError(
                f"{mapping.location_of(b)}: takes the column of {a}, {mapping.numbers[b].column!r}; "
                "name another one"
            )


def _check_header_fits(row: _Row, names: list[str] | None, style: CsvStyle, file: Path) -> None:
    """Refuse rows whose cells are not those that the header names, such as 0,5 for a half."""
    if names is None:
        return
    more = any(cell.strip() for cell in row.cells[len(names) :])
    fewer = style.separator is None and len(row.cells) < len(names)
    if more or fewer:
        raise InputError(
            f"{file}: line {row.line} has {len(row.cells)} columns, but the header names {len(names)}; "
            "correct "
            "the line, or correct csv.delimiter and csv.decimal"
        )


def _header(rows: Iterator[_Row], mapping: NamedColumns, file: Path) -> list[str]:
    first = next((row for row in rows if not row.is_blank), None)
    names = [name.strip() for name in first.cells] if first else []
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
        problem = "is duplicated; name it by its number" if place in names else "is missing"
        raise InputError(
            f"{file}: column {short(place)} ({role.strip('<>')}) {problem}; correct the mapping or the file "
            f"(columns: {', '.join(names[:50])[:200]})"
        )
    return names.index(place)


def _numbers(
    cells: tuple[str, ...], role: str, mapping: NamedColumns, file: Path, lines: NDArray[np.int64]
) -> Array:
    """One column in the recording's unit; refuses what is no number or cannot be one."""
    values = np.empty(len(cells))
    column, style = mapping.numbers[role], mapping.csv
    least, limit = mapping.sizes
    if role in ("t", "order"):
        limit = _LARGEST_TIME
    for i, cell in enumerate(cells):
        text = cell.strip()
        if text.lower() in _NOT_SEEN or text in style.missing:
            values[i] = math.nan
            continue
        where = f"{file}: line {lines[i]}, column {short(column.column)} ({role})"
        try:
            value = _number(text, style.decimal)
        except ValueError:
            raise InputError(
                f"{where}: {text[:40]!r} is no number; correct the line, correct csv.decimal, or list the "
                "text "
                "under csv.missing"
            ) from None
        scaled = column.factor * value + column.offset
        if role == "t" and limit < abs(scaled) < math.inf:
            raise InputError(
                f"{where}: {text[:40]} is too large for a time in s; correct its unit (ms, us or ns)"
            )
        if 0 < abs(value) < least or not abs(scaled) <= limit:
            raise InputError(
                f"{where}: {text[:40]} cannot be: it looks like uninitialised memory; name another "
                "column, correct the line, or list the text under csv.missing"
            )
        values[i] = scaled
    return values


def _number(text: str, decimal: str) -> float:
    """The number that a person reads there; Python would read more, such as 1_000.

    Raises:
        ValueError: It is none.
    """
    if not text.isascii() or "_" in text or (decimal == "," and "." in text):
        raise ValueError
    return float(text.replace(decimal, "."))


def _texts(cells: tuple[str, ...], role: str, file: Path, lines: NDArray[np.int64]) -> list[str]:
    """One column as texts; refuses what is too long, or was no UTF-8: two such texts may look equal."""
    for line, cell in zip(lines, cells, strict=True):
        if _DAMAGED in cell or len(cell) > MAX_TEXT:
            problem = "is not UTF-8" if _DAMAGED in cell else f"has {len(cell):,} characters"
            raise InputError(
                f"{file}: line {line}, {role.strip('<>')}: {short(cell)} {problem}; save the file as UTF-8, "
                f"with texts of at most {MAX_TEXT} characters"
            )
    return [cell.strip() for cell in cells]
