"""Split a recording into what models are fitted to, and what is held out and predicted, in windows."""

import numpy as np
from numpy.typing import NDArray

from slapshot.diagnosis.held_out import WINDOW_S
from slapshot.diagnosis.model.rig import Rig
from slapshot.diagnosis.model.segments import Segments, segment_recording
from slapshot.errors import InputError
from slapshot.recordings.signals import SignalRecording

HELD_OUT = 5  # every fifth episode or block
_MIN_SEGMENTS = 5
_MIN_COVERAGE = 0.75  # share of two windows that must have been recorded


def split(segments: Segments) -> tuple[Segments, NDArray[np.intp]]:
    """Split segments into those for fitting and those held out.

    Returns:
        The segments, and indices of those that are held out.
    """
    episodes = len(np.unique(segments.episode))
    S = segments.shape[0]
    if episodes >= HELD_OUT:
        out = segments.episode % HELD_OUT == HELD_OUT // 2
    else:
        out = np.arange(S) % (2 * HELD_OUT) // 2 == HELD_OUT // 2  # two segments side by side
    if S < _MIN_SEGMENTS or not out.any():
        raise InputError(
            f"only {S} segments of {segments.interval * segments.shape[1]:.2g} s were recorded, of which "
            "some must be held out; record longer"
        )
    return segments.select(~out), np.flatnonzero(out)


def thinned(segments: Segments, most: int) -> Segments:
    """At most so many of the segments: neighbours in pairs, spread over the recording."""
    order = np.concatenate(segments.runs())
    pairs = np.array_split(order, -(-len(order) // 2))
    some = np.linspace(0, len(pairs) - 1, max(1, min(len(pairs), most // 2))).round().astype(int)
    return segments.select(np.sort(np.concatenate([pairs[k] for k in some])))


def held_out_windows(
    recording: SignalRecording, rig: Rig, segments: Segments, held: NDArray[np.intp]
) -> Segments:
    """Held-out data as pairs of windows, the second of which is predicted.

    Of episodes that are shorter than two windows, windows are half as long as the episodes.
    """
    own = segments.select(held)
    runs = [
        (int(own.episode[run[0]]), int(own.first[run[0]]), int(own.inside[run].sum())) for run in own.runs()
    ]
    longest = max(1, round(WINDOW_S / segments.interval))
    half = max(2, min(longest, int(np.median([nodes for *_, nodes in runs])) // 2))
    pairs = segment_recording(recording, rig, nodes=2 * half, parts=runs)
    seen = np.isfinite(pairs.y)
    both = seen[:, :half].any(axis=(1, 2)) & seen[:, half:].any(axis=(1, 2))
    return pairs.select(both & (pairs.inside.mean(axis=1) > _MIN_COVERAGE))
