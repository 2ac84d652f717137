"""Whether a recording can carry a diagnosis at all, and if not, what to record instead."""

from collections import Counter
from collections.abc import Sequence

import numpy as np

from slapshot.diagnosis.pucks.slide.release_detection import (
    NEVER_RESTED,
    TOO_FEW_FRAMES,
    TOO_SHORT_A_SLIDE,
    TOO_SHORT_A_WAY,
)
from slapshot.diagnosis.pucks.slide.tracks import (
    FEW_READINGS,
    NO_COMMAND,
    NO_FRAMES,
    NO_READINGS,
    NO_REST_POINT,
    ONE_COMMAND,
    PUSHED_AGAIN,
    HitTracks,
)
from slapshot.diagnosis.pucks.verdict import Verdict
from slapshot.recordings.format import Recording
from slapshot.recordings.quality_warning import QualityWarning

FEWEST_HITS = 12  # of which three are held out
LEAST_HEADINGS_RAD = 0.03  # rms spread of launches
LEAST_SPEEDS = 0.05  # spread of the logarithm of speeds, half that of distances
FEWEST_AT_REST = 20  # frames of all hits together, from which the camera's noise is told to 16 %
LEAST_FRAMES = 12  # of a slide in the median: fewer cannot tell its launch from what slows it

REMEDIES = {
    NO_FRAMES: "record tracks of all hits",
    NO_REST_POINT: "record where every object comes to rest",
    NO_COMMAND: "record the command of every hit",
    NO_READINGS: "record the joints of every hit, or of none",
    ONE_COMMAND: "record the command of every hit over its whole time",
    FEW_READINGS: "record the joints of every hit over the whole swing, or of none",
    TOO_FEW_FRAMES: "record more frames a second, or hit harder",
    TOO_SHORT_A_WAY: "hit harder",
    TOO_SHORT_A_SLIDE: "record more frames a second (Hz), or hit harder",
    NEVER_RESTED: "let the camera run until the object rests",
    PUSHED_AGAIN: "record hits of one push each, and let the striker stop or retreat after it",
}


def cannot_tell(recording: Recording, tracks: HitTracks) -> str | None:
    """Reason and remedy in one sentence, None if there is none; of tracks, or of rest points as tracks."""
    if len(tracks) < FEWEST_HITS and len(recording.hits) >= FEWEST_HITS:
        why, count = Counter(tracks.dropped.values()).most_common(1)[0]
        few = f"only {len(tracks)} of {len(recording.hits)} hits can be used"
        return f"{few}: of {count}, {why}; {REMEDIES[why]}"
    if len(tracks) < FEWEST_HITS:
        return (
            f"only {len(tracks)} hits can be used; record at least {FEWEST_HITS}, better 100, with "
            "headings and speeds as different as the rig allows"
        )
    frames = float(np.median(tracks.valid.sum(1)))
    if recording.tracks is not None and frames < LEAST_FRAMES:
        return (
            f"a slide has {frames:.0f} frames (median) at {recording.camera_rate_hz:g} Hz; record at "
            f"{recording.camera_rate_hz * 2 * LEAST_FRAMES / frames:.0f} Hz or more, or hit harder"
        )
    if recording.tracks is not None and len(tracks.resting[0]) < FEWEST_AT_REST:
        return (
            f"only {len(tracks.resting[0])} frames show an object at rest, from which the camera's noise is "
            "told; let the camera run before the hit or after the object has stopped"
        )
    headings, speeds = _spread(tracks)
    if headings < LEAST_HEADINGS_RAD and speeds < LEAST_SPEEDS:
        return (
            "all hits are alike (headings within "
            f"{np.degrees(headings):.1f} degrees, speeds within {100 * speeds:.0f} %): one path cannot "
            "tell friction, slope and drag apart; vary headings and speeds"
        )
    return None


def untold(
    recording: Recording,
    tracks: HitTracks,
    findings: Sequence[QualityWarning],
    reason: str | None,
    notes: Sequence[str],
    to_blame: Sequence[int] = (),
) -> Verdict:
    """The verdict that says of what recording it is, and why nothing can be told from it.

    Args:
        recording: that was diagnosed.
        tracks: of the hits that can be used.
        findings: of a check of the recording.
        reason: with what to record instead; None for a verdict that is to be completed.
        notes: what else one should know, a line each.
        to_blame: numbers of hits because of which it cannot be told.
    """
    return Verdict(
        "cannot_tell",
        recording.rig,
        recording.kind,
        recording.stand_in,
        len(recording.hits),
        len(tracks),
        reason,
        hits_to_blame=tuple(to_blame),
        findings=tuple(map(str, findings)),
        notes=tuple(notes),
    )


def _spread(tracks: HitTracks) -> tuple[float, float]:
    """Root mean square spread of headings in rad, and spread of log speeds, by where slides end."""
    last = tracks.valid.sum(1) - 1
    begin = tracks.places[:, 0] if tracks.places.shape[1] > 1 else tracks.start
    moved = tracks.places[np.arange(len(last)), last] - begin
    heading = np.arctan2(moved[:, 1], moved[:, 0])
    mean = np.arctan2(np.sin(heading).mean(), np.cos(heading).mean())
    turned = np.angle(np.exp(1j * (heading - mean)))
    log_speed = np.log(np.linalg.norm(moved, axis=1)) / 2
    robust = 1.4826 * np.median(np.abs(log_speed - np.median(log_speed)))
    return float(np.sqrt((turned**2).mean())), float(robust)
