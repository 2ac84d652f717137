"""Parquet tables, written with a checksum in every page, which is verified when they are read.

Every table of the store is read and written here: a flipped bit on the disk ends a stage, and is never read
as another value.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from slapshot.errors import InputError

_COMPRESSION = "zstd"


def write_table(table: pa.Table | pd.DataFrame, path: Path, row_group_size: int | None = None) -> None:
    """Write a table; the index of a DataFrame is left out.

    Args:
        table: its rows.
        path: of the file.
        row_group_size: rows per group; None for pyarrow's default.
    """
    if isinstance(table, pd.DataFrame):
        table = pa.Table.from_pandas(table, preserve_index=False)
    pq.write_table(
        table, path, row_group_size=row_group_size, compression=_COMPRESSION, write_page_checksum=True
    )


def table_writer(path: Path, schema: pa.Schema) -> pq.ParquetWriter:
    """Writer of a table by row groups, for tables that do not fit into memory."""
    return pq.ParquetWriter(path, schema, compression=_COMPRESSION, write_page_checksum=True)


def read_table(path: Path, columns: Sequence[str] | None = None) -> pa.Table:
    """The rows of a file, or some of its columns.

    Raises:
        InputError: the file is missing or damaged.
    """
    with damage_named(path):
        return pq.read_table(
            path, columns=None if columns is None else list(columns), page_checksum_verification=True
        )


def read_frame(path: Path) -> pd.DataFrame:
    """The rows of a file as a DataFrame.

    Raises:
        InputError: the file is missing or damaged.
    """
    with damage_named(path):
        return pd.read_parquet(path, page_checksum_verification=True)


def open_table(path: Path, repeated: Sequence[str] = ()) -> pq.ParquetFile:
    """An open file, to be read in parts; wrap the reading in `damage_named`.

    Args:
        path: of the file.
        repeated: text columns to keep as dictionaries, because every row may repeat a long text.
    """
    return pq.ParquetFile(path, page_checksum_verification=True, read_dictionary=list(repeated))


@contextmanager
def damage_named(path: Path) -> Iterator[None]:
    """Context in which `path` is read: pyarrow's errors about a damaged file become one line.

    Raises:
        InputError: the file is missing or damaged.
    """
    try:
        yield
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; make the version that it belongs to again") from None
    except (OSError, ValueError, pa.ArrowException) as error:  # a damaged file raises any of them
        reason = " ".join(str(error).split())
        raise InputError(
            f"{path}: cannot be read, it is damaged or cut short ({reason}); "
            "if it lies in a store, run `slapshot versions verify --repair`"
        ) from error
