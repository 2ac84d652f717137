"""Digests of the content of files, independent of how it is stored."""

import hashlib
from collections.abc import Iterator
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from slapshot.parquet import open_table
from slapshot.store.recipe import file_digest

_ROWS = 65_536


def content_digest(path: Path) -> str:
    """Hex sha256 of the Arrow content for Parquet, and of the bytes for all other files."""
    return parquet_digest(path) if path.suffix == ".parquet" else file_digest(path)


def parquet_digest(path: Path) -> str:
    """Digest of schema and values; row groups, compression and the writer's name do not count.

    The file is read in batches of rows, to limit memory.
    """
    digest = hashlib.sha256()
    with open_table(path) as file:
        schema = file.schema_arrow.remove_metadata()
        digest.update(str(schema).encode())
        for rows in _rebatched(file):
            # A separate IPC stream for each batch of fixed length is a canonical form of its values.
            sink = pa.BufferOutputStream()
            with pa.ipc.new_stream(sink, rows.schema) as writer:
                writer.write_table(rows, max_chunksize=_ROWS)
            digest.update(sink.getvalue())
    return digest.hexdigest()


def _rebatched(file: pq.ParquetFile) -> Iterator[pa.Table]:
    """Tables of exactly _ROWS rows (the last may be shorter), regardless of row groups."""
    waiting: list[pa.RecordBatch] = []
    count = 0
    for batch in file.iter_batches(batch_size=_ROWS):
        waiting.append(batch)
        count += batch.num_rows
        while count >= _ROWS:
            table = pa.Table.from_batches(waiting)
            yield _canonical(table.slice(0, _ROWS))
            rest = table.slice(_ROWS)
            waiting, count = rest.to_batches(), rest.num_rows
    if count:
        yield _canonical(pa.Table.from_batches(waiting))


def _canonical(table: pa.Table) -> pa.Table:
    """Copy to one chunk without offset or metadata, because slices keep their parents' buffers.

    Dictionary columns are decoded, because the order of a dictionary depends on how the file was written.
    """
    table = table.replace_schema_metadata(None)
    for i, field in enumerate(table.schema):
        if pa.types.is_dictionary(field.type):
            plain = field.type.value_type
            table = table.set_column(i, field.with_type(plain), table.column(i).cast(plain))
    indices = pa.array(range(table.num_rows), pa.int64())
    return table.take(indices).combine_chunks()
