"""Tracks of objects that were hit and slid to rest under Coulomb friction, in closed form, and CSV files."""

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import yaml
from slapshot.recordings.format import ObjectInfo, Recording

G = 9.81
RATE_HZ = 100.0


def slide(
    speed: float = 1.2,
    heading: float = 1.0,
    friction: float = 0.2,
    start: tuple[float, float] = (0.5, 0.1),
    before_s: float = 0.5,
    after_s: float = 0.6,
    noise_m: float = 0.0002,
    seed: int = 0,
    rate_hz: float = RATE_HZ,
) -> tuple[np.ndarray, np.ndarray]:
    """(n,) times in s and (n, 2) places in m: at rest, launched at before_s, at rest again."""
    stop = speed / (friction * G)
    t = np.arange(round((before_s + stop + after_s) * rate_hz)) / rate_hz
    since = np.clip(t - before_s, 0.0, stop)
    way = speed * since - friction * G * since**2 / 2
    xy = np.array(start) + np.outer(way, [np.cos(heading), np.sin(heading)])
    return t, xy + np.random.default_rng(seed).normal(0, noise_m, xy.shape)


def varied_slides(count: int = 40, **more: Any) -> list[tuple[np.ndarray, np.ndarray]]:
    """Hits with many speeds and headings and nothing odd in them."""
    rng = np.random.default_rng(5)
    speeds, headings = rng.uniform(0.8, 1.8, count), rng.uniform(-1.0, 1.0, count)
    start = [tuple(rng.normal([0.5, 0.1], 0.002)) for _ in range(count)]
    return [
        slide(speed, heading, start=place, seed=i, **more)
        for i, (speed, heading, place) in enumerate(zip(speeds, headings, start, strict=True))
    ]


def recording_of(tracks: Sequence[tuple[np.ndarray, np.ndarray]], rate_hz: float = RATE_HZ) -> Recording:
    """A recording of tracks whose start and rest points are their ends' medians."""
    hits = pd.DataFrame(
        [
            {
                "hit": i,
                "object_id": "box",
                "order": i,
                "recorded_at": pd.NaT,
                "command_id": pd.NA,
                "start_x": np.median(xy[:10, 0]),
                "start_y": np.median(xy[:10, 1]),
                "rest_x": np.median(xy[-10:, 0]),
                "rest_y": np.median(xy[-10:, 1]),
                "latent": None,
            }
            for i, (_, xy) in enumerate(tracks)
        ]
    )
    frames = [
        pd.DataFrame({"hit": i, "t": t, "x": xy[:, 0], "y": xy[:, 1], "yaw": np.nan})
        for i, (t, xy) in enumerate(tracks)
    ]
    return Recording(
        rig="test-rig",
        objects={"box": ObjectInfo(shape="box", size_m=(0.2, 0.2, 0.1), mass_kg=0.4, mass_sd_kg=0.01)},
        camera_rate_hz=rate_hz,
        frame_note="made for tests",
        stand_in=True,
        trajectory_model=None,
        note="",
        sealed_truth_sha256=None,
        hits=hits,
        tracks=pd.concat(frames, ignore_index=True),
        commands=None,
        joints=None,
    )


def write_csv(
    file: Path, rows: Sequence[Sequence[Any]], header: Sequence[str] = (), delimiter: str = ","
) -> None:
    """A CSV file, its folder made where needed."""
    file.parent.mkdir(parents=True, exist_ok=True)
    with file.open("w", newline="") as stream:
        writer = csv.writer(stream, delimiter=delimiter)
        writer.writerows([header] if header else [])
        writer.writerows(rows)


def write_mapping(file: Path, **changes: Any) -> Path:
    """A mapping of columns t, x and y in SI units; a change of None leaves its key out."""
    mapping = {
        "rig": "test-rig",
        "frame_note": "made for tests",
        "objects": {"box": {"shape": "box", "size_m": [0.2, 0.2, 0.1], "mass_kg": 0.4, "mass_sd_kg": 0.01}},
        "camera_rate_hz": RATE_HZ,
        "columns": {"t": "t", "x": "x", "y": "y"},
        **changes,
    }
    file.write_text(yaml.safe_dump({key: value for key, value in mapping.items() if value is not None}))
    return file
