"""The hits that are shown, gathered from the versions that know something about them."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
from numpy.typing import NDArray

from slapshot.recordings.format import Recording, joint_columns
from slapshot.recordings.read import read_recording
from slapshot.rollouts.dataset import iterate_tracks
from slapshot.scenes.scene import SceneInfo
from slapshot.trajectories.swings import Swings
from slapshot.viewer.choice import choose_evenly

Array = NDArray[np.float64]

GROUPS = {"simulated": ["condition"], "recorded": ["rig", "object"]}
_KEY = ["source", "condition", "name", "rig", "object", "hit"]
# A gap between camera frames is one that lasts longer than this many of its periods.
_GAP = 1.5


@dataclass(frozen=True, eq=False)
class Hit:
    """One hit and what was predicted of it; lengths in m, times in s from its start, angles in rad.

    Attributes:
        id: unique among all hits, the same in every run.
        title: what it is, in a few words.
        facts: what a table of hits says about it; the keys of _KEY and the note.
        object: what was hit, by name; "" in simulation.
        joint_times: (k,).
        joints: (k, joints) of the arm; k is 0 if nobody recorded them.
        track: (n, 4) t, x, y, yaw of the object; yaw is NaN where not measured.
        longest_step: s; a longer one between rows of the track is a gap.
        beliefs: rows of the table of predictions, by number of samples seen; the first is the prior.
    """

    id: str
    title: str
    note: str
    facts: Mapping[str, Any]
    joint_times: Array
    joints: Array
    track: Array
    longest_step: float
    beliefs: pd.DataFrame

    @property
    def truth(self) -> Array:
        """(2,) where the object stopped."""
        return self.beliefs[["true_x_m", "true_y_m"]].to_numpy(float)[0]

    @property
    def errors(self) -> Array:
        """(beliefs,) m between predicted and true rest point."""
        return np.linalg.norm(self.beliefs[["x_m", "y_m"]].to_numpy(float) - self.truth, axis=1)


def gather(inputs: Mapping[str, Path], info: SceneInfo, counts: Mapping[str, int]) -> Iterator[Hit]:
    """The hits to show, `counts` of each source at most.

    Args:
        inputs: folders by role: rollouts, swings, predictions, and lab/0, lab/1, ...
        info: of the scene.
        counts: source -> number of hits.
    """
    predictions = pd.read_parquet(inputs["predictions"] / "predictions.parquet")
    chosen = {
        source: choose_evenly(_hits_of(predictions, source), groups, counts[source])
        for source, groups in GROUPS.items()
    }
    beliefs = dict(iter(predictions.sort_values("samples").groupby(_KEY)))
    if len(chosen["simulated"]):
        yield from _simulated(inputs, info, chosen["simulated"], beliefs)
    for rig, rows in chosen["recorded"].groupby("rig"):
        recording = read_recording(inputs[f"lab/{rig}"] / "recording")
        yield from _recorded(recording, rows, beliefs)


def _hits_of(predictions: pd.DataFrame, source: str) -> pd.DataFrame:
    """(hits, _KEY) of a source, in order."""
    rows = predictions.loc[predictions["source"] == source, _KEY]
    return rows.drop_duplicates().sort_values(_KEY, ignore_index=True)


def _simulated(
    inputs: Mapping[str, Path],
    info: SceneInfo,
    rows: pd.DataFrame,
    beliefs: Mapping[tuple[Any, ...], pd.DataFrame],
) -> Iterator[Hit]:
    swings = Swings.load(inputs["swings"])
    table = pq.read_table(inputs["rollouts"] / "hits-test.parquet", columns=["condition", "hit", "swing"])
    swing_of = table.to_pandas().set_index(["condition", "hit"])["swing"]
    parts = [part[part["split"] == "test"] for part in iterate_tracks(inputs["rollouts"])]
    tracks = dict(iter(pd.concat(parts).groupby(["condition", "hit"])))
    for row in rows.to_dict("records"):
        key = (row["condition"], row["hit"])
        track = tracks[key][["t", "x", "y", "yaw"]].to_numpy(float)
        positions = follow(swings.targets[swing_of.loc[key]], info.control_period / info.servo_time)
        named = f" ({row['name']})" if row["name"] else ""
        yield Hit(
            id=f"simulated-{row['condition']:04d}-{row['hit']:03d}",
            title=f"Simulated, condition {row['condition']}{named}, hit {row['hit']}",
            note="simulation, a condition that training did not see",
            facts=row | {"group": f"condition {row['condition']}{named}"},
            joint_times=np.arange(len(positions)) * info.control_period,
            joints=positions,
            track=track,
            longest_step=np.inf,
            beliefs=beliefs[tuple(row[k] for k in _KEY)],
        )


def _recorded(
    recording: Recording, rows: pd.DataFrame, beliefs: Mapping[tuple[Any, ...], pd.DataFrame]
) -> Iterator[Hit]:
    arm = recording.joints if recording.joints is not None else recording.commands
    arms = {} if arm is None else dict(iter(arm.groupby("hit")))
    tracks = {} if recording.tracks is None else dict(iter(recording.tracks.groupby("hit")))
    nothing = pd.DataFrame(columns=["t", "x", "y", "yaw"], dtype=float)
    for row in rows.to_dict("records"):
        motion = arms.get(row["hit"])
        joints = np.empty((0, 0)) if motion is None else motion[joint_columns(motion)].to_numpy(float)
        yield Hit(
            id=f"recorded-{row['rig']:02d}-{row['object']}-{row['hit']:04d}",
            title=f"Rig {row['rig']}, {row['object']} object, hit {row['hit']}",
            note=STAND_IN if recording.stand_in else f"recorded on {recording.rig}",
            facts=row | {"group": f"rig {row['rig']}, {row['object']}"},
            joint_times=np.empty(0) if motion is None else motion["t"].to_numpy(float),
            joints=joints,
            track=tracks.get(row["hit"], nothing)[["t", "x", "y", "yaw"]].to_numpy(float),
            longest_step=_GAP / recording.camera_rate_hz,
            beliefs=beliefs[tuple(row[k] for k in _KEY)],
        )


# The words of the figures, so that nobody takes such a hit for one of a robot.
STAND_IN = "stand-in rig (simulated), not a real robot"


def follow(targets: Array, share: float) -> Array:
    """(t, joints) rad: where servos are that are sent (t, joints) `targets`.

    A target is q + servo_time * dq/dt, so q follows from it by one Euler step a tick; `share` is the
    control period over servo_time.
    """
    positions = np.empty_like(targets)
    positions[0] = targets[0]  # a swing begins at rest
    for tick in range(1, len(targets)):
        positions[tick] = positions[tick - 1] + share * (targets[tick - 1] - positions[tick - 1])
    return positions
