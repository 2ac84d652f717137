"""Parquet tables: a damaged page ends the reading, and every table of the package goes through here."""

import random
import re
from collections import Counter
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from slapshot.errors import InputError
from slapshot.parquet import damage_named, open_table, read_frame, read_table, table_writer, write_table

PACKAGE = Path(__file__).parents[1] / "pipeline_src/slapshot"
DOORS = re.compile(
    r"\b(pd\.read_parquet|\.to_parquet|pq\.(write_table|read_table|ParquetWriter\(|ParquetFile\())"
)


def frame() -> pd.DataFrame:
    rng = np.random.default_rng(0)
    return pd.DataFrame(
        {
            "x": rng.normal(size=3000),
            "latent": list(rng.normal(size=(3000, 3))),
            "method": rng.choice(["kalman", "lstm"], 3000),
        },
        index=rng.permutation(3000),
    )


def written(folder: Path, way: str) -> Path:
    path = folder / f"{way}.parquet"
    if way == "frame":
        write_table(frame(), path)
        return path
    table = pa.Table.from_pandas(frame(), preserve_index=False)
    if way == "table":
        write_table(table, path, row_group_size=1000)
    else:
        with table_writer(path, table.schema) as writer:
            writer.write_table(table.slice(0, 1500))
            writer.write_table(table.slice(1500))
    return path


def read_in_parts(path: Path) -> pd.DataFrame:
    with damage_named(path), open_table(path) as file:
        groups = [file.read_row_group(i).to_pandas() for i in range(file.num_row_groups)]
    return pd.concat(groups, ignore_index=True)


READERS = {
    "table": lambda path: read_table(path).to_pandas(),
    "columns": lambda path: read_table(path, ["x", "latent", "method"]).to_pandas(),
    "frame": read_frame,
    "parts": read_in_parts,
}


@pytest.mark.parametrize("way", ["frame", "table", "writer"])
@pytest.mark.parametrize("reader", READERS.values(), ids=READERS)
def test_what_was_written_is_read_and_a_flipped_bit_of_a_page_never(tmp_path, way, reader):
    path = written(tmp_path, way)
    expected = frame().reset_index(drop=True)
    pd.testing.assert_frame_equal(reader(path), expected)
    whole = path.read_bytes()
    column = pq.read_metadata(path).row_group(0).column(0)
    first, size = column.data_page_offset, column.total_compressed_size - 60  # without the page's header
    rng = random.Random(1)
    said: Counter[str] = Counter()
    for _ in range(25):
        broken = bytearray(whole)
        broken[first + 60 + rng.randrange(size - 60)] ^= 1 << rng.randrange(8)
        path.write_bytes(broken)
        with pytest.raises(
            InputError, match=f"^{path}: cannot be read, it is damaged or cut short"
        ) as caught:
            reader(path)
        assert "\n" not in str(caught.value)
        said["CRC checksum verification failed" in str(caught.value)] += 1
    assert said[True] == 25


def test_a_missing_file_and_one_of_another_kind_are_named(tmp_path):
    with pytest.raises(InputError, match=r"none\.parquet: no such file; make the version"):
        read_frame(tmp_path / "none.parquet")
    (tmp_path / "text.parquet").write_text("words")
    with pytest.raises(InputError, match=r"text\.parquet: cannot be read, it is damaged or cut short"):
        read_table(tmp_path / "text.parquet")


def test_no_other_module_opens_or_writes_parquet():
    doors = {
        path.relative_to(PACKAGE).as_posix(): line.strip()
        for path in PACKAGE.rglob("*.py")
        for line in path.read_text().splitlines()
        if DOORS.search(line) and path.name != "parquet.py"
    }
    assert doors == {}
