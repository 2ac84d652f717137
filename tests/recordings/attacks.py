"""More ways to break a recording: special files, every type and size of value, units, clocks.

Name of the attack -> how it is made, and words that its error must hold.
"""

import json
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
from slapshot.text import printable

from .breakers import Breaker, arrow, cell, header, puck, table, text
from .builder import TABLES, make_recording

FILES = ("recording.json", *(f"{name}.parquet" for name in TABLES))
Attack = tuple[Breaker, list[str]]


def instead(name: str, make: Callable[[Path], Any]) -> Breaker:
    """Something else than a regular file at the place of one."""

    def breaker(folder: Path) -> None:
        (folder / name).unlink()
        make(folder / name)

    return breaker


def raw_header(**changes: Any) -> Breaker:
    """As `header`, but None is written as null."""

    def breaker(folder: Path) -> None:
        content = json.loads((folder / "recording.json").read_text())
        (folder / "recording.json").write_text(json.dumps(content | changes))

    return breaker


def named(name: str) -> Breaker:
    """An object of another name, in both files."""

    def breaker(folder: Path) -> None:
        info = {"shape": "sphere", "size_m": [0.1], "mass_kg": 0.1, "mass_sd_kg": 0.0}
        header(objects={name: info})(folder)
        table("hits", lambda frame: frame.assign(object_id=name))(folder)

    return breaker


def column_of(name: str, column: str, values: Callable[[int], pa.Array]) -> Breaker:
    """A column of another Arrow type."""
    return arrow(name, column, lambda old: values(len(old)))


def more_columns(name: str, columns: dict[str, Any]) -> Breaker:
    return table(name, lambda frame: pd.concat([frame, pd.DataFrame(columns, index=frame.index)], axis=1))


def special_files() -> Iterator[tuple[str, Attack]]:
    for name in FILES:
        remedy = "put "
        yield f"pipe for {name}", (instead(name, os.mkfifo), [f"{name}: is no regular file; {remedy}"])
        yield f"folder for {name}", (instead(name, Path.mkdir), [f"{name}: is a folder; {remedy}"])
        for what, target in (("itself", name), ("nowhere", "gone"), ("a device", "/dev/zero")):
            words = {
                "itself": "cannot be read (Too many levels of symbolic links)",
                "nowhere": "no such file",
                "a device": "is no regular file",
            }[what]
            yield (
                f"link to {what} for {name}",
                (instead(name, lambda path, target=target: path.symlink_to(target)), [f"{name}: {words}"]),
            )
        yield f"empty {name}", (instead(name, Path.touch), [f"{name}: "])


WRONG: dict[str, tuple[Any, ...]] = {
    "rig": (3, True, None, [], {}, ["a"], "", " ", "a\nb", "a\x1b[2Jb", "a\u202eb", "\x00", "a" * 201),
    "objects": (3, None, [], "ice", {"ice": None}, {"ice": []}, {"ice": "puck"}, [{"ice": {}}]),
    "camera_rate_hz": (True, None, "fifty", [50], {}, -1, 0, 1e7, 10**400, -0.0),
    "frame_note": (3, None, [], {}, "\x1b]0;x\x07", "a" * 20_001),
    "stand_in": (0, 1, "true", None, [], {}),
    "trajectory_model": (3, "", [], {}, True, "\x07", "v" * 201),
    "note": (3, None, [], {}, "\ud7ff\x00", "n" * 20_001),
    "sealed_truth_sha256": (3, "", "0" * 63, "0" * 65, "G" * 64, "0" * 64 + "\n", []),
    "format_version": (0, -1, 1.5, 1.0, 2, "1", None, [], {}, True, 10**30),
    "unknown": (1, None, {}),
    "\x1b[31m": (1,),
}


def wrong_headers() -> Iterator[tuple[str, Attack]]:
    for key, values in WRONG.items():
        for i, value in enumerate(values):
            yield (
                f"{key!r} {i}",
                (raw_header(**{key: value}), ["recording.json: ", printable(key)]),
            )
    info: dict[str, tuple[Any, ...]] = {
        "shape": (3, None, "", "puck", "Cylinder", ["box"], "box", "sphere"),
        "size_m": (None, 0.1, "0.1", [], [0.1], [0.1] * 3, [0.1] * 4, [[0.1, 0.1]], [0.1, None], [0.1, "1"]),
        "mass_kg": (None, True, "1", 0, -1, 1e-12, 1e9, 1e308, [1], 21),
        "mass_sd_kg": (None, True, "1", -1e-9, 0.2, 1e308),
        "colour": ("red",),
    }
    for key, values in info.items():
        for i, value in enumerate(values):
            change = (lambda name, given: puck(**{name: given}))(key, value)
            yield f"object's {key} {i}", (change, ["recording.json: objects.ice"])
    for size in ([1e-9, 0.1], [0.1, 0], [-0.1, 0.1], [1e308, 0.1], [76, 25], [True, True]):
        yield f"extents {size}", (puck(size_m=size), ["recording.json: objects.ice.size_m."])
    for name in ("", " ", "a" * 65, "a\nb", "a\tb", "\x1b[2J", "\u202e", "\u200b"):
        yield f"object called {name!r}", (named(name), ["recording.json: objects"])
    many = {str(i): {"shape": "sphere", "size_m": [0.1], "mass_kg": 1, "mass_sd_kg": 0} for i in range(1001)}
    yield "1001 objects", (header(objects=many), ["objects: ", "at most 1000"])


JSON_TEXTS: dict[str, tuple[str | bytes, str]] = {
    "null": ("null", "top level: None is not a mapping"),
    "a number": ("3", "top level: 3 is not a mapping"),
    "a text": ('"x"', "top level: 'x' is not a mapping"),
    "blanks": (" \n", "is not valid JSON"),
    "two values": ("{} {}", "is not valid JSON"),
    "a comment": ('{"rig": 1} // mine', "is not valid JSON"),
    "single quotes": ("{'rig': 1}", "is not valid JSON"),
    "a comma too many": ('{"rig": 1,}', "is not valid JSON"),
    "cut off": ('{"rig": "te', "is not valid JSON"),
    "UTF-16": ('{"rig": 1}'.encode("utf-16"), "is not valid JSON"),
    "Latin-1": ('{"rig": "ü"}'.encode("latin-1"), "is not valid JSON"),
    "a null byte": (b'{"rig": 1}\0', "is not valid JSON"),
    "minus infinity": ('{"rig": -Infinity}', "-Infinity is not a JSON number"),
    "many digits": ('{"camera_rate_hz": ' + "9" * 5000 + "}", "is not valid JSON"),
    "levels in a note": ('{"note": ' + "[" * 300 + "]" * 300 + "}", "holds more than 50 levels"),
    "more levels": ('{"note": ' + '{"a":' * 900 + "1" + "}" * 901, "recording.json: "),
    "key twice inside": ('{"objects": {"a": 1, "a": 2}}', "key 'a' stands there twice"),
    "five megabytes": ('{"note": "' + "n" * 5_000_000 + '"}', "bytes, and 4,000,000 are allowed"),
    "a Parquet file": (b"PAR1\xff\xfe", "is not valid JSON"),
}


def wrong_types() -> Iterator[tuple[str, Attack]]:
    def with_type(type_: pa.DataType, value: Any) -> Callable[[int], pa.Array]:
        return lambda n: pa.array([value] * n, type_)

    makers: dict[str, Callable[[int], pa.Array]] = {
        "text": with_type(pa.string(), "0.5"),
        "truth": with_type(pa.bool_(), True),
        "bytes": with_type(pa.binary(), b"1"),
        "list": with_type(pa.list_(pa.float64()), [0.5]),
        "struct": with_type(pa.struct([("a", pa.float64())]), {"a": 1.0}),
        "map": with_type(pa.map_(pa.string(), pa.float64()), [("a", 1.0)]),
        "decimal": with_type(pa.decimal128(10, 2), 1),
        "duration": with_type(pa.duration("us"), 1),
        "date": with_type(pa.date32(), 1),
        "time": with_type(pa.timestamp("us", "UTC"), 1),
        "nothing": lambda n: pa.nulls(n),
        "infinity": with_type(pa.float64(), float("inf")),
        "NaN": lambda n: pa.array(np.full(n, np.nan)),
        "huge": with_type(pa.float64(), 1e308),
        "minus huge": with_type(pa.float64(), -1e308),
    }
    columns = {
        "hits": ("hit", "object_id", "order", "start_x"),
        "tracks": ("hit", "t", "x"),
        "commands": ("hit", "t", "q0"),
        "joints": ("t", "q6"),
    }
    for name, own in columns.items():
        for column in own:
            for what, values in makers.items():
                if column == "object_id" and what == "text":
                    continue
                yield f"{what} in {name}.{column}", (column_of(name, column, values), [f"{name}.parquet: "])
    for what, values in makers.items():
        if what not in ("list", "nothing", "NaN"):
            yield f"{what} in hits.latent", (column_of("hits", "latent", values), ["hits.parquet: "])
        if what not in ("time", "nothing", "NaN"):
            yield (
                f"{what} in hits.recorded_at",
                (column_of("hits", "recorded_at", values), ["hits.parquet: "]),
            )
        if what not in ("nothing", "NaN"):
            yield f"{what} in hits.rest_x", (column_of("hits", "rest_x", values), ["hits.parquet: "])
            yield f"{what} in hits.command_id", (column_of("hits", "command_id", values), ["hits.parquet: "])
            yield f"{what} in tracks.yaw", (column_of("tracks", "yaw", values), ["tracks.parquet: "])


LATENTS: dict[str, Callable[[int], pa.Array]] = {
    "of texts": lambda n: pa.array([["a"]] * n),
    "in lists": lambda n: pa.array([[[0.5]]] * n),
    "of truths": lambda n: pa.array([[True]] * n),
    "with null": lambda n: pa.array([[0.5, None]] * n),
    "with infinity": lambda n: pa.array([[float("inf")]] * n),
    "with 1e308": lambda n: pa.array([[1e308]] * n),
    "of 2,000 numbers": lambda n: pa.array([[0.0] * 2000] * n),
    "empty": lambda n: pa.array([[]] * n, pa.list_(pa.float64())),
    "null once": lambda n: pa.array([None, *[[0.5]] * (n - 1)]),
}

COLUMNS: dict[str, tuple[str, dict[str, Any], str]] = {
    "a column with a line break": ("tracks", {"a\nb": 1}, "column 'a\\nb' is not in the format"),
    "a column that commands": ("tracks", {"\x1b[2J": 1}, "is not in the format"),
    "an empty name": ("tracks", {"": 1}, "column '' is not in the format"),
    "a name of a million letters": ("tracks", {"n" * 1_000_000: 1}, "... is not in the format"),
    "900 columns more": ("tracks", {f"c{i}": 1.0 for i in range(900)}, "is not in the format"),
    "5,000 columns more": ("tracks", {f"c{i}": 1.0 for i in range(5000)}, "1,000 are allowed"),
    "150 joints": ("joints", {f"q{i}": 0.0 for i in range(7, 150)}, "has 150 joints, and 100 are allowed"),
    "a joint in capitals": ("joints", {"Q7": 0.0}, "column 'Q7' is not in the format"),
    "a joint with a blank": ("joints", {" q7": 0.0}, "column ' q7' is not in the format"),
    "a joint below 0": ("joints", {"q-1": 0.0}, "column 'q-1' is not in the format"),
    "a gap in the joints": ("joints", {"q9": 0.0}, "column 'q7' is missing although 'q9' is there"),
    "a column in capitals": ("tracks", {"X": 0.0}, "column 'X' is not in the format"),
}


def single_values() -> Iterator[tuple[str, Attack]]:
    for name, column, value, words in (
        (
            "tracks",
            "x",
            1e7,
            ["row 9 (the first is 0), hit 10", "x is 1e+07, beyond what a place in m can be"],
        ),
        ("tracks", "y", -1e308, ["hit 10", "y is -1e+308"]),
        ("tracks", "yaw", 1e5, ["hit 10", "yaw is 100000, beyond what an angle in rad can be"]),
        ("tracks", "t", 1e5, ["hit 10", "t is 100000, beyond what a time from the hit's start in s can be"]),
        ("tracks", "t", -1e308, ["hit 10", "before the hit's start"]),
        ("commands", "q3", 101.0, ["hit 11", "q3 is 101, beyond what the angle of a joint in rad can be"]),
        ("joints", "q3", 1e308, ["hit 11", "q3 is 1e+308"]),
        ("joints", "q3", -1e30, ["hit 11", "q3 is -1e+30"]),
        ("joints", "t", 1e300, ["hit 11", "t is 1e+300"]),
    ):
        yield (
            f"{value:g} in {name}.{column}",
            (cell(name, 9, column, value), [f"{name}.parquet: row 9 ", *words]),
        )
    for column in ("start_x", "start_y", "rest_x", "rest_y"):
        yield (
            f"1e9 in hits.{column}",
            (cell("hits", 2, column, 1e9), ["row 2 ", "hit 12", f"{column} is 1e+09, beyond what a place"]),
        )


def late(seconds: float) -> Callable[[pd.DataFrame], pd.DataFrame]:
    return lambda frame: frame.assign(t=frame["t"] + seconds)


def first_rows(frame: pd.DataFrame) -> pd.DataFrame:
    return frame.groupby("hit").head(1)


def one_row(frame: pd.DataFrame) -> pd.DataFrame:
    return frame.head(1)


def epoch(name: str) -> Breaker:
    """Times of a clock that counts for hours."""
    return table(name, late(7200.0))


def one_hit_in(seconds: float) -> Callable[[pd.DataFrame], pd.DataFrame]:
    """Tracks of which one hit's times are in another unit."""
    return lambda frame: frame.assign(t=frame["t"].where(frame["hit"] != 13, frame["t"] / seconds))


CLOCKS: dict[str, Attack] = {
    "times of one hit in hours": (
        table("tracks", one_hit_in(3600.0)),
        ["tracks.parquet: hit 13: frames are 5.556e-06 s apart (median), but camera_rate_hz"],
    ),
    "joints 10 s late": (
        table("joints", late(10.0)),
        [
            "joints.parquet: hit 10: joints are measured from 10 to 11 s",
            "from 0 to 1 s: give both on one clock",
        ],
    ),
    "commands 10 s late": (table("commands", late(10.0)), ["joints.parquet: hit 10", "on one clock"]),
    **{
        f"a clock of hours in {name}": (epoch(name), [f"{name}.parquet: column 't': hits begin at 7200"])
        for name in TABLES[1:]
    },
    **{
        f"{word} of {name}": (table(name, change), [f"{name}.parquet: has one row of each hit at most"])
        for name in TABLES[1:]
        for word, change in (("one row in all", one_row), ("first rows", first_rows))
    },
    **{
        f"times in nanoseconds in {name}": (
            table(name, lambda frame: frame.assign(t=frame["t"] * 1e9)),
            [f"{name}.parquet: row ", "beyond what a time from the hit's start in s can be"],
        )
        for name in TABLES[1:]
    },
    **{
        f"time reversed in {name}": (
            table(name, lambda frame: frame.assign(t=frame["t"].to_numpy()[::-1])),
            [f"{name}.parquet: row 1 ", "time goes backwards"],
        )
        for name in TABLES[1:]
    },
    **{
        f"time stands still in {name}": (
            table(name, lambda frame: frame.assign(t=0.5)),
            [f"{name}.parquet: row 1 ", "the same time twice"],
        )
        for name in TABLES[1:]
    },
    **{
        f"all rows twice in {name}": (
            table(name, lambda frame: pd.concat([frame, frame])),
            [f"{name}.parquet: row "],
        )
        for name in TABLES[1:]
    },
}


def many_hits(frame: pd.DataFrame) -> pd.DataFrame:
    rows = np.arange(100_001)
    return frame.iloc[rows % len(frame)].assign(hit=rows, command_id=None, latent=None)


def other_dates() -> Iterator[tuple[str, Attack]]:
    for when in ("1970-01-01", "1989-12-31", "2200-01-01"):
        yield (
            f"recorded in {when}",
            (
                cell("hits", 0, "recorded_at", pd.Timestamp(when, tz="UTC")),
                ["row 0 ", "recorded_at is not between"],
            ),
        )
    yield (
        "no time zone in nanoseconds",
        (column_of("hits", "recorded_at", lambda n: pa.array([0] * n, pa.timestamp("ns"))), ["time zone"]),
    )


def damage(name: str, change: Callable[[bytes], bytes]) -> Breaker:
    def breaker(folder: Path) -> None:
        file = folder / name
        file.write_bytes(change(file.read_bytes()))

    return breaker


def long_footer(raw: bytes) -> bytes:
    """A footer that says it is longer than allowed; the file is as long, without taking room on the disk."""
    return b"PAR1" + b"\0" * 20_000_000 + (18_000_000).to_bytes(4, "little") + b"PAR1"


def no_rows(folder: Path) -> None:
    """Parquet with columns and types, but not one row group."""
    schema = pq.read_schema(folder / "tracks.parquet")
    pq.ParquetWriter(folder / "tracks.parquet", schema).close()


def tracks_file(_: bytes) -> bytes:
    """The bytes of a whole table, of another kind."""
    sink = pa.BufferOutputStream()
    pq.write_table(pa.Table.from_pandas(make_recording().tracks), sink)
    return bytes(sink.getvalue())


PARQUET: dict[str, Attack] = {
    "no row group": (no_rows, ["tracks.parquet: has no rows"]),
    "a long footer": (
        damage("tracks.parquet", long_footer),
        ["tracks.parquet: its list of row groups has 18,000,000 bytes", "fewer, larger row groups"],
    ),
    "only magic": (damage("hits.parquet", lambda _: b"PAR1PAR1"), ["cannot be read as Parquet"]),
    "encrypted magic": (
        damage("hits.parquet", lambda raw: raw[:-4] + b"PARE"),
        ["cannot be read as Parquet"],
    ),
    "beginning cut": (damage("joints.parquet", lambda raw: raw[100:]), ["cannot be read as Parquet"]),
    "middle cut": (
        damage("tracks.parquet", lambda raw: raw[:500] + raw[600:]),
        ["tracks.parquet: cannot be read as Parquet"],
    ),
    "zeros in the middle": (
        damage("tracks.parquet", lambda raw: raw[:500] + b"\0" * 100 + raw[600:]),
        ["tracks.parquet: cannot be read as Parquet"],
    ),
    "CSV": (damage("hits.parquet", lambda _: b"hit,order\n1,1\n"), ["cannot be read as Parquet"]),
    "Feather": (damage("hits.parquet", lambda _: b"ARROW1\0\0"), ["cannot be read as Parquet"]),
    "another table": (
        damage("hits.parquet", tracks_file),
        ["hits.parquet: column 'object_id' is missing"],
    ),
}


def hits_told_wrongly() -> Iterator[tuple[str, Attack]]:
    yield "an object with a blank behind it", (cell("hits", 0, "object_id", "ice "), ["'ice ' is not among"])
    yield "an object in capitals", (cell("hits", 0, "object_id", "Ice"), ["'Ice' is not among the objects"])
    yield "an empty object", (cell("hits", 0, "object_id", ""), ["'' is not among the objects"])
    yield (
        "an object of a million letters",
        (
            cell("hits", 0, "object_id", "i" * 1_000_000),
            ["a text of 1,000,000 characters, and 64 are allowed"],
        ),
    )
    yield "an object that commands", (cell("hits", 0, "object_id", "\x1b[2J"), ["is not among the objects"])
    yield (
        "hit beyond 64 bits",
        (column_of("hits", "hit", lambda n: pa.array([2**63 + i for i in range(n)], pa.uint64())), ["'hit'"]),
    )
    yield "hit without a number", (cell("hits", 0, "hit", np.nan), ["row 0 ", "'hit' is empty"])
    yield "100,001 hits", (table("hits", many_hits), ["has 100,001 hits, and 100,000 are allowed"])
    yield "half a rest point", (cell("hits", 0, "rest_x", np.nan), ["rest_y is given but rest_x is null"])


ATTACKS: dict[str, Attack] = {
    **dict(special_files()),
    **dict(wrong_headers()),
    **{f"JSON: {name}": (text(content), [words]) for name, (content, words) in JSON_TEXTS.items()},
    **dict(wrong_types()),
    **{
        f"latents {name}": (column_of("hits", "latent", values), ["hits.parquet: ", "latent"])
        for name, values in LATENTS.items()
    },
    **{
        name: (more_columns(file, columns), [f"{file}.parquet: ", words])
        for name, (file, columns, words) in COLUMNS.items()
    },
    **dict(single_values()),
    **CLOCKS,
    **dict(other_dates()),
    **PARQUET,
    **dict(hits_told_wrongly()),
}
