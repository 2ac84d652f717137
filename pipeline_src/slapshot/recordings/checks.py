"""Validity checks of a recording beyond its columns' types and units, one function for each check.

The functions take tables as `tables.frame_from_table` returns them and raise InputError with one
line: file, row or hit, and what to do. Rows are counted from 0, as pandas does.
"""

from pathlib import Path

import numpy as np
import pandas as pd

from slapshot.errors import InputError
from slapshot.recordings.format import (
    COMMANDS_FILE,
    HEADER_FILE,
    HITS_FILE,
    JOINTS_FILE,
    TRACKS_FILE,
    ObjectInfo,
    Recording,
    joint_columns,
)
from slapshot.recordings.plausibility import (
    IMPOSSIBLE_JOINT_RAD,
    IMPOSSIBLE_M,
    IMPOSSIBLE_S,
    IMPOSSIBLE_YAW_RAD,
    check_begin,
    check_dates,
    check_dense_hits,
    check_frame_interval,
    check_metres,
    check_possible,
    check_radians,
    check_swing_length,
    check_travel,
)
from slapshot.validation import short

# Repeats of one command are the same numbers; this leaves room for a text file in between.
COMMAND_TOLERANCE = 1e-9
_MAX_HITS = 100_000
_MAX_LATENT_SIZE, _MAX_LATENT = 1000, 1e3


def check_recording(recording: Recording, folder: Path) -> None:
    """Run every check on a recording.

    Args:
        recording: With tables of the format's columns and types.
        folder: Where it lies or will lie, to name files in errors.

    Raises:
        InputError: On the first check that fails.
    """
    hits_file = folder / HITS_FILE
    hits = recording.hits
    check_hit_numbers(hits, hits_file)
    check_objects_known(hits, recording.objects, hits_file)
    check_rest_pairs(hits, hits_file)
    check_possible(hits, ["start_x", "start_y", "rest_x", "rest_y"], IMPOSSIBLE_M, "a place in m", hits_file)
    check_metres(hits, "start_x", "start_y", hits_file)
    check_metres(hits, "rest_x", "rest_y", hits_file)
    check_travel(hits, hits_file)
    check_dates(hits, hits_file)
    check_latents(hits, recording.trajectory_model, hits_file)
    check_usable(recording, folder)
    if recording.tracks is not None:
        file = folder / TRACKS_FILE
        check_timed_rows(recording.tracks, hits["hit"], file)
        check_shows_motion(recording.tracks, file)
        check_possible(recording.tracks, ["x", "y"], IMPOSSIBLE_M, "a place in m", file)
        check_possible(recording.tracks, ["yaw"], IMPOSSIBLE_YAW_RAD, "an angle in rad", file)
        check_begin(recording.tracks, file)
        check_metres(recording.tracks, "x", "y", file)
        check_radians(recording.tracks, ["yaw"], file)
        check_frame_interval(recording.tracks, recording.camera_rate_hz, file)
        check_dense_hits(recording.tracks, recording.camera_rate_hz, file)
    for table, name in ((recording.commands, COMMANDS_FILE), (recording.joints, JOINTS_FILE)):
        if table is not None:
            check_timed_rows(table, hits["hit"], folder / name)
            check_shows_motion(table, folder / name)
            joint_names = joint_columns(table)
            check_possible(
                table, joint_names, IMPOSSIBLE_JOINT_RAD, "the angle of a joint in rad", folder / name
            )
            check_begin(table, folder / name)
            check_radians(table, joint_names, folder / name)
            check_swing_length(table, folder / name)
    check_joint_counts(recording.commands, recording.joints, folder / JOINTS_FILE)
    check_joint_times(recording.commands, recording.joints, folder / JOINTS_FILE)
    if recording.commands is not None:
        check_repeats(hits, recording.commands, folder / COMMANDS_FILE)


def check_hit_numbers(hits: pd.DataFrame, file: Path) -> None:
    """Refuse a table without hits, and hit numbers that stand twice."""
    if hits.empty:
        raise InputError(f"{file}: has no hits: record some")
    if len(hits) > _MAX_HITS:
        raise InputError(
            f"{file}: has {len(hits):,} hits, and {_MAX_HITS:,} are allowed: split it into several"
        )
    numbers = hits["hit"].to_numpy()
    second = hits["hit"].duplicated().to_numpy()
    if second.any():
        row = int(np.flatnonzero(second)[0])
        first = int(np.flatnonzero(numbers == numbers[row])[0])
        raise InputError(
            f"{file}: duplicate hit {numbers[row]} in rows {first} and {row} (the first is 0): "
            "give every hit its own number"
        )


def check_objects_known(hits: pd.DataFrame, objects: dict[str, ObjectInfo], file: Path) -> None:
    """Refuse hits of an object that recording.json does not describe."""
    unknown = ~hits["object_id"].isin(list(objects)).to_numpy()
    if unknown.any():
        row = int(np.flatnonzero(unknown)[0])
        raise InputError(
            f"{file}: row {row} (the first is 0), hit {hits['hit'].iloc[row]}: object_id "
            f"{hits['object_id'].iloc[row]!r} is not among the objects of {HEADER_FILE} "
            f"({short(list(objects))}): describe it there or correct it"
        )


def check_rest_pairs(hits: pd.DataFrame, file: Path) -> None:
    """Refuse half a rest point."""
    missing = hits[["rest_x", "rest_y"]].isna().to_numpy()  # (n_hits, 2)
    half = missing[:, 0] != missing[:, 1]
    if half.any():
        row = int(np.flatnonzero(half)[0])
        there, gone = ("rest_y", "rest_x") if missing[row, 0] else ("rest_x", "rest_y")
        raise InputError(
            f"{file}: row {row} (the first is 0), hit {hits['hit'].iloc[row]}: {there} is given "
            f"but {gone} is null: give both, or neither if the rest point was not seen"
        )


def check_latents(hits: pd.DataFrame, trajectory_model: str | None, file: Path) -> None:
    """Refuse latents that differ in length, are incomplete, or belong to no named model."""
    latents = hits["latent"].tolist()
    given = [latent is not None for latent in latents]
    if not any(given):
        return
    if trajectory_model is None:
        raise InputError(
            f"{file}: column 'latent' is given, but {HEADER_FILE} has no key 'trajectory_model': "
            "name there the model that decodes the latents"
        )
    first = given.index(True)
    if len(latents[first]) > _MAX_LATENT_SIZE:
        raise InputError(
            f"{file}: row {first} (the first is 0): the latent has {len(latents[first]):,} numbers, and "
            f"{_MAX_LATENT_SIZE} are allowed: give the latent, not what is decoded from it"
        )
    for row, (hit, latent) in enumerate(zip(hits["hit"], latents, strict=True)):
        where = f"{file}: row {row} (the first is 0), hit {hit}: the latent"
        if latent is None:
            raise InputError(f"{where} is null, others are not: give it for all hits or for none")
        if len(latent) != len(latents[first]) or len(latent) == 0:
            raise InputError(
                f"{where} has length {len(latent)}, that of hit {hits['hit'].iloc[first]} has "
                f"{len(latents[first])}: all must have the same length, at least 1"
            )
        if not np.isfinite(latent).all():
            raise InputError(f"{where} holds NaN, null or an infinite value: correct it")
        if np.abs(latent).max() > _MAX_LATENT:
            raise InputError(
                f"{where} holds {np.abs(latent).max():.6g}, which no model decodes: latents are about -3 to 3"
            )


def check_usable(recording: Recording, folder: Path) -> None:
    """Refuse a recording without information: no outcome, or rest points without commands or latents."""
    latents = recording.hits["latent"].notna().any()
    rests = recording.hits["rest_x"].notna().any()
    if recording.tracks is None and not rests:
        raise InputError(
            f"{folder}: nothing to use: there is no {TRACKS_FILE}, and {HITS_FILE} has no rest "
            "point: add one of them"
        )
    if recording.tracks is None and recording.commands is None and not latents:
        raise InputError(
            f"{folder}: nothing to use: rest points need to know how the object was hit: add "
            f"{COMMANDS_FILE}, or column 'latent' in {HITS_FILE}, or {TRACKS_FILE}"
        )


def check_timed_rows(
    table: pd.DataFrame, numbers: pd.Series, file: Path, of: str = "hit", listed_in: str = HITS_FILE
) -> None:
    """Refuse an empty table, rows of unknown hits, and times that do not increase within a hit.

    Args:
        table: With columns t and `of`.
        numbers: Of the hits or episodes that there are.
        file: Named in errors.
        of: What the rows are of: hit or episode.
        listed_in: File that has those.
    """
    if table.empty:
        raise InputError(f"{file}: has no rows: remove the file or export it again")
    number = table[of].to_numpy()
    unknown = ~np.isin(number, numbers.to_numpy())
    if unknown.any():
        row = int(np.flatnonzero(unknown)[0])
        raise InputError(
            f"{file}: row {row} (the first is 0): {of} {number[row]} is not in {listed_in}: add it "
            "there or remove its rows here"
        )
    t = table["t"].to_numpy()
    negative = t < 0
    if negative.any():
        row = int(np.flatnonzero(negative)[0])
        raise InputError(
            f"{file}: row {row} (the first is 0), {of} {number[row]}: t is {t[row]:g} s, before the "
            f"{of}'s start: shift the times so that the {of} starts at 0"
        )
    check_possible(table, ["t"], IMPOSSIBLE_S, f"a time from the {of}'s start in s", file, of)
    rows = np.argsort(number, kind="stable")  # rows of a hit side by side, in the file's order
    same_hit = np.diff(number[rows]) == 0
    wrong = np.flatnonzero(same_hit & (np.diff(t[rows]) <= 0))
    if wrong.size:
        before, row = rows[wrong[0]], rows[wrong[0] + 1]
        where = f"{file}: row {row} (the first is 0), {of} {number[row]}:"
        if t[row] == t[before]:
            raise InputError(f"{where} the same time twice (t = {t[row]:g} s): remove one row")
        raise InputError(
            f"{where} time goes backwards (from {t[before]:g} s to {t[row]:g} s): sort the rows or "
            "correct the clock"
        )


def check_shows_motion(table: pd.DataFrame, file: Path, of: str = "hit") -> None:
    """Refuse a table without two rows of one hit."""
    if not table[of].duplicated().any():
        raise InputError(
            f"{file}: has one row of each {of} at most, which shows no motion: export all rows, or remove "
            "the file"
        )


def check_joint_counts(commands: pd.DataFrame | None, joints: pd.DataFrame | None, file: Path) -> None:
    """Refuse measured joints that differ from the commanded ones."""
    if commands is None or joints is None:
        return
    commanded, measured = len(joint_columns(commands)), len(joint_columns(joints))
    if commanded != measured:
        raise InputError(
            f"{file}: has {measured} joint columns, {COMMANDS_FILE} has {commanded}: give the "
            "same joints in both"
        )


def check_joint_times(commands: pd.DataFrame | None, joints: pd.DataFrame | None, file: Path) -> None:
    """Refuse joints that were measured before or after their commands: the clocks differ."""
    if commands is None or joints is None:
        return
    given = {"commands": commands, "joints": joints}
    first = pd.DataFrame({name: table.groupby("hit")["t"].min() for name, table in given.items()})
    last = pd.DataFrame({name: table.groupby("hit")["t"].max() for name, table in given.items()})
    apart = first.max(axis=1, skipna=False) > last.min(axis=1, skipna=False)
    if apart.any():
        hit = apart.index[apart][0]
        (a, c), (b, d) = first.loc[hit], last.loc[hit]
        raise InputError(
            f"{file}: hit {hit}: joints are measured from {c:g} to {d:g} s, but {COMMANDS_FILE} has them "
            f"from {a:g} to {b:g} s: give both on one clock, from the hit's start"
        )


def check_repeats(hits: pd.DataFrame, commands: pd.DataFrame, file: Path) -> None:
    """Refuse hits with one command_id whose commands differ: repeats measure the rig's scatter."""
    columns = ["t", *joint_columns(commands)]
    of_hit = {int(rows["hit"].iloc[0]): rows[columns].to_numpy() for _, rows in commands.groupby("hit")}
    first_of: dict[int, int] = {}
    with_id = hits[hits["command_id"].notna() & hits["hit"].isin(list(of_hit))]
    numbers = with_id["hit"].tolist(), with_id["command_id"].tolist()
    for hit, command_id in zip(*numbers, strict=True):
        first = first_of.setdefault(command_id, hit)
        a, b = of_hit[first], of_hit[hit]  # (n_rows, 1 + n_joints) each
        if a.shape == b.shape and np.abs(a - b).max() <= COMMAND_TOLERANCE:
            continue
        what = (
            f"have {len(a)} and {len(b)} rows" if len(a) != len(b) else f"differ by {np.abs(a - b).max():.3g}"
        )
        raise InputError(
            f"{file}: hits {first} and {hit} share command_id {command_id}, but their commands "
            f"{what}: give them different command_ids in {HITS_FILE} or the same commands"
        )
