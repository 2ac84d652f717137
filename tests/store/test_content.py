"""Digests of Parquet files: of what they say, not of how they are stored."""

import hashlib
import itertools
import random

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
import pytest
from slapshot.store import content
from slapshot.store.content import content_digest, parquet_digest

ROWS = 1000
_random = random.Random(0)


def with_nulls(values):
    return [None if _random.random() < 0.3 else value for value in values]


def numbers():
    return [_random.gauss(0, 1) for _ in range(ROWS)]


def words():
    return [_random.choice(("", "a", "bb", "ccc", "ä")) for _ in range(ROWS)]


def lists(length=None):
    return [[_random.gauss(0, 1) for _ in range(length or _random.randrange(4))] for _ in range(ROWS)]


COLUMNS = {
    "double": pa.array(numbers()),
    "double with nulls": pa.array(with_nulls(numbers())),
    "float with nulls": pa.array(with_nulls(numbers()), pa.float32()),
    "integer with nulls": pa.array(with_nulls(range(ROWS)), pa.int32()),
    "boolean with nulls": pa.array(with_nulls([True, False] * (ROWS // 2))),
    "text": pa.array(words()),
    "text with nulls": pa.array(with_nulls(words())),
    "large text with nulls": pa.array(with_nulls(words()), pa.large_string()),
    "bytes with nulls": pa.array(with_nulls([word.encode() for word in words()])),
    "time with nulls": pa.array(with_nulls(range(ROWS)), pa.timestamp("us", "UTC")),
    "list": pa.array(lists()),
    "list with nulls": pa.array(with_nulls([with_nulls(value) for value in lists()])),
    "list of lists": pa.array(
        with_nulls([[[1, 2], [i]] for i in range(ROWS)]), pa.list_(pa.list_(pa.int16()))
    ),
    "fixed-size list": pa.array(lists(3), pa.list_(pa.float32(), 3)),
    "fixed-size list with nulls": pa.array(with_nulls(lists(3)), pa.list_(pa.float32(), 3)),
    "dictionary": pa.array(words()).dictionary_encode(),
    "dictionary with nulls": pa.array(with_nulls(words()))
    .dictionary_encode()
    .cast(pa.dictionary(pa.int8(), pa.string())),
    "struct with nulls": pa.array(with_nulls([{"a": i, "b": str(i)} for i in range(ROWS)])),
    "all null": pa.nulls(ROWS, pa.float64()),
}
STORAGE = {
    "one group": {},
    "small groups": {"row_group_size": 37},
    "other groups, zstd": {"row_group_size": 333, "compression": "zstd"},
    "plain": {"use_dictionary": False, "compression": "none", "write_statistics": False},
    "pages of version 2": {"data_page_version": "2.0", "data_page_size": 512, "row_group_size": 500},
}


@pytest.fixture(autouse=True)
def _many_batches(monkeypatch):
    monkeypatch.setattr(content, "_ROWS", 64)


@pytest.fixture
def digest(tmp_path):
    numbers = itertools.count()

    def digest(table: pa.Table, **storage) -> str:
        path = tmp_path / f"{next(numbers)}.parquet"
        pq.write_table(table, path, **storage)
        return parquet_digest(path)

    return digest


@pytest.mark.parametrize("name", COLUMNS)
def test_storage_does_not_count(digest, name):
    table = pa.table({"n": range(ROWS), "column": COLUMNS[name]})
    chunks = pa.concat_tables([table.slice(0, 13), table.slice(13, 800), table.slice(813)])
    noted = table.replace_schema_metadata({"written by": "somebody"})
    stored = {how: digest(table, **options) for how, options in STORAGE.items()}
    stored |= {"in chunks": digest(chunks), "chunks in groups": digest(chunks, row_group_size=101)}
    stored |= {"with metadata": digest(noted)}
    assert len(set(stored.values())) == 1, stored


@pytest.mark.parametrize("name", COLUMNS)
@pytest.mark.parametrize("row", [0, ROWS // 2, ROWS - 1])
def test_a_changed_value_counts(digest, name, row):
    column = COLUMNS[name]
    values = column.to_pylist()
    other = next((v for v in values if v is not None and v != values[row]), 1.0)
    values[row] = other
    changed = pa.table({"n": range(ROWS), "column": pa.array(values, column.type)})
    assert digest(changed) != digest(pa.table({"n": range(ROWS), "column": column}))


@pytest.mark.parametrize("name", [n for n in COLUMNS if "null" in n and n != "all null"])
def test_a_value_in_place_of_a_null_counts(digest, name):
    column = COLUMNS[name]
    values = column.to_pylist()
    empty = pc.index(column.is_null(), True).as_py()
    values[empty] = next(v for v in values if v is not None)
    assert digest(pa.table({"c": pa.array(values, column.type)})) != digest(pa.table({"c": column}))


@pytest.mark.parametrize("kind", [pa.float64(), pa.int8(), pa.string(), pa.list_(pa.float32(), 2)])
def test_a_nullable_column_without_nulls(digest, kind):
    """Writers may store a validity bitmap where nothing is null."""
    if pa.types.is_fixed_size_list(kind):
        array = pa.array([[1, 2]] * ROWS, kind)
    else:
        array = pa.array([i % 100 for i in range(ROWS)]).cast(kind)
    padded = pa.concat_arrays([array, pa.nulls(1, kind)]).slice(0, ROWS)
    assert padded.buffers()[0] is not None
    tables = [pa.table({"c": a}) for a in (array, padded)]
    assert len({digest(t, row_group_size=size) for t in tables for size in (ROWS, 7)}) == 1


def test_what_lies_under_a_null_does_not_count(digest):
    values = pa.array([1.0, 2.0, 3.0])
    hidden = pa.Array.from_buffers(pa.float64(), 3, [pa.py_buffer(b"\x05"), values.buffers()[1]])
    assert hidden.to_pylist() == [1.0, None, 3.0]
    assert digest(pa.table({"c": hidden})) == digest(pa.table({"c": pa.array([1.0, None, 3.0])}))


def test_the_order_of_a_dictionary_does_not_count(digest):
    words = ["b", "a", None, "c", "a", "b"] * 50
    first_seen = pa.array(words).dictionary_encode()
    codes = {"a": 0, "b": 1, "c": 2, None: None}
    dictionary = pa.array(["a", "b", "c", "never used"])
    alphabetic = pa.DictionaryArray.from_arrays(pa.array([codes[w] for w in words], pa.int32()), dictionary)
    assert first_seen.type == alphabetic.type
    tables = [pa.table({"c": array}) for array in (first_seen, alphabetic)]
    assert len({digest(t, row_group_size=size) for t in tables for size in (1000, 7)}) == 1


def test_names_types_and_orders_count(digest):
    a, b = pa.array([1, 2, 3], pa.int32()), pa.array([4, 5, 6], pa.int32())
    tables = [
        pa.table({"a": a, "b": b}),
        pa.table({"b": b, "a": a}),
        pa.table({"a": b, "b": a}),
        pa.table({"a": a, "c": b}),
        pa.table({"a": a, "b": b.cast(pa.int64())}),
        pa.table({"a": a[::-1], "b": b[::-1]}),
        pa.table({"a": a[:2], "b": b[:2]}),
        pa.table({"a": a}),
        pa.table({"a": a[:0]}),
        pa.table({"b": a[:0]}),
    ]
    assert len({digest(table) for table in tables}) == len(tables)


@pytest.mark.parametrize("rows", [63, 64, 65, 128, 129])
def test_rows_at_the_border_of_a_batch(digest, rows):
    table = pa.table({"n": range(rows)})
    assert len({digest(table, row_group_size=size) for size in (1, 63, 64, 65, 1000)}) == 1
    assert digest(table) != digest(table.slice(0, rows - 1))


def test_reading_and_writing_again_changes_nothing(tmp_path):
    first, second = tmp_path / "first.parquet", tmp_path / "second.parquet"
    fields = [pa.field("x", pa.float32(), nullable=False, metadata={"unit": "m"}), pa.field("s", pa.string())]
    pq.write_table(pa.table([numbers(), words()], schema=pa.schema(fields)), first)
    pq.write_table(pq.read_table(first), second, row_group_size=50)
    assert parquet_digest(first) == parquet_digest(second)


def test_other_files_count_byte_by_byte(tmp_path):
    file = tmp_path / "table.csv"
    file.write_bytes(b"a,b\n1,2\n")
    assert content_digest(file) == hashlib.sha256(b"a,b\n1,2\n").hexdigest()
    file.write_bytes(b"a,b\r\n1,2\r\n")
    assert content_digest(file) == hashlib.sha256(b"a,b\r\n1,2\r\n").hexdigest()


def test_parquet_is_told_by_its_suffix(tmp_path):
    file = tmp_path / "table.parquet"
    pq.write_table(pa.table({"n": [1, 2, 3]}), file)
    assert content_digest(file) == parquet_digest(file)
    assert content_digest(file) != hashlib.sha256(file.read_bytes()).hexdigest()
