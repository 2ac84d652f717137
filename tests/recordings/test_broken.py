"""Every way to break a recording that we thought of, and random damage for the others."""

import base64
import re
import tempfile
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from slapshot.errors import InputError
from slapshot.recordings.read import read_recording
from slapshot.recordings.write import write_recording

from .attacks import ATTACKS
from .breakers import Breaker
from .broken_cases import CASES
from .builder import TABLES, assert_same_tables, make_recording


@pytest.mark.parametrize(("breaker", "words"), (CASES | ATTACKS).values(), ids=CASES | ATTACKS)
def test_broken(folder: Path, breaker: Breaker, words: list[str]) -> None:
    breaker(folder)
    with pytest.raises(InputError) as caught:
        read_recording(folder)
    message = str(caught.value)
    assert message.startswith(str(folder))
    assert "\n" not in message
    for word in words:
        assert word in message
    assert ": " in message.removeprefix(str(folder))


@pytest.mark.parametrize(
    ("path", "words"),
    [
        ("a" * 5000, "File name too long"),
        ("a\0b", "a\\x00b: folder is missing"),
        ("a\nerror: none", "a\\nerror: none: folder is missing"),
        ("\x1b[2J\u202e", "\\x1b[2J\\u202e: folder is missing"),
        ("/dev/null", "/dev/null: is not a folder"),
        ("whole/recording.json", "recording.json: is not a folder"),
        ("whole/recording.json/x", "folder is missing"),
    ],
)
def test_a_path_that_is_none_is_told_in_one_line(tmp_path: Path, whole: Path, path: str, words: str) -> None:
    (tmp_path / "whole").symlink_to(whole)
    with pytest.raises(InputError) as caught:
        read_recording(tmp_path / path)
    assert str(caught.value).isprintable()
    assert words in str(caught.value)


def test_a_folder_of_any_name_is_read(tmp_path: Path, whole: Path) -> None:
    (tmp_path / "a\n\x1b[2J").symlink_to(whole)
    assert read_recording(tmp_path / "a\n\x1b[2J").rig == "test-rig"


@pytest.mark.parametrize("name", TABLES)
@pytest.mark.parametrize("share", [0.0, 0.01, 0.5, 0.99])
def test_truncated_parquet(folder: Path, name: str, share: float) -> None:
    file = folder / f"{name}.parquet"
    raw = file.read_bytes()
    file.write_bytes(raw[: int(share * len(raw))])
    with pytest.raises(InputError, match=rf"{name}\.parquet: cannot be read as Parquet"):
        read_recording(folder)


@pytest.mark.parametrize("name", TABLES)
@pytest.mark.parametrize("content", [b"hit,t,x,y\n1,0,0,0\n", b"PAR1" + b"\xff" * 500 + b"PAR1"])
def test_garbage_for_parquet(folder: Path, name: str, content: bytes) -> None:
    (folder / f"{name}.parquet").write_bytes(content)
    with pytest.raises(InputError, match=rf"{name}\.parquet: cannot be read as Parquet"):
        read_recording(folder)


def test_column_twice(folder: Path) -> None:
    old = pq.read_table(folder / "tracks.parquet")
    pq.write_table(old.append_column("x", old["x"]), folder / "tracks.parquet")
    with pytest.raises(InputError, match=r"tracks\.parquet: column 'x' is duplicated"):
        read_recording(folder)


def test_time_zone_that_is_no_text(folder: Path) -> None:
    """Found by flipping bytes: pyarrow reads the zone, and fails only when somebody asks for it."""
    column = pa.array([0] * 6, pa.timestamp("us", "ZONE"))
    old = pq.read_table(folder / "hits.parquet")
    index = old.schema.get_field_index("recorded_at")
    pq.write_table(old.set_column(index, "recorded_at", column), folder / "hits.parquet")
    # The schema that Arrow keeps in the footer is base64, which hides the zone from a search.
    file = folder / "hits.parquet"
    raw = file.read_bytes()
    damaged = replace_in_base64(raw, b"ZONE", b"\xff\xff\xff\xff")
    assert damaged != raw
    file.write_bytes(damaged)
    with pytest.raises(InputError, match=r"hits\.parquet: "):
        read_recording(folder)


def replace_in_base64(raw: bytes, old: bytes, new: bytes) -> bytes:
    """Replace bytes inside the base64 text of a Parquet footer's Arrow schema, keeping lengths."""
    found = re.search(rb"ARROW:schema.{1,8}?([A-Za-z0-9+/]{200,}=*)", raw, re.DOTALL)
    assert found
    encoded = found.group(1)
    decoded = base64.b64decode(encoded[: len(encoded) // 4 * 4])
    return raw.replace(encoded, base64.b64encode(decoded.replace(old, new)))


VALID: dict[str, bytes] = {}


def valid_files() -> dict[str, bytes]:
    """Bytes of the files of a valid recording, made once."""
    if not VALID:
        with tempfile.TemporaryDirectory() as parent:
            write_recording(make_recording(), Path(parent) / "r")
            VALID.update({path.name: path.read_bytes() for path in Path(parent, "r").iterdir()})
    return VALID


@settings(max_examples=300)
@given(
    name=st.sampled_from(["recording.json", *(f"{name}.parquet" for name in TABLES)]),
    position=st.floats(0, 1, exclude_max=True),
    byte=st.none() | st.integers(1, 255),
)
def test_random_damage(name: str, position: float, byte: int | None) -> None:
    """One byte changed, or everything from there cut off: an InputError, or the same tables.

    A changed digit or letter in recording.json is another valid recording, which nothing can know;
    so only the tables are compared. In Parquet files the checksum of each page finds such changes.
    """
    with tempfile.TemporaryDirectory() as parent:
        folder = Path(parent)
        for other, content in valid_files().items():
            (folder / other).write_bytes(content)
        raw = bytearray(valid_files()[name])
        index = int(position * len(raw))
        if byte is None:
            del raw[index:]
        else:
            raw[index] ^= byte
        (folder / name).write_bytes(raw)
        try:
            damaged = read_recording(folder)
        except InputError:
            return
        assert_same_tables(damaged, make_recording())
