"""Ways to break an import: mappings that cannot be, CSV files that are none, names and patterns without end.

Name of the attack -> how it is made in a folder with mapping.yaml and csv/a.csv, both good, and words that
its error must hold.
"""

import os
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from .slide_tracks import slide, write_csv, write_mapping

Spoiler = Callable[[Path], None]
Attack = tuple[Spoiler, list[str]]
BOX = {"shape": "box", "size_m": [0.2, 0.2, 0.1], "mass_kg": 0.4, "mass_sd_kg": 0.01}
COLUMNS = {"t": "t", "x": "x", "y": "y"}


def good_rows() -> list[list[Any]]:
    """Rows of one good hit: t in s, x and y in m."""
    t, xy = slide()
    return [[f"{value:.6f}" for value in row] for row in np.column_stack([t, xy]).tolist()]


def make_good(folder: Path) -> None:
    write_mapping(folder / "mapping.yaml")
    write_csv(folder / "csv/a.csv", good_rows(), ["t", "x", "y"])


def mapping(**changes: Any) -> Spoiler:
    def spoil(folder: Path) -> None:
        write_mapping(folder / "mapping.yaml", **changes)

    return spoil


def yaml_text(change: Callable[[str], str | bytes]) -> Spoiler:
    def spoil(folder: Path) -> None:
        changed = change((folder / "mapping.yaml").read_text())
        raw = changed if isinstance(changed, bytes) else changed.encode()
        (folder / "mapping.yaml").write_bytes(raw)

    return spoil


def csv_text(change: Callable[[str], str | bytes], **changes: Any) -> Spoiler:
    def spoil(folder: Path) -> None:
        changed = change((folder / "csv/a.csv").read_text())
        raw = changed if isinstance(changed, bytes) else changed.encode()
        (folder / "csv/a.csv").write_bytes(raw)
        write_mapping(folder / "mapping.yaml", **changes)

    return spoil


def row(number: int, cells: list[str], **changes: Any) -> Spoiler:
    """One row replaced, the first data row being 2 as in the file."""

    def change(content: str) -> str:
        lines = content.split("\n")
        lines[number - 1] = ",".join(cells)
        return "\n".join(lines)

    return csv_text(change, **changes)


def other_columns(header: list[str], rows: Callable[[list[Any]], list[Any]], **changes: Any) -> Spoiler:
    def spoil(folder: Path) -> None:
        write_csv(folder / "csv/a.csv", [rows(cells) for cells in good_rows()], header)
        write_mapping(folder / "mapping.yaml", **changes)

    return spoil


def instead(name: str, make: Callable[[Path], Any]) -> Spoiler:
    def spoil(folder: Path) -> None:
        (folder / name).unlink()
        make(folder / name)

    return spoil


def beside(name: str, make: Callable[[Path], Any], **changes: Any) -> Spoiler:
    """Something beside the good file."""

    def spoil(folder: Path) -> None:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        make(folder / name)
        write_mapping(folder / "mapping.yaml", **changes)

    return spoil


def special_files() -> Iterator[tuple[str, Attack]]:
    for name in ("mapping.yaml", "csv/a.csv"):
        for what, make, words in (
            ("a pipe", os.mkfifo, "is no regular file"),
            ("a link to itself", lambda path: path.symlink_to(path.name), ""),
            ("a link to nowhere", lambda path: path.symlink_to("gone"), "no such file"),
            ("a link to a device", lambda path: path.symlink_to("/dev/zero"), "is no regular file"),
            ("nothing", Path.touch, ""),
        ):
            yield f"{what} for {name}", (instead(name, make), [f"{name}: {words}"])
    yield "a folder for mapping.yaml", (instead("mapping.yaml", Path.mkdir), ["mapping.yaml: is a folder"])
    yield "no file at all", (instead("csv/a.csv", lambda _: None), ["csv: no file matches *.csv"])


WRONG: dict[str, tuple[Any, ...]] = {
    "rig": (3, True, [], {}, "", "a\nb", "\x1b[2J", "r" * 201),
    "frame_note": (3, [], "n" * 20_001),
    "note": (3, [], "n" * 20_001, "\x07"),
    "objects": ([], {}, 3, {"box": 3}, {"box": {}}, {"b" * 65: BOX}, {"": BOX}, {3: BOX}, {"a\nb": BOX}),
    "camera_rate_hz": (0, -1, True, "100", [], 1e7, float("nan"), float("inf"), 10**30),
    "object_id": (3, [], "", "{", "}", "{}", "{a b}", "{file", "file}", "{{file}}", "{nobody}", "o" * 201),
    "command": (3, [], "", "{spee", "{}", "{file!r}", "{0}", "c" * 201),
    "files": (3, [], "*.csv", {"patern": "*.csv"}),
    "csv": (3, [], {"delimeter": ","}),
    "columns": (3, [], {}, {"x": "x"}, {"x": "x", "y": "y", "z": "z"}),
    "fields": (3, [], {"a b": "x"}, {"a": {}}, {"a": True}, {"a": 1.5}, {"": "x"}, {"<hit>": "x"}, {1: "x"}),
    "recorded_at": (3, [], {}, {"text": "{file}"}, {"text": "{file", "format": "%Y"}, {"format": "%Y"}),
    "crop": (3, [], {}, {"before_motion_s": -1, "after_rest_s": 1}, {"before_motion_s": 1}),
    "longest_s": (0, -1, "60", True, 1e9, [], 1e-400),
    "moving_at_start": (True, "maybe", 1, [], "Keep"),
    "moving_at_end": (True, "maybe", 1, [], ""),
    "colums": ({},),
}
INNER: dict[str, dict[str, tuple[Any, ...]]] = {
    "files": {
        "pattern": (3, "", "/etc/*", "../*.csv", "a/../*.csv", "p" * 201, [], ".", "*.txt"),
        "name_pattern": (3, "", "(", "[", "*", "(?P<a>x)(?P<a>y)", "a{9999999999}", "(" * 90, "p" * 201, "b"),
    },
    "csv": {
        "delimiter": (3, "", "ab", '"', "\n", "\r", "1", ".", "-", "e", [], "tabs"),
        "decimal": (3, "", "..", ",", ";", []),
        "header": (1, "true", [], "no"),
        "skip_rows": (-1, 1.5, "1", True, 10**7, []),
        "missing": (3, "x", [1], [None], [["x"]], ["m" * 201], ["x"] * 101),
    },
    "columns": {
        "x": (-1, 1.5, True, [], {}, "", " ", 10**7, "gone", "X", "c" * 201, {"column": "x", "faktor": 1}),
        "t": ("gone", {"factor": 1}, {"column": []}, {"column": "t", "offset": "1"}),
        "hit": (-1, True, {}, {"column": "hit"}, "gone", ""),
        "new_hit": (-1, True, [], "gone"),
        "yaw": ("gone", {"column": "x", "factor": 0}, {"column": "x", "factor": 1e-12}),
        "order": ("gone", {"column": "x", "factor": "1e-3"}, {"column": "x", "factor": float("inf")}),
    },
}


def wrong_values() -> Iterator[tuple[str, Attack]]:
    for key, values in WRONG.items():
        for i, value in enumerate(values):
            yield f"{key} {i}", (mapping(**{key: value}), ["mapping.yaml", key])
    for block, keys in INNER.items():
        for key, values in keys.items():
            for i, value in enumerate(values):
                inner = {**(COLUMNS if block == "columns" else {}), key: value}
                yield f"{block}.{key} {i}", (mapping(**{block: inner}), [": "])
    for key in WRONG:
        if key != "colums":
            empty = yaml_text(
                lambda old, key=key: re.sub(rf"(?ms)^{key}:.*?^(?=\w|\Z)", "", old) + f"{key}:\n"
            )
            yield f"no value for {key}", (empty, ["mapping.yaml", f"{key}: "])
    for key in ("rig", "frame_note", "objects", "camera_rate_hz", "columns"):
        yield f"no {key}", (mapping(**{key: None}), ["mapping.yaml", f"key '{key}' is missing"])
    for key, value in {"shape": "puck", "size_m": [0.1], "mass_kg": 1e-12, "mass_sd_kg": 1.0}.items():
        yield (
            f"object's {key}",
            (mapping(objects={"box": BOX | {key: value}}), ["mapping.yaml", "objects.box"]),
        )
    for a, b in (("x", "y"), ("y", "x"), ("x", "t"), ("t", "yaw"), ("start_x", "start_y"), ("start_x", "y")):
        both = {"start_x": "x", "start_y": "y"} if "start" in a else {}
        columns = {**COLUMNS, **both, b: {**COLUMNS, **both}[a]}
        yield (
            f"{b} from the column of {a}",
            (mapping(columns=columns), ["takes the column of", "name another one"]),
        )
    yield (
        "x and y from one column, by name and number",
        (mapping(columns={**COLUMNS, "y": 1}), ["columns.y: takes the column of x, 1; name another one"]),
    )
    yield "two objects", (mapping(objects={"a": BOX, "b": BOX}), ["objects: key 'object_id' is missing"])
    yield "a field of a file twice", (mapping(fields={"folder": "x"}), ["field 'folder' is given twice"])


YAML: dict[str, tuple[Callable[[str], str | bytes], str]] = {
    "a key twice": (lambda old: old + "\nrig: other\n", "key 'rig' stands there twice"),
    "a tab": (lambda old: old + "\n\trig: other\n", "not valid YAML"),
    "a list": (lambda old: "- 1\n- 2\n", "holds no keys"),
    "a text": (lambda old: "mapping", "holds no keys"),
    "JSON that is cut": (lambda old: '{"rig": ', "not valid YAML"),
    "a second document": (lambda old: old + "\n---\nrig: b\n", "not valid YAML"),
    "code": (lambda old: old + "\nnote: !!python/object/apply:os.system ['true']\n", "not valid YAML"),
    "a bomb": (
        lambda old: (
            "a: &a [x,x,x,x,x,x,x,x,x]\n"
            + "".join(
                f"{c}: &{c} [{','.join([f'*{p}'] * 9)}]\n"
                for p, c in zip("abcdefgh", "bcdefghi", strict=True)
            )
        ),
        "mapping.yaml",
    ),
    "itself": (lambda old: "a: &a [*a]\n", "mapping.yaml"),
    "UTF-16": (lambda old: old.encode("utf-16"), "mapping.yaml"),
    "Latin-1": (lambda old: old.replace("test-rig", "Tür").encode("latin-1"), "mapping.yaml"),
    "a date": (lambda old: old.replace("rig: test-rig", "rig: 2026-01-01"), "rig: "),
    "levels without end": (lambda old: "a: " + "[" * 500 + "]" * 500, "mapping.yaml"),
    "binary": (lambda old: b"\x00\x01\x02", "mapping.yaml"),
}


def patterns() -> Iterator[tuple[str, Attack]]:
    long = "h" * 60
    for pattern in ("^(h+)+!$", "(h|h)*!", "(h*)*!", "^(h|hh)+!$", "([a-z]+)*!$"):
        name = f"csv/{long}.csv"
        yield (
            f"pattern {pattern}",
            (
                beside(name, Path.touch, files={"pattern": "h*.csv", "name_pattern": pattern}),
                ["mapping.yaml", "files.name_pattern", "was not matched within"],
            ),
        )
    deep = "csv/" + "/".join("d" * 40) + "/b.csv"
    for pattern in ("**/**/**/**/**/**/**/**/nothing", "**/d/**/d/**/d/**/d/**/d/**/d/**/d/**/d/**/x"):
        yield (
            f"pattern {pattern}",
            (beside(deep, Path.touch, files={"pattern": pattern}), [f"no file matches {pattern}"]),
        )
    stars = "*h" * 60 + "!"
    yield "many stars", (beside(f"csv/{long}.csv", Path.touch, files={"pattern": stars}), ["no file matches"])
    circle = beside("csv/d/up", lambda path: path.symlink_to(path.parent), files={"pattern": "**/*.txt"})
    yield "a circle of links", (circle, ["no file matches"])


DATES: dict[str, tuple[str, str]] = {
    "a directive twice": ("%Y-%Y", "recorded_at"),
    "the time twice": ("%c %c", "recorded_at"),
    "no directive": ("%Q", "recorded_at"),
    "a stray %": ("%", "recorded_at"),
    "another text": ("%H:%M", "'a' is no time"),
    "blanks": (" " * 150 + "%d", "'a' is no time"),
    "a null byte": ("\0", "recorded_at"),
    "too long": ("%d" * 120, "recorded_at.format"),
}


def tables() -> Iterator[tuple[str, Attack]]:
    hit = {**COLUMNS, "hit": "name"}
    yield "UTF-16", (csv_text(lambda old: old.encode("utf-16")), ["a.csv: is binary or UTF-16"])
    yield (
        "UTF-16 without mark",
        (csv_text(lambda old: old.encode("utf-16-le")), ["a.csv: is binary or UTF-16"]),
    )
    yield "a null byte at the end", (csv_text(lambda old: old + "\0"), ["a.csv: is binary or UTF-16"])
    yield "zeros at the end", (csv_text(lambda old: old + "\0" * 10_000), ["a.csv: is binary or UTF-16"])
    yield "zip", (csv_text(lambda _: b"PK\x03\x04\x00\x00"), ["a.csv: is binary"])
    yield (
        "HTML",
        (
            csv_text(lambda _: "<html><body>404</body></html>\n"),
            ["a.csv: column 'x' (x) is missing", "(columns: <html>"],
        ),
    )
    yield "only a header", (csv_text(lambda _: "t,x,y\n"), ["a.csv: has no rows"])
    yield "only blanks", (csv_text(lambda _: " \n \n"), ["a.csv: is empty"])
    yield "only commas", (csv_text(lambda _: ",,\n,,\n"), ["a.csv: "])
    yield "one row", (csv_text(lambda _: "t,x,y\n0,0,0\n"), ["no hit is left"])
    for what, text in {
        "a word": "lost",
        "two points": "1.2.3",
        "a decimal comma": '"1,5"',
        "thousands": '"1,234.5"',
        "an underscore": "1_000",
        "other digits": "१.५",
        "a unit": "1.5 m",
        "a percentage": "50%",
        "hexadecimal": "0x1A",
        "a time": "12:03:01.5",
        "a full-width digit": "１",
        "a minus of typesetting": "−1.5",
        "Fortran's exponent": "1.5d0",
        "a fraction": "1/2",
        "a command": "\x1b[2J",
    }.items():
        yield what, (row(22, ["0.2", text, "0.1"]), ["a.csv: line 22, column 'x' (x): ", "is no number"])
    for what, text in {"infinity": "inf", "1e308": "1e308", "1e400": "1e400", "1e-310": "1e-310"}.items():
        yield what, (row(22, ["0.2", text, "0.1"]), ["a.csv: line 22, column 'x' (x): ", "cannot be"])
    yield (
        "a point with decimal commas",
        (
            csv_text(
                lambda old: old.replace(",", ";").replace("\n", "\n"), csv={"delimiter": ";", "decimal": ","}
            ),
            ["a.csv: line 2, column 'x' (x): '0.500025' is no number", "csv.decimal"],
        ),
    )
    yield (
        "decimal commas in commas",
        (csv_text(lambda old: old.replace(".", ",")), ["line 2 has 6 columns, but the header names 3"]),
    )
    yield (
        "a name less than columns",
        (csv_text(lambda old: old.replace("t,x,y", "x,y", 1), columns={"x": "x", "y": "y"}), ["names 2"]),
    )
    yield (
        "names with blanks in them",
        (
            csv_text(
                lambda old: old.replace("t,x,y", "x [m] y t", 1).replace(",", " "),
                csv={"delimiter": "blanks"},
                columns={"x": "x", "y": "y"},
            ),
            ["line 2 has 3 columns, but the header names 4"],
        ),
    )
    yield "another delimiter", (csv_text(lambda old: old.replace(",", ";")), ["column 'x' (x) is missing"])
    yield "a short row", (row(22, ["0.2", "0.5"]), ["line 22 has 2 columns"])
    yield (
        "a long row",
        (row(22, ["0.2", "0.5", "0.1", "0.7"]), ["line 22 has 4 columns, but the header names 3"]),
    )
    yield "a quote without end", (row(22, ["0.2", '"0.5', "0.1"]), ["a.csv: line 22 is no CSV"])
    yield "letters behind a quote", (row(22, ["0.2", '"0.5"1', "0.1"]), ["a.csv: line 22 is no CSV"])
    yield "a cell of a megabyte", (row(22, ["0.2", "5" * 1_000_000, "0.1"]), ["a.csv: line 22 is no CSV"])
    yield "midnight", (row(22, ["0.0", "0.5", "0.1"]), ["line 22: time goes backwards"])
    yield "a time twice", (row(22, ["0.190000", "9.5", "0.1"]), ["line 22: the same time at two places"])
    yield (
        "times in milliseconds",
        (
            mapping(columns={**COLUMNS, "t": {"column": "t", "factor": 1000}}),
            ["columns.t: frames are 10 s apart (median), but camera_rate_hz is 100"],
        ),
    )
    yield (
        "places in millimetres",
        (
            mapping(
                columns={
                    **COLUMNS,
                    "x": {"column": "x", "factor": 1000},
                    "y": {"column": "y", "factor": 1000},
                }
            ),
            ["columns: columns 'x' and 'y' lie", "too far for metres"],
        ),
    )
    yield "places all the same", (other_columns(["t", "x", "y"], lambda r: [r[0], 1, 1]), ["never moves"])
    yield "a header twice", (csv_text(lambda old: "t,x,y\n" + old), ["line 2", "is no number"])
    yield "a name twice", (csv_text(lambda old: old.replace("t,x,y", "x,x,y", 1)), ["column"])
    yield (
        "units below the header",
        (csv_text(lambda old: old.replace("\n", "\ns,m,m\n", 1)), ["line 2", "'m' is no number"]),
    )
    yield "a total below", (csv_text(lambda old: old + "sum,1,1\n"), ["'sum' is no number"])
    yield "a comment", (csv_text(lambda old: "# mine\n" + old), ["column 'x' (x) is missing"])
    yield "too many rows skipped", (mapping(csv={"skip_rows": 100_000}), ["a.csv: "])
    yield (
        "no header, said to be one",
        (csv_text(lambda old: old.split("\n", 1)[1]), ["holds numbers, no names"]),
    )
    yield (
        "a header, said to be none",
        (
            mapping(csv={"header": False}, columns={"t": 0, "x": 1, "y": 2}),
            ["line 1, column 1 (x): 'x' is no number"],
        ),
    )
    yield (
        "a column that is not there",
        (
            mapping(columns={"t": 0, "x": 1, "y": 999_999}),
            ["line 2 has 3 columns, but y is number 999999"],
        ),
    )
    yield "each row a hit", (mapping(columns={**COLUMNS, "hit": "t"}), ["no hit is left"])
    yield (
        "a hit named in Latin-1",
        (
            csv_text(
                lambda old: (
                    "\n".join(f"{line},Tür" for line in old.split())
                    .replace("Tür", "name", 1)
                    .encode("latin-1")
                ),
                columns=hit,
            ),
            ["line 2, hit: ", "is not UTF-8"],
        ),
    )
    yield (
        "a hit with a name of 1,000 letters",
        (
            other_columns([*COLUMNS, "name"], lambda r: [*r, "n" * 1000], columns=hit),
            ["has 1,000 characters"],
        ),
    )
    yield (
        "an object that commands",
        (
            other_columns(
                [*COLUMNS, "what"], lambda r: [*r, "\x1b[2J"], fields={"o": "what"}, object_id="{o}"
            ),
            ["object_id '\\x1b[2J' is not among the objects"],
        ),
    )
    yield (
        "a field that is named as x",
        (
            other_columns([*COLUMNS, "what"], lambda r: [*r, "ball"], fields={"x": "what"}, object_id="{x}"),
            ["'ball'"],
        ),
    )
    yield (
        "an order that is empty",
        (
            other_columns([*COLUMNS, "n"], lambda r: [*r, ""], columns={**COLUMNS, "order": "n"}),
            ["its order is empty"],
        ),
    )
    yield (
        "a start that is empty",
        (
            other_columns(
                [*COLUMNS, "n"], lambda r: [*r, ""], columns={**COLUMNS, "start_x": "n", "start_y": "y"}
            ),
            ["start_x or start_y is empty"],
        ),
    )
    yield (
        "yaw in degrees",
        (
            other_columns([*COLUMNS, "a"], lambda r: [*r, 90], columns={**COLUMNS, "yaw": "a"}),
            ["column 'yaw'", "degrees"],
        ),
    )
    yield "an empty file beside", (beside("csv/b.csv", Path.touch), ["b.csv: is empty"])
    yield "a pipe beside", (beside("csv/b.csv", os.mkfifo), ["b.csv: is no regular file"])
    yield "a lost link beside", (beside("csv/b.csv", lambda p: p.symlink_to("gone")), ["b.csv: no such file"])
    yield (
        "another kind beside",
        (beside("csv/b.csv", lambda p: p.write_text("a,b\n1,2\n")), ["b.csv: column 'x'"]),
    )
    yield "a name with a line break", (beside("csv/a\nb.csv", Path.touch), ["a\\nb.csv: is empty"])
    yield "a name that commands", (beside("csv/\x1b[2J.csv", Path.touch), ["\\x1b[2J.csv: is empty"])
    yield (
        "a name that is no UTF-8",
        (
            beside("csv/b\udcff.csv", Path.touch),
            ["b\\udcff.csv: is empty"],
        ),
    )


ATTACKS: dict[str, Attack] = {
    **{f"files: {name}": attack for name, attack in special_files()},
    **{f"mapping: {name}": attack for name, attack in wrong_values()},
    **{f"YAML: {name}": (yaml_text(change), [words]) for name, (change, words) in YAML.items()},
    **{f"patterns: {name}": attack for name, attack in patterns()},
    **{
        f"dates: {name}": (mapping(recorded_at={"text": "{file}", "format": format_}), [words])
        for name, (format_, words) in DATES.items()
    },
    **{f"CSV: {name}": attack for name, attack in tables()},
}
