"""Read and check a recording of hits; detect the version of any recording."""

from collections.abc import Mapping
from pathlib import Path

import pandas as pd
import pyarrow as pa

from slapshot.config.sources import Source
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
from slapshot.recordings.header import Header, read_header, version_in
from slapshot.recordings.tables import conform, frame_from_table, joint_schema_for, read_parquet


def format_version(folder: Path) -> int:
    """Which version of the format a recording is in: 1 for `read_recording`, 2 for `signals.read_signals`.

    Raises:
        InputError: It cannot be read, or is in another version.
    """
    check_folder(folder)
    return version_in(folder / HEADER_FILE)


def read_recording(folder: Path) -> Recording:
    """Read and check a recording of hits.

    Args:
        folder: Folder in the format of `slapshot.recordings.format`; other files are ignored.

    Returns:
        The recording; its tables have every column of the schemas, in their order.

    Raises:
        InputError: If anything is missing, damaged or implausible; one line for a person.
    """
    folder = Path(folder)
    check_folder(folder)
    header = read_header(folder / HEADER_FILE, Header)
    hits = _read_table(folder / HITS_FILE, HITS_SCHEMA)
    if hits is None:
        raise InputError(f"{folder / HITS_FILE}: is missing: add the table of hits")
    recording = Recording(
        **header.fields,
        hits=hits,
        tracks=_read_table(folder / TRACKS_FILE, TRACKS_SCHEMA),
        commands=_read_table(folder / COMMANDS_FILE, None),
        joints=_read_table(folder / JOINTS_FILE, None),
    )
    check_recording(recording, folder)
    return recording


def check_folder(folder: Path) -> None:
    """Refuse what is no folder, or an empty one.

    Raises:
        InputError: One line for a person.
    """
    try:
        if not folder.exists():
            raise InputError(f"{folder}: folder is missing: check the path")
        if not folder.is_dir():
            raise InputError(f"{folder}: is not a folder: name the folder that holds {HEADER_FILE}")
        if not any(folder.iterdir()):
            raise InputError(f"{folder}: folder is empty: put a recording there, {HEADER_FILE} first")
    except OSError as error:
        raise InputError(
            f"{folder}: cannot be read ({error.strerror}): check the path and its permissions"
        ) from error


def _read_table(file: Path, schema: pa.Schema | None) -> pd.DataFrame | None:
    """Table in the types of `schema` (None: that of the joints it has); None without a file."""
    # A link to nowhere is a table that was lost, not one that was never recorded.
    if not file.exists() and not file.is_symlink():
        return None
    table = read_parquet(file)
    if schema is None:
        schema = joint_schema_for(table.column_names, file)
    return frame_from_table(conform(table, schema, file))


def recording_folders(
    sources: Mapping[str, Source], inputs: Mapping[str, Path]
) -> dict[tuple[str, int], Path]:
    """(recording, rig) -> folder; a recording of one's own is rig 0.

    Args:
        sources: recording -> where it comes from.
        inputs: role -> version folder; a stand-in rig's is lab/<recording>/<rig>.
    """
    folders = {}
    for name, source in sources.items():
        if source.path is not None:
            folders[name, 0] = Path(source.path)
        else:
            rigs = range(source.rigs or 0)
            folders |= {(name, rig): inputs[f"lab/{name}/{rig}"] / "recording" for rig in rigs}
    return folders
