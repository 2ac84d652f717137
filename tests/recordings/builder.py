"""A small valid recording, seeded, for tests of whatever reads one."""

import dataclasses

import numpy as np
import pandas as pd
from slapshot.recordings.format import ObjectInfo, Recording

RATE_HZ = 50.0
TABLES = ("hits", "tracks", "commands", "joints")


def make_recording(seed: int = 0, n_hits: int = 6, n_joints: int = 7) -> Recording:
    """Full recording: two pucks, three commands with repeats, some frames missing."""
    rng = np.random.default_rng(seed)
    number = 10 + np.arange(n_hits)
    command = np.arange(n_hits) % 3
    latents = rng.normal(size=(3, 2))
    start = rng.normal([0.6, 0.0], 0.003, (n_hits, 2))
    travel = np.array([[1.2, 0.1], [0.9, -0.2], [1.5, 0.0]])[command]
    rest = start + travel + rng.normal(0, 0.05, (n_hits, 2))
    hits = pd.DataFrame(
        {
            "hit": number,
            "object_id": np.array(["ice", "inline", "ice"])[command],
            "order": np.arange(n_hits),
            "recorded_at": pd.date_range("2026-03-01 10:00", periods=n_hits, freq="min", tz="UTC"),
            "command_id": pd.array([None, *command[1:]], dtype="Int64"),
            "start_x": start[:, 0],
            "start_y": start[:, 1],
            "rest_x": rest[:, 0],
            "rest_y": rest[:, 1],
            "latent": list(latents[command]),
        }
    )
    hits.loc[n_hits - 1, ["rest_x", "rest_y"]] = np.nan  # the last one was not seen
    return Recording(
        rig="test-rig",
        objects={
            "ice": ObjectInfo(shape="cylinder", size_m=(0.076, 0.025), mass_kg=0.16, mass_sd_kg=0.001),
            "inline": ObjectInfo(shape="cylinder", size_m=(0.076, 0.025), mass_kg=0.08, mass_sd_kg=0.001),
        },
        camera_rate_hz=RATE_HZ,
        frame_note="origin at the robot's base",
        stand_in=True,
        trajectory_model="vae-0123456789ab",
        note="made for tests: ü",
        sealed_truth_sha256="0" * 64,
        hits=hits,
        tracks=_make_tracks(rng, number, start, travel),
        commands=_make_joints(number, command, n_joints, 0.0, rng),
        joints=_make_joints(number, command, n_joints, 0.001, rng),
    )


def _make_tracks(
    rng: np.random.Generator, number: np.ndarray, start: np.ndarray, travel: np.ndarray
) -> pd.DataFrame:
    t = np.arange(12) / RATE_HZ
    parts = []
    for hit, origin, way in zip(number, start, travel, strict=True):
        seen = np.sort(rng.choice(len(t), len(t) - 2, replace=False))
        xy = origin + np.outer(t / t[-1], way) + rng.normal(0, 0.003, (len(t), 2))
        yaw = np.where(np.arange(len(t)) % 3 == 0, np.nan, 0.1 * t)
        part = pd.DataFrame({"hit": hit, "t": t, "x": xy[:, 0], "y": xy[:, 1], "yaw": yaw})
        parts.append(part.iloc[seen])
    return pd.concat(parts, ignore_index=True)


def _make_joints(
    number: np.ndarray, command: np.ndarray, n_joints: int, noise: float, rng: np.random.Generator
) -> pd.DataFrame:
    t = np.linspace(0, 1, 5)
    parts = []
    for hit, which in zip(number, command, strict=True):
        q = np.sin(t[:, None] + np.arange(n_joints) + which)
        q = q + noise * rng.normal(size=q.shape)
        columns = {"hit": hit, "t": t, **{f"q{j}": q[:, j] for j in range(n_joints)}}
        parts.append(pd.DataFrame(columns))
    return pd.concat(parts, ignore_index=True)


def assert_same_tables(a: Recording, b: Recording) -> None:
    """Equal content, to the last bit."""
    for name in TABLES:
        left, right = getattr(a, name), getattr(b, name)
        if left is None or right is None:
            assert left is right
        else:
            pd.testing.assert_frame_equal(left, right, check_exact=True)


def assert_same(a: Recording, b: Recording) -> None:
    """Equal tables and equal recording.json."""
    assert_same_tables(a, b)
    for field in dataclasses.fields(a):
        if field.name not in TABLES:
            assert getattr(a, field.name) == getattr(b, field.name), field.name
