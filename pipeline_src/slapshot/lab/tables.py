"""The tables of a recording, from the hits of a session."""

import numpy as np
import pandas as pd

from slapshot.arrays import Array
from slapshot.config.lab import Joints
from slapshot.lab.camera import Sighting
from slapshot.lab.commands import Session
from slapshot.scenes.scene import Scene
from slapshot.trajectories.motion import Motion


def hits_table(scene: Scene, session: Session, sightings: list[Sighting], with_latents: bool) -> pd.DataFrame:
    """One row per hit; hits are numbered in the order of execution."""
    number = np.arange(len(session.command))
    unseen = np.full(2, np.nan)
    rests = np.array([unseen if s.rest is None else s.rest for s in sightings])
    hits = pd.DataFrame(
        {
            "hit": number,
            "object_id": session.object_ids,
            "order": number,
            "recorded_at": pd.Series(pd.NaT, index=number, dtype="datetime64[us, UTC]"),
            "command_id": session.command,
            "start_x": scene.info.start[0],
            "start_y": scene.info.start[1],
            "rest_x": rests[:, 0],
            "rest_y": rests[:, 1],
        }
    )
    if with_latents:
        hits["latent"] = [session.commands[i].latent for i in session.command]
    return hits


def tracks_table(sightings: list[Sighting]) -> pd.DataFrame:
    """One row per frame."""
    tracks = pd.DataFrame(np.concatenate([s.frames for s in sightings]), columns=["t", "x", "y", "yaw"])
    tracks.insert(0, "hit", np.repeat(np.arange(len(sightings)), [len(s.frames) for s in sightings]))
    return tracks


def joint_table(rows: list[Array]) -> pd.DataFrame:
    """Table of joint angles, from one array (n, 1 + joints) of t (s) and angles (rad) per hit."""
    stacked = np.concatenate(rows)
    columns = ["t", *(f"q{j}" for j in range(stacked.shape[1] - 1))]
    table = pd.DataFrame(stacked, columns=columns)
    table.insert(0, "hit", np.repeat(np.arange(len(rows)), [len(part) for part in rows]))
    return table


def commanded(motion: Motion, rate: float) -> Array:
    """(n, 1 + joints): t in s and commanded joint positions in rad, `rate` samples per second."""
    times = np.arange(round(motion.duration * rate) + 1) / rate
    return np.column_stack([times, motion.position(times)])


def read_encoders(joints: Array, settings: Joints, rng: np.random.Generator) -> Array:
    """(n, 1 + joints): t in s and joint positions in rad with encoder noise, from the true `joints`."""
    times = np.arange(0.0, joints[-1, 0], 1 / settings.rate_hz)
    read = [np.interp(times, joints[:, 0], joints[:, j]) for j in range(1, joints.shape[1])]
    noise = rng.normal(0, settings.noise_sd_rad, (len(times), len(read)))
    return np.column_stack([times, np.stack(read, axis=1) + noise])
