"""Whether a recording can carry a diagnosis at all, and if not, what to record instead."""

import numpy as np
from slapshot.diagnosis.tracks import RELEASE_DISTANCE, HitTracks
from slapshot.recordings.format import Recording

FEWEST_HITS = 12  # of which three are held out
LEAST_HEADINGS_RAD = 0.03  # rms spread of launches
LEAST_SPEEDS = 0.05  # rms spread of their logarithm
LEAST_FRAMES = 12  # of a slide in the median: fewer cannot tell its launch from what slows it


def cannot_tell(recording: Recording, tracks: HitTracks | None) -> str | None:
    """Reason and remedy in one sentence, None if there is none."""
    if tracks is None:
        return (
            "the recording has rest points only: what slowed an object cannot be told from how it was hit; "
            "record tracks (camera frames of the sliding object)"
        )
    if len(tracks) == 0 and tracks.dropped:
        return (
            f"no hit moved its object by {100 * RELEASE_DISTANCE:.0f} cm and came to rest in view; "
            "hit harder, or let the camera run until the object rests"
        )
    if len(tracks) < FEWEST_HITS:
        return (
            f"only {len(tracks)} hits can be used; record at least {FEWEST_HITS}, better 100, with "
            "headings and speeds as different as the rig allows"
        )
    frames = float(np.median(tracks.valid.sum(1)))
    if frames < LEAST_FRAMES:
        return (
            f"a slide has {frames:.0f} frames (median) at {recording.camera_rate_hz:g} Hz; record at "
            f"{recording.camera_rate_hz * 2 * LEAST_FRAMES / frames:.0f} Hz or more, or hit harder"
        )
    headings, speeds = _spread(tracks)
    if headings < LEAST_HEADINGS_RAD and speeds < LEAST_SPEEDS:
        return (
            "all hits are alike (headings within "
            f"{np.degrees(headings):.1f} degrees, speeds within {100 * speeds:.0f} %): one path cannot "
            "tell friction, slope and drag apart; vary headings and speeds"
        )
    return None


def _spread(tracks: HitTracks) -> tuple[float, float]:
    """Rms spread of headings in rad and of log speeds over the first frames."""
    fifth = min(5, tracks.times.shape[1] - 1)
    moved = tracks.places[:, fifth] - tracks.places[:, 0]
    heading = np.arctan2(moved[:, 1], moved[:, 0])
    mean = np.arctan2(np.sin(heading).mean(), np.cos(heading).mean())
    turned = np.angle(np.exp(1j * (heading - mean)))
    speed = np.linalg.norm(moved, axis=1) / np.maximum(tracks.times[:, fifth], 1e-6)
    log_speed = np.log(np.maximum(speed, 1e-6))
    robust = 1.4826 * np.median(np.abs(log_speed - np.median(log_speed)))
    return float(np.sqrt((turned**2).mean())), float(robust)
