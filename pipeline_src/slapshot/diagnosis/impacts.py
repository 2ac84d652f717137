"""Impacts in recordings of bodies that fly: `without_impacts`.

A bounce or a catch is no physics that a model without contacts could lack, and changes the velocity of a
table tennis ball by more than drag does in half a second.
"""

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise

import mujoco
import numpy as np
import pandas as pd

from slapshot.arrays import Array
from slapshot.diagnosis.model.rig import Rig
from slapshot.diagnosis.model.unseen_joints import observed_point
from slapshot.recordings.channels import PLACE
from slapshot.recordings.signals import SignalRecording

_WINDOW_S, _SAMPLES = 0.05, 4  # on either side of a moment, in which a velocity is that of a straight line
# An impact changes the velocity by so many times the median change, times its noise, and by a share of it.
_USUAL, _NOISE, _SHARE = 5.0, 8.0, 0.3
_FLIES = 0.2  # share of the usual speed, or of the farthest travel between impacts: what lies has less
_GAP = 1.5  # times as long as usual are samples across a gap, in which gravity alone changes the velocity


def without_impacts(recording: SignalRecording, rig: Rig) -> tuple[SignalRecording, list[str]]:
    """The longest stretch of each episode in which no free body hits anything.

    Of models with contacts or controls, and where a place is not observed whole, the recording as it is.

    Args:
        recording: whole.
        rig: bound to it.

    Returns:
        The recording, and a note if episodes were cut.
    """
    if rig.collides or any(control.channel is not None for control in rig.controls):
        return recording, []
    when: dict[int, list[float]] = {}
    places: dict[int, tuple[Array, Array]] = {}  # times and places of the point that is seen most
    for clock, names in _flights(recording, rig):
        for key, rows in recording.signals[clock].groupby("episode"):
            episode, seen = int(str(key)), rows.dropna(subset=names)
            t, way = seen["t"].to_numpy(), seen[names].to_numpy()
            when.setdefault(episode, []).extend(impacts(t, way))
            if episode not in places or len(t) > len(places[episode][0]):
                places[episode] = t, way
    kept = {episode: _longest_flight(*places[episode], found) for episode, found in when.items() if found}
    if not kept:
        return recording, []
    signals = {clock: _cut(table, kept) for clock, table in recording.signals.items()}
    whole = set.intersection(*(set(table["episode"]) for table in signals.values()))
    signals = {
        clock: table[table["episode"].isin(whole)].reset_index(drop=True) for clock, table in signals.items()
    }
    if any(signals[recording.channels[o.channel].clock][o.channel].isna().all() for o in rig.observations):
        return recording, ["episodes have impacts, and without them a channel has no value: cut them by hand"]
    episodes = recording.episodes[recording.episodes["episode"].isin(whole)].reset_index(drop=True)
    note = (
        f"{len(kept)} of {len(recording.episodes)} episodes have impacts (velocities that change at once): "
        "the longest flight of each is used"
    )
    return replace(recording, episodes=episodes, signals=signals), [note]


def _longest_flight(t: Array, places: Array, when: list[float]) -> tuple[float, float]:
    """Begin and end in s of the longest stretch between impacts in which places (n, 3) travel."""
    # Two samples of either side may be of the impact itself.
    margin = 2 * float(np.median(np.diff(t)))
    pieces = [(a + margin, b - margin) for a, b in pairwise([-np.inf, *sorted(when), np.inf])]
    parts = [places[(t >= a) & (t <= b)] for a, b in pieces]
    travel = np.array([np.linalg.norm(np.ptp(part, axis=0)) if len(part) else 0.0 for part in parts])
    counts = [
        len(part) if far else 0 for part, far in zip(parts, travel >= _FLIES * travel.max(), strict=True)
    ]
    return pieces[int(np.argmax(counts))]


def impacts(t: Array, places: Array) -> list[float]:
    """Times in s at which the velocity of places (n, 3) in m, seen at times (n,), changes at once."""
    n, interval = len(t), float(np.median(np.diff(t))) if len(t) > 1 else 1.0
    width = max(_SAMPLES, round(_WINDOW_S / interval))
    if n < 2 * width + 2:
        return []
    lines = [_line(t[i : i + width], places[i : i + width]) for i in range(n - width + 1)]
    velocity = np.array([line[0] for line in lines])
    error = float(np.median([line[1] for line in lines]))
    change = np.linalg.norm(velocity[width:] - velocity[:-width], axis=1)  # about samples width - 1 and width
    fast = np.linalg.norm(velocity, axis=1)
    # Long rest beside a flight says nothing of how velocities change in it.
    flies = fast > _FLIES * np.quantile(fast, 0.95)
    if not flies.any():
        return []
    both = flies[width:] & flies[:-width]
    usual = float(np.median(change[both])) if both.any() else 0.0
    speed = float(np.sqrt(np.mean(fast[flies] ** 2)))
    least = max(_USUAL * usual, _NOISE * error * np.sqrt(2), _SHARE * speed)
    found: list[float] = []
    span = t[2 * width - 1 :] - t[: n - 2 * width + 1]
    above = (change > least) & (span < _GAP * (2 * width - 1) * interval)
    while above.any():
        i = int(np.argmax(np.where(above, change, -1)))
        found.append(float(t[i + width - 1] + t[i + width]) / 2)
        above[max(0, i - width) : i + width + 1] = False
    return sorted(found)


def _line(t: Array, places: Array) -> tuple[Array, float]:
    """Slope of a straight line (3,), and the standard error of its size."""
    centred = t - t.mean()
    square = float(centred @ centred)
    slope = centred @ places / square
    left = places - places.mean(axis=0) - np.outer(centred, slope)
    freedom = max(places.shape[1] * (len(t) - 2), 1)
    return slope, float(np.sqrt(places.shape[1] * np.sum(left**2) / freedom / square))


def _flights(recording: SignalRecording, rig: Rig) -> Iterator[tuple[str, list[str]]]:
    """Clock and channels x, y, z of each point on a free body whose place is observed whole."""
    points: dict[tuple[str, int, int], dict[str, str]] = {}
    for column, observation in enumerate(rig.observations):
        channel, sensor = recording.channels[observation.channel], rig.sensor_of(column)
        if observation.quantity != "position" or channel.component not in PLACE:
            continue
        point = observed_point(rig.model, sensor)
        joint = -1 if point is None else int(rig.model.body_jntadr[point.body])
        if joint >= 0 and rig.model.jnt_type[joint] == int(mujoco.mjtJoint.mjJNT_FREE):
            key = channel.clock, int(rig.model.sensor_objtype[sensor]), int(rig.model.sensor_objid[sensor])
            points.setdefault(key, {})[channel.component] = observation.channel
    for (clock, *_), names in points.items():
        if len(names) == len(PLACE):
            yield clock, [names[component] for component in PLACE]


def _cut(table: pd.DataFrame, kept: dict[int, tuple[float, float]]) -> pd.DataFrame:
    """Rows within the stretches that are kept."""
    begin, end = (
        table["episode"].map({e: piece[k] for e, piece in kept.items()}).fillna(whole)
        for k, whole in ((0, -np.inf), (1, np.inf))
    )
    return table[(table["t"] >= begin) & (table["t"] <= end)].reset_index(drop=True)
