"""Recordings made with the slide law itself: what a diagnosis must get right before it sees a lab's."""

import numpy as np
import pandas as pd
from slapshot.effects.catalogue import catalogue
from slapshot.effects.slide_law import ActiveEffect, slide
from slapshot.recordings.format import ObjectInfo, Recording

RADIUS = 0.0381
CAMERA = np.array([1.65, 0.0])
START = np.array([0.55, 0.0])


def recording(
    rng,
    hits=100,
    effects=None,
    rate=50.0,
    noise_sd=0.003,
    noise_time=0.0,
    friction=((0.35, 0.32, 0.005),),
    friction_sd=0.03,
    speed=(1.0, 2.4),
    heading=1.2,
    spin_sd=2.0,
    mistracks=0.0,
    missing=0.02,
    yaw_sd=None,
):
    """Hits whose launches are drawn, seen by a camera; `effects` maps a name to values.

    With `yaw_sd` in rad the camera sees how objects turn, from any orientation.
    """
    known = catalogue()
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
        for name, values in (effects or {}).items()
    ]
    slides = [a for a in acting if a.effect.acts_on_slide]
    tracks = slide(launches, mu, RADIUS, 6.0, slides, order)
    delay = 0.6
    rows = []
    for i in range(hits):
        t = np.arange(rng.uniform(0, 1 / rate), delay + tracks.durations[i] + 0.5, 1 / rate)
        places = np.where((t < delay)[:, None], start[i], tracks.at(np.tile(t - delay, (hits, 1)))[i])
        for a in acting:
            if a.effect.acts_on_camera:
                one = {k: x[:1] for k, x in a.values.items()}
                places = a.effect.see(one, places[None], CAMERA)[0]
        white = rng.normal(size=(len(t), 2))
        noise = white.copy()
        memory = np.exp(-1 / (rate * noise_time)) if noise_time else 0.0
        for k in range(1, len(t)):
            noise[k] = memory * noise[k - 1] + np.sqrt(1 - memory**2) * white[k]
        places = places + noise_sd * noise
        wrong = rng.uniform(size=len(t)) < mistracks
        places[wrong] += rng.uniform(-0.2, 0.2, (wrong.sum(), 2))
        seen = rng.uniform(size=len(t)) >= missing
        rows.append(pd.DataFrame({"hit": i, "t": t, "x": places[:, 0], "y": places[:, 1]})[seen])
    frames = pd.concat(rows, ignore_index=True)
    frames["yaw"] = np.nan
    if yaw_sd is not None:
        of = frames["hit"].to_numpy()
        since = np.maximum(frames["t"].to_numpy() - delay, 0.0)
        # Even pressure: spin dies at a rate of its own, which no friction of places tells.
        spin, stops = launches[of, 5], tracks.durations[of]
        turned = spin * np.minimum(since, stops) * (1 - np.minimum(since, stops) / (2 * stops))
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
