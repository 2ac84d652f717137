"""Recordings of slides by the diagnosis' own law: what it must get right before it sees a lab's."""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from slapshot.arrays import Array
from slapshot.effects.catalogue import catalogue
from slapshot.effects.slide_law import ActiveEffect, slide
from slapshot.recordings.format import ObjectInfo, Recording

RADIUS = 0.0381  # m, of the object
CAMERA = np.array([1.65, 0.0])  # m, at which it looks
START = np.array([0.55, 0.0])  # m, where objects are put
_DELAY = 0.6  # s after which they are launched
_MISTRACK = 0.2  # m


def slide_recording(
    rng: np.random.Generator,
    hits: int = 100,
    effects: Mapping[str, Mapping[str, float]] | None = None,
    *,
    rate: float = 50.0,
    noise_sd: float = 0.003,
    noise_time: float = 0.0,
    friction: Sequence[tuple[float, float, float]] = ((0.35, 0.32, 0.005),),
    friction_sd: float = 0.03,
    speed: tuple[float, float] = (1.0, 2.4),
    heading: float = 1.2,
    spin_sd: float = 2.0,
    mistracks: float = 0.0,
    missing: float = 0.02,
    yaw_sd: float | None = None,
) -> Recording:
    """Hits whose launches are drawn, seen by a camera: tracks only.

    Args:
        rng: of all that is drawn.
        hits: of all objects together.
        effects: name -> values of what acts on the slide or the camera; neutral ones may be left out.
        rate: Hz, of the camera.
        noise_sd: m, along x and y.
        noise_time: s, memory of the noise.
        friction: mu_x, mu_y and torsional in m of each object.
        friction_sd: of its logarithm from hit to hit.
        speed: m/s, least and largest.
        heading: rad, largest to either side.
        spin_sd: rad/s.
        mistracks: share of frames that show something else.
        missing: share of frames that are lost.
        yaw_sd: rad, noise of yaw, seen from any orientation; None where it is not recorded.
    """
    known = catalogue()
    values_of = {name: known[name].neutral() | dict(values) for name, values in (effects or {}).items()}
    angle = rng.uniform(-heading, heading, hits)
    v = rng.uniform(*speed, hits)
    start = START + rng.normal(0, 0.01, (hits, 2))
    launches = np.column_stack(
        [start, np.zeros(hits), v * np.cos(angle), v * np.sin(angle), rng.normal(0, spin_sd, hits)]
    )
    objects = np.arange(hits) % len(friction)
    mu = np.array(friction)[objects]
    mu[:, :2] *= np.exp(rng.normal(0, friction_sd, hits))[:, None]
    order = np.arange(hits) / max(hits - 1, 1) - 0.5
    acting = [
        ActiveEffect(known[name], np.arange(hits), {k: np.full(hits, x) for k, x in values.items()})
        for name, values in values_of.items()
    ]
    tracks = slide(launches, mu, RADIUS, 6.0, [a for a in acting if a.effect.acts_on_slide], order)
    rows = []
    for i in range(hits):
        t = np.arange(rng.uniform(0, 1 / rate), _DELAY + tracks.durations[i] + 0.5, 1 / rate)
        since = np.tile(t - _DELAY, (hits, 1))
        places = np.where((t < _DELAY)[:, None], start[i], tracks.at(since)[i])
        for a in acting:
            if a.effect.acts_on_camera:
                one = {k: np.array([x]) for k, x in values_of[a.effect.name].items()}
                places = a.effect.see(one, places[None], CAMERA)[0]
        places = places + noise_sd * _noise(len(t), rate * noise_time, rng)
        wrong = rng.uniform(size=len(t)) < mistracks
        places[wrong] += rng.uniform(-_MISTRACK, _MISTRACK, (wrong.sum(), 2))
        seen = rng.uniform(size=len(t)) >= missing
        rows.append(pd.DataFrame({"hit": i, "t": t, "x": places[:, 0], "y": places[:, 1]})[seen])
    frames = pd.concat(rows, ignore_index=True)
    frames["yaw"] = np.nan
    if yaw_sd is not None:
        of = frames["hit"].to_numpy()
        turned = np.concatenate(
            [
                tracks.yaw_at(np.tile(t - _DELAY, (hits, 1)))[i]
                for i, (_, t) in enumerate(frames.groupby("hit")["t"])
            ]
        )
        yaw = rng.uniform(-np.pi, np.pi, hits)[of] + turned + yaw_sd * rng.normal(size=len(of))
        frames["yaw"] = np.angle(np.exp(1j * yaw))
    names = [f"object {k}" for k in range(len(friction))]
    table = pd.DataFrame(
        {
            "hit": np.arange(hits),
            "object_id": [names[k] for k in objects],
            "order": np.arange(hits),
            "recorded_at": pd.Series(pd.NaT, index=range(hits), dtype="datetime64[us, UTC]"),
            "command_id": pd.array([pd.NA] * hits, dtype="Int64"),
            "start_x": START[0],
            "start_y": START[1],
            "rest_x": tracks.rests[:, 0],
            "rest_y": tracks.rests[:, 1],
            "latent": None,
        }
    )
    info = ObjectInfo(shape="cylinder", size_m=(2 * RADIUS, 0.0254), mass_kg=0.1, mass_sd_kg=0.001)
    return Recording(
        "synthetic", dict.fromkeys(names, info), rate, "", True, None, "", None, table, frames, None, None
    )


def _noise(count: int, frames: float, rng: np.random.Generator) -> Array:
    """(count, 2) of unit variance, with a memory of so many frames."""
    white = rng.normal(size=(count, 2))
    noise = white.copy()
    memory = np.exp(-1 / frames) if frames else 0.0
    for k in range(1, count):
        noise[k] = memory * noise[k - 1] + np.sqrt(1 - memory**2) * white[k]
    return noise
