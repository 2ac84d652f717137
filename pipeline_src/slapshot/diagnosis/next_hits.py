"""Which hits would tell the rivals apart that are left: by the expected log Bayes factor of one hit."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slapshot.diagnosis.noise import CameraNoise
from slapshot.diagnosis.search import Candidate, Search
from slapshot.diagnosis.slide_fit import SlideFitter
from slapshot.diagnosis.slide_model import Point, SlideModel
from slapshot.diagnosis.tracks import HitTracks
from slapshot.diagnosis.verdict import NextHit

Array = NDArray[np.float64]

HEADINGS = np.radians(np.arange(-90, 91, 15))
SPEEDS = np.array([0.6, 1.2, 1.8, 2.4, 3.0])  # m/s
SPINS = (0.0, 6.0)  # rad/s; an oblique hit gives some
FRAMES_S = 3.0  # s of frames
PERIOD_S = 0.02
BEST = 5


def next_hits(
    search: Search[SlideFitter], final: Candidate, rivals: Sequence[str], setting: Any, noise: CameraNoise
) -> tuple[NextHit, ...]:
    """The best hits to record next for the first two rivals; none where there are no rivals."""
    if len(rivals) < 2:
        return ()
    rest = tuple(n for n in final.effects if n not in rivals)
    pair = [search.seen.get(tuple(sorted((*rest, name)))) for name in rivals[:2]]
    if pair[0] is None or pair[1] is None:
        return ()
    tracks, launches = _trials(search.fitter.model.tracks)
    model = SlideModel(tracks, search.fitter.model.effects, setting.radius, setting.camera)
    fitter = SlideFitter(model, noise)
    nuisance = [c.fit.point.nuisance[:1] for c in pair if c is not None]
    first = model.predict(Point(launches, nuisance[0], pair[0].fit.point.effects))
    second = Point(launches, nuisance[1], pair[1].fit.point.effects)
    tracks = HitTracks(**{**vars(tracks), "places": first})
    fitter.model.tracks = tracks
    # The second rival may explain a track with another launch.
    marginal = fitter.evaluate(second, [], final.fit.scatter)
    nats = marginal.squares / 2
    order = np.argsort(-nats)
    found: list[NextHit] = []
    for i in order:
        heading, speed = np.arctan2(launches[i, 3], launches[i, 2]), np.hypot(*launches[i, 2:4])
        same = [h for h in found if abs(h.heading_rad - heading) < 0.2 and abs(h.speed_m_s - speed) < 0.5]
        if not same:
            found.append(NextHit(float(heading), float(speed), (rivals[0], rivals[1]), float(nats[i])))
        if len(found) == BEST:
            break
    return tuple(found)


def _trials(recorded: HitTracks) -> tuple[HitTracks, Array]:
    """Hits of all headings, speeds and spins from the usual start."""
    grid = np.array([(h, v, w) for h in HEADINGS for v in SPEEDS for w in SPINS])
    count, frames = len(grid), round(FRAMES_S / PERIOD_S)
    start = np.median(recorded.start, axis=0)
    zero = np.zeros(count)
    launches = np.column_stack(
        [
            np.tile(start, (count, 1)),
            grid[:, 1] * np.cos(grid[:, 0]),
            grid[:, 1] * np.sin(grid[:, 0]),
            grid[:, 2],
            zero,
        ]
    )
    tracks = HitTracks(
        hit=np.arange(count),
        object=np.zeros(count, np.int64),
        objects=recorded.objects[:1],
        order=zero,
        command=np.arange(count),
        start=np.tile(start, (count, 1)),
        seen_start=np.tile(start, (count, 1)),
        release=zero,
        times=np.tile(np.arange(frames) * PERIOD_S, (count, 1)),
        places=np.zeros((count, frames, 2)),
        valid=np.ones((count, frames), bool),
        resting=recorded.resting,
        dropped={},
    )
    return tracks, launches
