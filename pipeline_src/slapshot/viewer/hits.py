"""Hits to show: an even selection over groups, collected from the versions that describe them."""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from slapshot.arrays import Array
from slapshot.parquet import read_table
from slapshot.recordings.format import Recording, joint_columns
from slapshot.recordings.read import read_recording
from slapshot.rollouts.reading import iterate_tracks
from slapshot.scenes.scene import SceneInfo
from slapshot.trajectories.swings import Swings


def choose_evenly(table: pd.DataFrame, groups: list[str], count: int) -> pd.DataFrame:
    """At most `count` rows of `table`, evenly over its groups and evenly spaced within each.

    Args:
        table: rows in a meaningful order, for example that of execution.
        groups: columns that identify the groups.
        count: number of rows wanted.
    """
    members = [index.to_numpy() for _, index in table.index.to_series().groupby([table[g] for g in groups])]
    quotas = even_quotas(np.array([len(m) for m in members], dtype=np.int64), count)
    selected = [m[_spread(len(m), int(quota))] for m, quota in zip(members, quotas, strict=True) if quota]
    return table.loc[np.concatenate(selected)] if selected else table.iloc[:0]


def even_quotas(sizes: NDArray[np.int64], count: int) -> NDArray[np.int64]:
    """(groups,) how many to take of each group of `sizes`, as equal as possible, `count` in all."""
    quotas = np.zeros_like(sizes)
    left = min(count, int(sizes.sum()))
    while left:
        with_more = np.flatnonzero(quotas < sizes)
        each = left // len(with_more)
        if each:
            step = np.minimum(each, sizes[with_more] - quotas[with_more])
        else:  # fewer than groups: a group here and there, not the first ones
            with_more = with_more[_spread(len(with_more), left)]
            step = np.ones_like(with_more)
        quotas[with_more] += step
        left -= int(step.sum())
    return quotas


def _spread(size: int, count: int) -> NDArray[np.int64]:
    """(count,) indices below `size`, evenly spaced, none twice."""
    return np.floor((np.arange(count) + 0.5) * size / count).astype(np.int64)


GROUPS = {"simulated": ["condition"], "recorded": ["recording", "rig", "object"]}
_KEY = ["source", "condition", "name", "recording", "rig", "object", "hit"]
# As in the figures, so that such a hit is not taken for one of a real robot.
STAND_IN = "stand-in rig (simulated), not a real robot"
# A gap between camera frames is one that lasts longer than this many of its periods.
_GAP = 1.5


@dataclass(frozen=True, eq=False)
class Hit:
    """One hit and its predictions; lengths in m, times in s from its start, angles in rad.

    Attributes:
        id: unique among all hits, the same in every run.
        title: what it is, in a few words.
        note: where it comes from.
        facts: source, group as text, condition, name, rig, object, hit: its identity.
        joint_times: (k,).
        joints: (k, joints) of the arm; k is 0 if not recorded.
        track: (n, 4) t, x, y, yaw of the object; yaw is NaN where not measured.
        max_gap_s: s; a longer step between rows of the track is a gap.
        beliefs: rows of the table of predictions, by number of samples seen; the first is the prior.
    """

    id: str
    title: str
    note: str
    facts: Mapping[str, Any]
    joint_times: Array
    joints: Array
    track: Array
    max_gap_s: float
    beliefs: pd.DataFrame

    @property
    def truth(self) -> Array:
        """(2,) where the object stopped."""
        return self.beliefs[["true_x_m", "true_y_m"]].to_numpy(float)[0]

    @property
    def errors(self) -> Array:
        """(beliefs,) m between predicted and true rest point."""
        return np.linalg.norm(self.beliefs[["x_m", "y_m"]].to_numpy(float) - self.truth, axis=1)


def select_hits(predictions: pd.DataFrame, counts: Mapping[str, int]) -> pd.DataFrame:
    """(hits, _KEY) to show: `counts` of each source at most, evenly over its groups."""
    hits = predictions[_KEY].drop_duplicates().sort_values(_KEY, ignore_index=True)
    return pd.concat(
        [
            choose_evenly(hits[hits["source"] == source], groups, counts[source])
            for source, groups in GROUPS.items()
        ]
    )


def read_hits(
    inputs: Mapping[str, Path],
    recordings: Mapping[tuple[str, int], Path],
    info: SceneInfo,
    selected: pd.DataFrame,
    predictions: pd.DataFrame,
    domain: str,
) -> Iterator[Hit]:
    """Collect the data of the selected hits.

    Args:
        inputs: folders by role: rollouts and swings.
        recordings: folders by recording and rig.
        info: of the scene.
        selected: from `select_hits`.
        predictions: of all hits.
        domain: begins the hits' ids, which no two recordings of a gallery may share.
    """
    beliefs = dict(iter(predictions.sort_values("samples").groupby(_KEY)))
    simulated = selected[selected["source"] == "simulated"]
    if len(simulated):
        yield from _simulated(inputs, info, simulated, beliefs, domain)
    recorded = selected[selected["source"] == "recorded"]
    for key, folder in recordings.items():
        rows = recorded[(recorded["recording"] == key[0]) & (recorded["rig"] == key[1])]
        if len(rows):
            yield from _recorded(read_recording(folder), rows, beliefs, domain)


def _simulated(
    inputs: Mapping[str, Path],
    info: SceneInfo,
    rows: pd.DataFrame,
    beliefs: Mapping[tuple[Any, ...], pd.DataFrame],
    domain: str,
) -> Iterator[Hit]:
    swings = Swings.load(inputs["swings"])
    table = read_table(inputs["rollouts"] / "hits-test.parquet", columns=["condition", "hit", "swing"])
    swing_of = table.to_pandas().set_index(["condition", "hit"])["swing"]
    parts = [part[part["split"] == "test"] for part in iterate_tracks(inputs["rollouts"])]
    tracks = dict(iter(pd.concat(parts).groupby(["condition", "hit"])))
    for row in _records(rows):
        key = (row["condition"], row["hit"])
        # Rounded, so that a time is 0.65 s and not the nearest single-precision number.
        track = tracks[key][["t", "x", "y", "yaw"]].to_numpy(float).round(6)
        swing = swing_of.loc[key]
        named = f" ({row['name']})" if row["name"] else ""
        yield Hit(
            id=f"{domain}-simulated-{row['condition']:04d}-{row['hit']:03d}",
            title=f"Simulated, condition {row['condition']}{named}, hit {row['hit']}",
            note="simulation, a condition that training did not see",
            facts=row | {"group": f"condition {row['condition']}{named}"},
            joint_times=swings.pose_times(info.control_period),
            joints=swings.poses[swing],
            track=track,
            max_gap_s=np.inf,
            beliefs=beliefs[tuple(row[k] for k in _KEY)],
        )


def _recorded(
    recording: Recording,
    rows: pd.DataFrame,
    beliefs: Mapping[tuple[Any, ...], pd.DataFrame],
    domain: str,
) -> Iterator[Hit]:
    arm = recording.joints if recording.joints is not None else recording.commands
    arms = {} if arm is None else dict(iter(arm.groupby("hit")))
    tracks = {} if recording.tracks is None else dict(iter(recording.tracks.groupby("hit")))
    nothing = pd.DataFrame(columns=["t", "x", "y", "yaw"], dtype=float)
    kind = "Stand-in" if recording.stand_in else "Recorded"
    for row in _records(rows):
        group = f"{row['recording']} rig {row['rig']:02d}, {row['object']}"
        motion = arms.get(row["hit"])
        joints = np.empty((0, 0)) if motion is None else motion[joint_columns(motion)].to_numpy(float)
        yield Hit(
            id=re.sub(
                r"[^\w.-]+",
                "_",
                f"{domain}-recorded-{row['recording']}-{row['rig']:02d}-{row['object']}-{row['hit']:04d}",
            ),
            title=f"{kind}, {group}, hit {row['hit']}",
            note=STAND_IN if recording.stand_in else f"recorded on {recording.rig}",
            facts=row | {"group": group},
            joint_times=np.empty(0) if motion is None else motion["t"].to_numpy(float),
            joints=joints,
            track=tracks.get(row["hit"], nothing)[["t", "x", "y", "yaw"]].to_numpy(float),
            max_gap_s=_GAP / recording.camera_rate_hz,
            beliefs=beliefs[tuple(row[k] for k in _KEY)],
        )


def _records(rows: pd.DataFrame) -> list[dict[str, Any]]:
    return [{str(key): value for key, value in row.items()} for row in rows.to_dict("records")]
