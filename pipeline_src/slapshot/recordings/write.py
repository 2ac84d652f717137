"""Write a recording to a folder, whole or not at all."""

import dataclasses
import shutil
import uuid
from collections.abc import Mapping
from pathlib import Path

import pandas as pd
import pyarrow as pa

from slapshot.errors import InputError
from slapshot.recordings.checks import check_recording
from slapshot.recordings.format import (
    COMMANDS_FILE,
    HEADER_FILE,
    HITS_FILE,
    HITS_SCHEMA,
    JOINTS_FILE,
    TRACKS_FILE,
    TRACKS_SCHEMA,
    Recording,
)
from slapshot.recordings.header import header_of
from slapshot.recordings.tables import (
    conform,
    frame_from_table,
    joint_schema_for,
    table_from_frame,
    write_parquet,
)


def write_recording(recording: Recording, folder: Path) -> None:
    """Check a recording as reading would, then write it.

    The files are written to a hidden sibling of `folder`, which is renamed when complete: a folder
    that exists is whole.

    Args:
        recording: Its tables may leave optional columns out and have columns in any order.
        folder: Must not exist yet; its parents are made where needed.

    Raises:
        InputError: If a check fails, the folder exists or cannot be written.
    """
    folder = Path(folder)
    check_new(folder)
    header = header_of(recording, folder / HEADER_FILE)
    write_files(header.to_json(), _checked_tables(recording, folder), folder)


def write_files(header: str, tables: Mapping[str, pa.Table], folder: Path) -> None:
    """Write what has been checked to a new folder, whole or not at all.

    Args:
        header: Text of recording.json.
        tables: By file name.
        folder: Must not exist yet.

    Raises:
        InputError: If it cannot be written.
    """
    partial = folder.with_name(f".{folder.name}.{uuid.uuid4().hex[:8]}.partial")
    try:
        partial.mkdir(parents=True)
        (partial / HEADER_FILE).write_text(header, encoding="utf-8")
        for name, table in tables.items():
            write_parquet(table, partial / name)
        partial.rename(folder)
    except BaseException as error:  # an interrupt, too, leaves nothing half-written behind
        shutil.rmtree(partial, ignore_errors=True)
        if isinstance(error, OSError):
            raise InputError(
                f"{folder}: cannot be written ({error.strerror}): check the path, its permissions "
                "and the space on the disk"
            ) from error
        raise


def check_new(folder: Path) -> None:
    """Refuse a folder for a recording that is there already, even as a link to nowhere.

    Raises:
        InputError: It is there, or its name is none.
    """
    try:
        folder.lstat()
    except FileNotFoundError:
        return
    except (OSError, ValueError) as error:  # ValueError: a null character in the path
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"{folder}: cannot be written ({reason}): choose another folder") from None
    raise InputError(f"{folder}: exists already: choose another folder or remove it")


def _checked_tables(recording: Recording, folder: Path) -> dict[str, pa.Table]:
    """The recording's tables by file name, in the format's types, after all checks."""
    frames = {
        HITS_FILE: recording.hits,
        TRACKS_FILE: recording.tracks,
        COMMANDS_FILE: recording.commands,
        JOINTS_FILE: recording.joints,
    }
    tables = {name: _conformed(frame, folder / name) for name, frame in frames.items() if frame is not None}
    as_read = {name: frame_from_table(table) for name, table in tables.items()}
    checked = dataclasses.replace(
        recording,
        hits=as_read[HITS_FILE],
        tracks=as_read.get(TRACKS_FILE),
        commands=as_read.get(COMMANDS_FILE),
        joints=as_read.get(JOINTS_FILE),
    )
    check_recording(checked, folder)
    return tables


def _conformed(frame: pd.DataFrame, file: Path) -> pa.Table:
    table = table_from_frame(frame, file)
    schemas = {HITS_FILE: HITS_SCHEMA, TRACKS_FILE: TRACKS_SCHEMA}
    schema = schemas.get(file.name) or joint_schema_for(table.column_names, file)
    return conform(table, schema, file)
