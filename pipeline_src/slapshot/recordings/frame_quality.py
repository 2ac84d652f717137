"""Quality warnings about the frames of a recording: clock, gaps, frozen frames, mistracks, noise at rest."""

from collections.abc import Iterator

import numpy as np
import pandas as pd

from slapshot.recordings.motion_detection import moving_speed, smooth
from slapshot.recordings.quality_warning import QualityWarning
from slapshot.recordings.track_features import HitTrack, rest_noise

# Relative deviations from the frame interval: rounding of a text file, and a wrong rate.
_EXACT, _OTHER_RATE = 1e-6, 0.02
_GAP = 1.5  # intervals; a longer one lacks a frame
_MAX_MISSING, _LONG_GAP_S, _LONG_GAP = 0.1, 0.1, 3.5  # share of frames; s and intervals
_MAX_EQUAL = 0.05  # of the frames at rest
_JUMP_NOISE, _MIN_JUMP_M = 8.0, 0.005
_UNEVEN_NOISE = 4.0  # times the median hit's
_COLOURED = 0.5  # correlation of neighbouring frames at rest
_COARSE = 1.0  # step of the numbers over noise at rest
_MAX_JITTER_RATIO, _MIN_JITTER = 3.0, 0.02  # times noise at rest, and of the frame interval


def frame_warnings(
    tracks: list[HitTrack], slides: pd.DataFrame, camera_rate_hz: float
) -> Iterator[QualityWarning]:
    """Quality warnings about the frames of a recording.

    Args:
        tracks: of its hits, at least one.
        slides: slide_table of them.
        camera_rate_hz: as its header says.
    """
    yield from clock_warnings(tracks, camera_rate_hz)
    yield from jitter_warnings(tracks, slides, camera_rate_hz)
    yield from gaps(tracks, camera_rate_hz)
    yield from repeated_frame_warnings(tracks)
    yield from jumps(tracks)
    yield from noise_warnings(tracks)


def clock_warnings(tracks: list[HitTrack], camera_rate_hz: float) -> Iterator[QualityWarning]:
    """Frame times that were counted instead of measured, and a rate that differs from the header's."""
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
            "a wrong rate scales speed linearly and friction quadratically; late or lost frames look like "
            "physics",
        )
    if abs(typical * camera_rate_hz - 1) > _OTHER_RATE:
        yield QualityWarning(
            "frame_rate",
            f"frames are {1000 * typical:.4g} ms apart (median), but {1000 / camera_rate_hz:.4g} ms at the "
            f"header's {camera_rate_hz:g} Hz",
            (),
            "one of them is wrong, and with it speed and friction, or every other frame is missing",
        )


def jitter_warnings(
    tracks: list[HitTrack], slides: pd.DataFrame, camera_rate_hz: float
) -> Iterator[QualityWarning]:
    """Larger scatter of frames while the object moves, which indicates errors of frame times."""
    if slides.empty:
        return
    jitter, noise = slides["jitter"].median(), slides["rest_noise"].median()
    moving = slides["residual"].median()
    interval = 1 / camera_rate_hz
    if moving > _MAX_JITTER_RATIO * noise and jitter > _MIN_JITTER * interval:
        yield QualityWarning(
            "moving_noise",
            f"frames scatter {1000 * moving:.2g} mm about a smooth slide and {1000 * noise:.2g} mm at rest "
            f"(medians over hits), as if their times erred by {1000 * jitter:.2g} ms, "
            f"{jitter / interval:.0%} of the interval{_zigzag(tracks)}",
            (),
            "noise that grows with speed is a timing error: with equal weights it is mistaken for physics",
        )


def _zigzag(tracks: list[HitTrack]) -> str:
    """Correlation of neighbouring steps of fast frames: alternating ones indicate a free-running tracker."""
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
    """Hits with many missing frames, or several consecutive ones."""
    where, missing, longest = [], [], 0.0
    for track in tracks:
        intervals = np.diff(track.t) * camera_rate_hz
        lost = np.where(intervals > _GAP, np.rint(intervals) - 1, 0.0)
        share = lost.sum() / (lost.sum() + len(track.t))
        gap = float(intervals[lost > 0].max(initial=0.0)) / camera_rate_hz
        if share > _MAX_MISSING or gap > max(_LONG_GAP_S, _LONG_GAP / camera_rate_hz):
            where.append(track.hit)
            missing.append(share)
            longest = max(longest, gap)
    if where:
        yield QualityWarning(
            "gaps",
            f"{len(where)} of {len(tracks)} hits have gaps: up to {max(missing):.0%} of a hit's frames are "
            f"missing, up to {longest:.2g} s on end",
            tuple(where),
            "motion within a gap is not observed, and a speed peak in one is lost",
        )


def repeated_frame_warnings(tracks: list[HitTrack]) -> Iterator[QualityWarning]:
    """Frames that repeat the previous position exactly, at rest and in motion."""
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
            f"{sum(frozen.values())} of {moves} frames repeat the previous position while the object moves",
            tuple(frozen),
            "the tracker lost the object or the file repeats rows; if used as measurements, they distort "
            "the track",
        )
    if rests and still / rests > _MAX_EQUAL:
        yield QualityWarning(
            "repeated_frames",
            f"{still / rests:.0%} of the frames at rest repeat the previous position exactly",
            (),
            "rows are written more often than the tracker updates, or it rounds: noise is underestimated",
        )


def jumps(tracks: list[HitTrack]) -> Iterator[QualityWarning]:
    """Outlier frames, and jumps of the position between two frames."""
    wrong, count, changes = {}, 0, []
    for track in tracks:
        count += len(track.t)
        off = np.linalg.norm(track.xy - smooth(track.xy), axis=1)
        typical = 1.4826 * float(np.median(off))
        # At the ends the running median lags behind a moving object.
        reach = np.maximum(_MIN_JUMP_M, track.speed * np.gradient(track.t)) if len(track.t) > 1 else off
        bad = int((off > np.maximum(_JUMP_NOISE * typical, 3 * reach)).sum())
        if bad:
            wrong[track.hit] = bad
        place = smooth(track.xy)
        ends = [
            (place[e.begin], place[min(e.end, len(place) - 1)], e.travel)
            for e in track.motion_intervals
            if e.jump
        ]
        if any(np.linalg.norm(b - a) > travel / 2 for a, b, travel in ends):
            changes.append(track.hit)
    if wrong:
        total = sum(wrong.values())
        yield QualityWarning(
            "mistracks",
            f"{total} of {count} frames ({total / count:.2%}) lie away from their neighbours: mistracks",
            tuple(wrong),
            "a likelihood without heavy tails is biased by them; 1 % of such frames cause false alarms",
        )
    if changes:
        yield QualityWarning(
            "place_changes",
            f"in {len(changes)} of {len(tracks)} hits the position jumps between two frames and stays there",
            tuple(changes),
            "the object was moved by hand, or another one was tracked from there on: this is not a slide",
        )


def noise_warnings(tracks: list[HitTrack]) -> Iterator[QualityWarning]:
    """Noise at rest that differs between hits, is autocorrelated, or is smaller than the resolution."""
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
            "drift, flicker or a touch at rest: with one noise level for all hits these get too much weight",
        )
    correlations = [c for track in tracks if not np.isnan(c := _correlation(track))]
    if correlations and np.median(correlations) > _COLOURED:
        yield QualityWarning(
            "correlated_noise",
            f"noise at rest is correlated from frame to frame ({np.median(correlations):.2f}, median over "
            "hits)",
            (),
            "treated as white noise it caused 48 % false alarms in a test, and 2 % after whitening",
        )
    step = _step_of_numbers(tracks)
    if step > max(_COARSE * typical, 1e-5):
        yield QualityWarning(
            "coarse_numbers",
            f"positions have a resolution of {1000 * step:.3g} mm, noise at rest is {1000 * typical:.2g} mm",
            (),
            "rounding errors are not independent: they stay constant from frame to frame while the object "
            "creeps",
        )


def _correlation(track: HitTrack) -> float:
    """Lag-one autocorrelation at rest, mean over x and y; NaN with too few frames or no variation."""
    rest = max(track.before, track.after, key=len)
    if len(rest) < 20 or rest.std(axis=0).min() == 0:
        return float("nan")
    centred = rest - rest.mean(axis=0)
    return float(np.mean((centred[1:] * centred[:-1]).mean(axis=0) / (centred**2).mean(axis=0)))


def _step_of_numbers(tracks: list[HitTrack]) -> float:
    """Resolution in m of which all positions are multiples; 0 if none is detectable."""
    x = np.concatenate([track.xy[:, 0] for track in tracks])
    apart = np.diff(np.unique(x))
    apart = apart[apart > 1e-9]
    if len(apart) < 5:
        return 0.0
    step = float(apart.min())
    off = np.abs(apart / step - np.rint(apart / step))
    return step if off.max() < 0.05 else 0.0
