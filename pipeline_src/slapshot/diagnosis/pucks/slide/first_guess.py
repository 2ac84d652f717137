"""Where a fit of slides begins."""

import numpy as np

from slapshot.arrays import GRAVITY
from slapshot.diagnosis.pucks.slide.slide_model import Point
from slapshot.diagnosis.pucks.slide.tracks import HitTracks

# Prior of the nuisance parameters: any dry surface.
NUISANCE_MEAN = np.log([0.35, 0.35, 0.01])


def first_guess(tracks: HitTracks) -> Point:
    """Launches from the first frames, without spin; friction from how far objects went."""
    count = len(tracks)
    latents = np.zeros((count, 6))
    for i in range(count):
        t, p = tracks.times[i][tracks.valid[i]], tracks.places[i][tracks.valid[i]]
        first = slice(0, max(4, min(7, len(t) // 3)))
        fit = np.polynomial.polynomial.polyfit(t[first], p[first], 1)
        latents[i, :2], latents[i, 2:4] = fit[0], fit[1]
    ends = np.array([p[v][-3:].mean(0) for p, v in zip(tracks.places, tracks.valid, strict=True)])
    distance = np.linalg.norm(ends - latents[:, :2], axis=1)
    mu = (latents[:, 2:4] ** 2).sum(1) / (2 * GRAVITY * np.maximum(distance, 0.02))
    nuisance = np.tile(NUISANCE_MEAN, (len(tracks.objects), 1))
    for k in range(len(tracks.objects)):
        mine = mu[tracks.object == k]
        if len(mine):
            nuisance[k, :2] = np.log(np.clip(np.median(mine), 0.02, 2.0))
    return Point(latents, nuisance)
