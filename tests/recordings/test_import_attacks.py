"""Every way to break an import that we thought of: each ends in one line, with nothing written."""

import dataclasses
from collections.abc import Callable
from pathlib import Path

import pytest
from slapshot.errors import InputError
from slapshot.recordings.cli import format_import_summary
from slapshot.recordings.importing import name_pattern
from slapshot.recordings.importing.track_importer import import_tracks
from slapshot.recordings.read import read_recording
from slapshot.recordings.summary import describe_hits

from .builder import assert_same_tables
from .import_attacks import ATTACKS, Spoiler, csv_text, make_good
from .slide_tracks import write_csv


@pytest.mark.parametrize(("spoil", "words"), ATTACKS.values(), ids=ATTACKS)
def test_an_import_that_cannot_be_is_refused_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, spoil: Spoiler, words: list[str]
) -> None:
    if "was not matched within" in words:
        monkeypatch.setattr(name_pattern, "_LIMIT_S", 1)
    make_good(tmp_path)
    spoil(tmp_path)
    with pytest.raises(InputError) as caught:
        import_tracks(tmp_path / "mapping.yaml", tmp_path / "csv", tmp_path / "out")
    message = str(caught.value)
    assert message.isprintable()
    assert len(message) < 1000
    for word in words:
        assert word in message
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("source", "words"),
    [
        ("a" * 5000, "File name too long"),
        ("a\0b", "a\\x00b: "),
        ("a\nb", "a\\nb: no such file"),
        ("/dev/zero", "/dev/zero: is no regular file"),
        ("csv/gone.csv", "gone.csv: no such file"),
        ("csv/*.txt", "no file matches *.txt"),
        ("csv/**/../*.csv", "no file matches **/../*.csv"),
        ("gone/*.csv", "gone: cannot be read (No such file or directory)"),
        ("*/a.csv/*.csv", "no file matches */a.csv/*.csv"),
    ],
)
def test_a_source_that_is_none_is_told_in_one_line(tmp_path: Path, source: str, words: str) -> None:
    make_good(tmp_path)
    with pytest.raises(InputError) as caught:
        import_tracks(tmp_path / "mapping.yaml", tmp_path / source, tmp_path / "out")
    assert str(caught.value).isprintable()
    assert words in str(caught.value)


@pytest.mark.parametrize("out", ["a" * 300, "csv", "lost", "mapping.yaml/out", "a\0b"])
def test_a_place_for_the_recording_that_is_none_is_told_in_one_line(tmp_path: Path, out: str) -> None:
    make_good(tmp_path)
    (tmp_path / "lost").symlink_to("gone")
    with pytest.raises(InputError, match=r"exists already|cannot be written") as caught:
        import_tracks(tmp_path / "mapping.yaml", tmp_path / "csv", tmp_path / out)
    assert str(caught.value).isprintable()


def test_what_they_spoil_is_good(tmp_path: Path) -> None:
    make_good(tmp_path)
    assert import_tracks(tmp_path / "mapping.yaml", tmp_path / "csv", tmp_path / "out").hits == 1


@pytest.mark.parametrize(
    "change",
    [
        lambda old: "\ufeff" + old,
        lambda old: old.replace("\n", "\r\n").encode(),
        lambda old: old.replace("\n", "\r").encode(),
        lambda old: old.replace("\n", ",\n"),
        lambda old: old.replace("\n", "\n\n"),
        lambda old: old.replace(",", " , "),
        lambda old: "".join(f'"{line}"\n'.replace(",", '","') for line in old.split()),
        lambda old: "".join(f"{line}{',0' * 20_000}\n" for line in old.split()).replace(",0", ",n", 20_000),
        lambda old: (
            "".join(f"ü,\x1b,{line}\n" for line in old.split()).replace("ü,", "T,", 1).encode("latin-1")
        ),
        lambda old: old.rstrip(),
    ],
)
def test_what_is_harmless_is_read(tmp_path: Path, change: Callable[[str], str | bytes]) -> None:
    make_good(tmp_path)
    import_tracks(tmp_path / "mapping.yaml", tmp_path / "csv", tmp_path / "good")
    csv_text(change)(tmp_path)
    import_tracks(tmp_path / "mapping.yaml", tmp_path / "csv", tmp_path / "out")
    assert_same_tables(read_recording(tmp_path / "out"), read_recording(tmp_path / "good"))


def test_a_row_over_several_lines_is_told(tmp_path: Path) -> None:
    make_good(tmp_path)
    note = csv_text(
        lambda old: old.replace("t,x,y", "t,x,y,note").replace("\n", ',"a\nb"\n').replace('e,"a\nb"', "e")
    )
    note(tmp_path)
    summary = import_tracks(tmp_path / "mapping.yaml", tmp_path / "csv", tmp_path / "out")
    assert "goes over 2 lines, between quotes" in summary.lines[-1]


def test_names_are_escaped_on_the_terminal(tmp_path: Path) -> None:
    make_good(tmp_path)
    write_csv(tmp_path / "csv/\x1b[2Jb\n.csv", [["0", "1", "1"]], ["t", "x", "y"])
    summary = import_tracks(tmp_path / "mapping.yaml", tmp_path / "csv", tmp_path / "out")
    lines = format_import_summary(summary).split("\n")
    assert all(line.isprintable() for line in lines)
    assert lines[-1] == "  \\x1b[2Jb\\n.csv: dropped, for it has only 1 frames"
    assert len(lines) == 1 + len(summary.lines)
    recording = dataclasses.replace(read_recording(tmp_path / "out"), rig="a\nkind           full\x1b[2J")
    assert describe_hits(recording).split("\n")[:2] == [
        "rig            a\\nkind           full\\x1b[2J: real robot",
        "kind           tracks only",
    ]
