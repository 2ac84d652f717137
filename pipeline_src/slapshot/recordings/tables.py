"""Tables of a recording: Parquet or pandas in, columns of exactly the format's types out.

People write these files with many tools, so what holds the same values in another type is taken:
whole numbers stored as floats (pandas does that to integers with nulls), smaller floats, text as
categories, NaN for null where null is allowed. Everything else is refused with row and column.
"""

import re
from collections import Counter
from collections.abc import Container, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
from pyarrow.parquet import FileMetaData

from slapshot.errors import InputError, reading
from slapshot.parquet import open_table, write_table
from slapshot.recordings.format import HITS_SCHEMA, LONGEST_ID, OPTIONAL_COLUMNS, joint_schema
from slapshot.text import printable
from slapshot.validation import short

_ROWS_PER_GROUP = 128 * 1024
_INT64_LIMIT = 2.0**63
_MAX_FILE_BYTES, _MAX_FOOTER_BYTES = 8_000_000_000, 16_000_000  # bytes
# A damaged or hostile file of some kilobytes can unfold to more than any memory holds.
_MAX_COLUMNS, _MAX_VALUES, _MAX_BYTES = 1000, 100_000_000, 2_000_000_000
_MAX_JOINTS = 100
_TEXTS = {field.name for field in HITS_SCHEMA if pa.types.is_string(field.type)}


def read_parquet(file: Path) -> pa.Table:
    """Read a whole Parquet file as it is.

    Raises:
        InputError: If the file is no regular file, truncated, damaged, no Parquet at all, or too large.
    """
    with reading(file, "put a Parquet file there, or remove it", _MAX_FILE_BYTES):
        _check_footer(file)
        try:
            with open_table(file) as parquet:
                metadata = parquet.metadata
            _check_extent(metadata, file)
            # A long text may stand in every row, and only once in the file.
            texts = [name for name in metadata.schema.names if name in _TEXTS]
            with open_table(file, texts) as parquet:
                table = parquet.read()
            table.validate(full=True)
            for field in table.schema:  # names and time zones that are not UTF-8 raise only when read
                _ = field.name, getattr(field.type, "tz", None)
        except InputError:
            raise
        # A damaged file makes pyarrow raise nearly anything, from OSError to MemoryError.
        except Exception as error:
            reason = _reason(error)
            raise InputError(
                f"{file}: cannot be read as Parquet, it is damaged, cut short or of another kind "
                f"({reason}): copy or export it again"
            ) from error
    return table


def _check_footer(file: Path) -> None:
    """Refuse a footer so long that it would take minutes to parse: it lists every row group."""
    size = file.stat().st_size
    with file.open("rb") as stream:
        stream.seek(max(0, size - 8))
        footer, magic = int.from_bytes(stream.read(4), "little"), stream.read(4)
    if magic == b"PAR1" and _MAX_FOOTER_BYTES < footer < size:
        raise InputError(
            f"{file}: its list of row groups has {footer:,} bytes, and {_MAX_FOOTER_BYTES:,} are allowed: "
            "write it again with fewer, larger row groups"
        )


def _check_extent(metadata: FileMetaData, file: Path) -> None:
    """Refuse what would not fit into memory."""
    if metadata.num_columns > _MAX_COLUMNS:
        raise InputError(
            f"{file}: has {metadata.num_columns:,} columns, and {_MAX_COLUMNS:,} are allowed: remove those "
            "that are not in the format"
        )
    groups = [metadata.row_group(i) for i in range(metadata.num_row_groups)]
    columns = [group.column(i) for group in groups for i in range(metadata.num_columns)]
    for count, most, what in (
        (sum(column.num_values for column in columns), _MAX_VALUES, "values"),
        (sum(column.total_uncompressed_size for column in columns), _MAX_BYTES, "bytes when unpacked"),
    ):
        if count > most:
            raise InputError(
                f"{file}: has {count:,} {what}, and {most:,} are allowed: record fewer hits in one "
                "recording, or fewer rows a second"
            )


def write_parquet(table: pa.Table, file: Path) -> None:
    """Write a table in row groups that can be read alone."""
    write_table(table, file, row_group_size=_ROWS_PER_GROUP)


def table_from_frame(frame: pd.DataFrame, file: Path) -> pa.Table:
    """Arrow table of a DataFrame's columns, without its index; NaN becomes null.

    Raises:
        InputError: If a column's name stands twice, or its values are of no single type.
    """
    names = [str(name) for name in frame.columns]
    _check_names_unique(names, file)
    arrays = []
    for position, name in enumerate(names):
        try:
            arrays.append(pa.array(frame.iloc[:, position], from_pandas=True))
        except (pa.ArrowException, TypeError, ValueError, OverflowError) as error:
            reason = _reason(error)
            raise InputError(
                f"{file}: column {short(name)} mixes types ({reason}): give it values of one type"
            ) from error
    return pa.table(arrays, names=names)


def frame_from_table(table: pa.Table) -> pd.DataFrame:
    """DataFrame of a table that `conform` returned; nullable integers become Int64."""
    columns = {}
    for field in table.schema:
        nullable_int = field.nullable and pa.types.is_integer(field.type)
        mapper = {pa.int64(): pd.Int64Dtype()}.get if nullable_int else None
        columns[field.name] = table.column(field.name).to_pandas(types_mapper=mapper)
    return pd.DataFrame(columns)


def joint_schema_for(names: Sequence[str], file: Path) -> pa.Schema:
    """Schema of a joint table from its column names; the number of joints is free.

    Raises:
        InputError: If there is no joint column, or q0, q1, ... have a gap.
    """
    numbers = sorted({int(name[1:]) for name in names if re.fullmatch(r"q(0|[1-9]\d{0,3})", name)})
    if not numbers:
        raise InputError(f"{file}: column 'q0' is missing: add one column a joint, q0, q1, ...")
    if len(numbers) > _MAX_JOINTS:
        raise InputError(f"{file}: has {len(numbers)} joints, and {_MAX_JOINTS} are allowed: remove some")
    for expected, number in enumerate(numbers):
        if number != expected:
            raise InputError(
                f"{file}: column 'q{expected}' is missing although 'q{number}' is there: "
                "number the joints q0, q1, ... without a gap"
            )
    return joint_schema(len(numbers))


def conform(
    table: pa.Table,
    schema: pa.Schema,
    file: Path,
    optional: Container[str] = OPTIONAL_COLUMNS,
    unknown: str = "remove it",
) -> pa.Table:
    """The same table with exactly the columns, types and order of `schema`.

    Args:
        table: As read, with columns in any order.
        schema: What it should be.
        file: Named in errors.
        optional: Columns that may be absent, which are then null.
        unknown: What to do about a column that is not in the schema.

    Returns:
        A table in which floats are finite, and nulls stand only where the schema allows them.

    Raises:
        InputError: If a column is missing, unknown, of the wrong type or has a bad value.
    """
    _check_column_names(table.column_names, schema, file, optional, unknown)
    columns = []
    for field in schema:
        if field.name in table.column_names:
            columns.append(_conform_column(table.column(field.name), field, file))
        else:
            columns.append(pa.nulls(table.num_rows, field.type))
    return pa.Table.from_arrays(columns, schema=schema)


def _check_names_unique(names: Sequence[str], file: Path) -> None:
    for name, count in Counter(names).items():
        if count > 1:
            raise InputError(f"{file}: column {short(name)} is duplicated: remove one of them")


def _check_column_names(
    names: Sequence[str], schema: pa.Schema, file: Path, optional: Container[str], unknown: str
) -> None:
    _check_names_unique(names, file)
    for name in schema.names:
        if name not in names and name not in optional:
            unit = schema.field(name).metadata[b"unit"].decode()
            what = schema.field(name).metadata[b"description"].decode()
            in_unit = f", in {unit}" if unit not in ("", "1") else ""
            raise InputError(f"{file}: column {name!r} is missing: add it ({what}{in_unit})")
    for name in names:
        if name not in schema.names:
            hint = "write with index=False" if name.startswith("__index") else unknown
            raise InputError(
                f"{file}: column {short(name)} is not in the format: {hint} "
                f"(known: {', '.join(schema.names)})"
            )


def _conform_column(column: pa.ChunkedArray, field: pa.Field, file: Path) -> pa.Array:
    """One column in the type of its field, all its values allowed."""
    array = column.combine_chunks()
    if field.nullable and pc.all(pc.is_null(array, nan_is_null=True)).as_py() is not False:
        return pa.nulls(len(array), field.type)  # whatever type a tool gave to a column of nulls
    if not _same_kind(array.type, field.type):
        zone = pa.types.is_timestamp(array.type) and pa.types.is_timestamp(field.type)
        raise InputError(
            f"{file}: column {field.name!r} has type {_shown(str(array.type))}, not "
            f"{_type_word(field.type)}: "
            + ("give its times a time zone, such as UTC" if zone else "convert it")
        )
    if pa.types.is_string(field.type):
        _check_lengths(array, field, file)
    if pa.types.is_floating(array.type):
        array = _check_floats(array.cast(pa.float64()), field, file)
        if pa.types.is_integer(field.type):
            _check_whole(array, field, file)
    try:
        # Not safe for times only: nanoseconds lose what a microsecond does not hold.
        array = array.cast(field.type, safe=not pa.types.is_timestamp(field.type))
    except pa.ArrowException as error:
        reason = _reason(error)
        raise InputError(
            f"{file}: column {field.name!r} does not fit {_type_word(field.type)} ({reason}): convert it"
        ) from error
    if not field.nullable and array.null_count:
        row = _first(pc.is_null(array).to_numpy(zero_copy_only=False))
        or_nan = " or NaN" if pa.types.is_floating(field.type) else ""
        raise InputError(
            f"{file}: row {row} (the first is 0), column {field.name!r} is empty (null{or_nan}): "
            "fill it in or leave the row out"
        )
    return array


def _check_floats(array: pa.Array, field: pa.Field, file: Path) -> pa.Array:
    """Refuse infinity, and NaN where null is not allowed; elsewhere NaN becomes null."""
    values = array.to_numpy(zero_copy_only=False)
    empty = np.isnan(values)
    nan = empty & ~pc.is_null(array).to_numpy(zero_copy_only=False)
    bad = np.isinf(values) | (nan & (not field.nullable))
    if bad.any():
        row = _first(bad)
        word = "NaN" if nan[row] else "infinite"
        remedy = "leave the row out or correct it" + (", or use null" if field.nullable else "")
        raise InputError(f"{file}: row {row} (the first is 0), column {field.name!r} is {word}: {remedy}")
    return pa.array(values, mask=empty)


def _check_lengths(array: pa.Array, field: pa.Field, file: Path) -> None:
    """Refuse long texts, before each row gets its own copy."""
    texts = array.dictionary if pa.types.is_dictionary(array.type) else array
    longest = pc.max(pc.utf8_length(texts)).as_py() or 0
    if longest > LONGEST_ID:
        raise InputError(
            f"{file}: column {field.name!r} has a text of {longest:,} characters, and {LONGEST_ID} are "
            "allowed: shorten it"
        )


def _check_whole(array: pa.Array, field: pa.Field, file: Path) -> None:
    values = array.to_numpy(zero_copy_only=False)
    whole = np.isnan(values) | ((values == np.floor(values)) & (np.abs(values) < _INT64_LIMIT))
    if not whole.all():
        row = _first(~whole)
        raise InputError(
            f"{file}: row {row} (the first is 0), column {field.name!r} is {values[row]:g}, "
            "not a whole number: correct it"
        )


def _same_kind(found: pa.DataType, wanted: pa.DataType) -> bool:
    """Whether a column of type `found` may stand for one of type `wanted`."""
    types = pa.types
    if types.is_integer(wanted) or types.is_floating(wanted):
        return types.is_integer(found) or types.is_floating(found)
    if types.is_string(wanted):
        inner = found.value_type if types.is_dictionary(found) else found
        return types.is_string(inner) or types.is_large_string(inner) or types.is_string_view(inner)
    if types.is_timestamp(wanted):
        return types.is_timestamp(found) and found.tz is not None
    any_list = types.is_list(found) or types.is_large_list(found) or types.is_fixed_size_list(found)
    return any_list and _same_kind(found.value_type, wanted.value_type)


def _type_word(type_: pa.DataType) -> str:
    if pa.types.is_list(type_):
        return "a list of floats"
    if pa.types.is_timestamp(type_):
        return "a timestamp in UTC"
    return {pa.int64(): "a whole number", pa.float64(): "a float", pa.string(): "text"}[type_]


def _reason(error: Exception) -> str:
    """First line of what a library says, without the damaged bytes that it repeats."""
    return _shown((str(error).splitlines() or [type(error).__name__])[0])


def _shown(text: str) -> str:
    return printable(text[:200])


def _first(mask: np.ndarray) -> int:
    return int(np.flatnonzero(mask)[0])
