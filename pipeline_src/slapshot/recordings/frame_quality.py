"""What is odd in a recording's frames: its clock, gaps, frozen and wrong frames, noise at rest."""

from collections.abc import Iterator

import numpy as np
import pandas as pd

from slapshot.recordings.motion_detection import moving_speed, smooth
from slapshot.recordings.quality_warning import QualityWarning
from slapshot.recordings.track_features import HitTrack, rest_noise

# Share of the frame interval: what a text file leaves of a counted time, and what is another rate.
_EXACT, _OTHER_RATE = 1e-6, 0.02
_GAP = 1.5  # intervals; a longer one lacks a frame
_MANY_MISSING, _LONG_GAP_S, _LONG_GAP = 0.1, 0.1, 3.5  # share of frames; s and intervals
_MANY_SAME = 0.05  # of the frames at rest
_JUMP_NOISE, _LEAST_JUMP_M = 8.0, 0.005
_UNEVEN_NOISE = 4.0  # times the median hit's
_COLOURED = 0.5  # correlation of neighbouring frames at rest
_COARSE = 1.0  # step of the numbers over noise at rest
_MANY_JITTER, _LEAST_JITTER = 3.0, 0.02  # times noise at rest, and of the frame interval


def odd_frames(
    tracks: list[HitTrack], slides: pd.DataFrame, camera_rate_hz: float
) -> Iterator[QualityWarning]:
    """What is odd in the frames of a recording.

    Args:
        tracks: of its hits, at least one.
        slides: slide_table of them.
        camera_rate_hz: as its header says.
    """
    yield from odd_clock(tracks, camera_rate_hz)
    yield from odd_sampling(tracks, slides, camera_rate_hz)
    yield from gaps(tracks, camera_rate_hz)
    yield from repeated_frames(tracks)
    yield from jumps(tracks)
    yield from odd_noise(tracks)


def odd_clock(tracks: list[HitTrack], camera_rate_hz: float) -> Iterator[QualityWarning]:
    """Times that were counted and not measured, and another rate than the header's."""
    intervals = np.concatenate([np.diff(track.t) for track in tracks])
    if not len(intervals):
        return
    typical = float(np.median(intervals))
    if np.abs(intervals - typical).max() <= _EXACT * typical + 1e-9:
        yield QualityWarning(
            "no_clock",
            f"no clock: all {len(intervals)} intervals are {1000 * typical:.4g} ms to the last digit and no "
            "frame is missing, as if frames were counted",
            (),
            "a wrong rate scales speeds, and friction with its square; late or lost frames look like physics",
        )
    if abs(typical * camera_rate_hz - 1) > _OTHER_RATE:
        yield QualityWarning(
            "frame_rate",
            f"frames are {1000 * typical:.4g} ms apart (median), but {1000 / camera_rate_hz:.4g} ms at the "
            f"header's {camera_rate_hz:g} Hz",
            (),
            "one of them is wrong, and with it speeds and friction, or every other frame is missing",
        )


def odd_sampling(
    tracks: list[HitTrack], slides: pd.DataFrame, camera_rate_hz: float
) -> Iterator[QualityWarning]:
    """Frames that scatter more while the object moves: their times err."""
    if slides.empty:
        return
    jitter, noise = slides["jitter"].median(), slides["rest_noise"].median()
    moving = slides["residual"].median()
    interval = 1 / camera_rate_hz
    if moving > _MANY_JITTER * noise and jitter > _LEAST_JITTER * interval:
        yield QualityWarning(
            "moving_noise",
            f"frames scatter {1000 * moving:.2g} mm about a smooth slide and {1000 * noise:.2g} mm at rest "
            f"(medians over hits), as if their times erred by {1000 * jitter:.2g} ms, "
            f"{jitter / interval:.0%} of the interval{_zigzag(tracks)}",
            (),
            "noise that grows with speed is none of place: weighing all frames alike takes it for physics",
        )


def _zigzag(tracks: list[HitTrack]) -> str:
    """How neighbouring steps of fast frames hang together: a tracker with a clock of its own alternates."""
    pairs = []
    for track in tracks:
        if track.pushes:
            fast = track.speed[1:] > track.speed.max() / 2
            steps = np.linalg.norm(np.diff(track.xy, axis=0), axis=1)
            ratio = steps / np.maximum(track.speed[1:] * np.diff(track.t), 1e-9) - 1
            both = fast[1:] & fast[:-1]
            pairs.append(np.stack([ratio[:-1][both], ratio[1:][both]]))
    joined = np.concatenate(pairs, axis=1) if pairs else np.empty((2, 0))
    if joined.shape[1] < 10 or joined.std(axis=1).min() == 0:
        return ""
    correlation = np.corrcoef(joined)[0, 1]
    if correlation > -_COLOURED:
        return ""
    return f", and long and short steps alternate (correlation {correlation:.2f})"


def gaps(tracks: list[HitTrack], camera_rate_hz: float) -> Iterator[QualityWarning]:
    """Hits that lack many frames, or several in a row."""
    where, missing, longest = [], [], 0.0
    for track in tracks:
        intervals = np.diff(track.t) * camera_rate_hz
        lost = np.where(intervals > _GAP, np.rint(intervals) - 1, 0.0)
        share = lost.sum() / (lost.sum() + len(track.t))
        gap = float(intervals[lost > 0].max(initial=0.0)) / camera_rate_hz
        if share > _MANY_MISSING or gap > max(_LONG_GAP_S, _LONG_GAP / camera_rate_hz):
            where.append(track.hit)
            missing.append(share)
            longest = max(longest, gap)
    if where:
        yield QualityWarning(
            "gaps",
            f"{len(where)} of {len(tracks)} hits have gaps: up to {max(missing):.0%} of a hit's frames are "
            f"missing, up to {longest:.2g} s on end",
            tuple(where),
            "what happens in a gap is not seen, and a peak of speed in one is lost",
        )


def repeated_frames(tracks: list[HitTrack]) -> Iterator[QualityWarning]:
    """Frames that repeat the place before them to the last digit, at rest and in motion."""
    still, frozen, rests, moves = 0, {}, 0, 0
    for track in tracks:
        same = (np.diff(track.xy, axis=0) == 0).all(axis=1)
        moving = track.speed[1:] > 2 * moving_speed(track.speed)
        still, rests = still + int((same & ~moving).sum()), rests + int((~moving).sum())
        moves += int(moving.sum())
        if (same & moving).any():
            frozen[track.hit] = int((same & moving).sum())
    if frozen:
        yield QualityWarning(
            "frozen_frames",
            f"{sum(frozen.values())} of {moves} frames repeat the place before them while the object moves",
            tuple(frozen),
            "the tracker had lost the object or the file repeats rows; taken as seen, they bend the track",
        )
    if rests and still / rests > _MANY_SAME:
        yield QualityWarning(
            "repeated_frames",
            f"{still / rests:.0%} of the frames at rest repeat the place before them to the last digit",
            (),
            "rows are written more often than the tracker sees, or it rounds: noise looks too small",
        )


def jumps(tracks: list[HitTrack]) -> Iterator[QualityWarning]:
    """Single frames that lie elsewhere, and changes of place between two frames."""
    wrong, count, changes = {}, 0, []
    for track in tracks:
        count += len(track.t)
        off = np.linalg.norm(track.xy - smooth(track.xy), axis=1)
        typical = 1.4826 * float(np.median(off))
        # At the ends the running median lags behind an object that moves.
        reach = np.maximum(_LEAST_JUMP_M, track.speed * np.gradient(track.t)) if len(track.t) > 1 else off
        bad = int((off > np.maximum(_JUMP_NOISE * typical, 3 * reach)).sum())
        if bad:
            wrong[track.hit] = bad
        place = smooth(track.xy)
        ends = [
            (place[e.begin], place[min(e.end, len(place) - 1)], e.travel) for e in track.episodes if e.jump
        ]
        if any(np.linalg.norm(b - a) > travel / 2 for a, b, travel in ends):
            changes.append(track.hit)
    if wrong:
        total = sum(wrong.values())
        yield QualityWarning(
            "mistracks",
            f"{total} of {count} frames ({total / count:.2%}) lie elsewhere than their neighbours: mistracks",
            tuple(wrong),
            "a likelihood without heavy tails follows them; 1 % of such frames raise false alarms",
        )
    if changes:
        yield QualityWarning(
            "place_changes",
            f"in {len(changes)} of {len(tracks)} hits the place changes between two frames and stays changed",
            tuple(changes),
            "somebody moved the object, or another one was tracked from there on: it is no slide",
        )


def odd_noise(tracks: list[HitTrack]) -> Iterator[QualityWarning]:
    """Noise at rest that differs between hits, is correlated, or is finer than the numbers."""
    noise = pd.Series({track.hit: rest_noise(track) for track in tracks}, dtype=float).dropna()
    if noise.empty:
        return
    typical = float(noise.median())
    loud = noise[noise > max(_UNEVEN_NOISE * typical, 1e-9)]
    if len(loud):
        yield QualityWarning(
            "uneven_noise",
            f"noise at rest is {1000 * typical:.2g} mm (median, standard deviation along each axis), from "
            f"{1000 * noise.min():.2g} to {1000 * noise.max():.2g} mm, in {len(loud)} of {len(noise)} hits "
            f"more than {_UNEVEN_NOISE:g} times the median",
            tuple(int(hit) for hit in loud.index),
            "drift, flicker or a touch at rest: one noise for all hits trusts these too much",
        )
    correlations = [c for track in tracks if not np.isnan(c := _correlation(track))]
    if correlations and np.median(correlations) > _COLOURED:
        yield QualityWarning(
            "correlated_noise",
            f"noise at rest is correlated from frame to frame ({np.median(correlations):.2f}, median over "
            "hits)",
            (),
            "taken as white it counts each frame as news: 48 % false alarms in a trial, 2 % once whitened",
        )
    step = _step_of_numbers(tracks)
    if step > max(_COARSE * typical, 1e-5):
        yield QualityWarning(
            "coarse_numbers",
            f"places come in steps of {1000 * step:.3g} mm, noise at rest is {1000 * typical:.2g} mm",
            (),
            "rounding is no noise: its error stays the same from frame to frame while the object creeps",
        )


def _correlation(track: HitTrack) -> float:
    """Of neighbouring frames at rest, mean over x and y; NaN where too little or nothing varies."""
    rest = max(track.before, track.after, key=len)
    if len(rest) < 20 or rest.std(axis=0).min() == 0:
        return float("nan")
    centred = rest - rest.mean(axis=0)
    return float(np.mean((centred[1:] * centred[:-1]).mean(axis=0) / (centred**2).mean(axis=0)))


def _step_of_numbers(tracks: list[HitTrack]) -> float:
    """Length in m of which all places are multiples, 0 if there is none that one would notice."""
    x = np.concatenate([track.xy[:, 0] for track in tracks])
    apart = np.diff(np.unique(x))
    apart = apart[apart > 1e-9]
    if len(apart) < 5:
        return 0.0
    step = float(apart.min())
    off = np.abs(apart / step - np.rint(apart / step))
    return step if off.max() < 0.05 else 0.0
