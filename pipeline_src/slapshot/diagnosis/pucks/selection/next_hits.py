"""Which hits would tell the rivals apart that are left: by the expected log Bayes factor of one hit."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from slapshot.arrays import Array
from slapshot.diagnosis.pucks.fit.gauss_newton import Fit
from slapshot.diagnosis.pucks.fit.hit_fit import HitFitter, Scatter
from slapshot.diagnosis.pucks.launch.launch_model import LaunchModel
from slapshot.diagnosis.pucks.launch.launch_prior import SPIN
from slapshot.diagnosis.pucks.result import Setting
from slapshot.diagnosis.pucks.selection.level import Level
from slapshot.diagnosis.pucks.selection.search import Candidate
from slapshot.diagnosis.pucks.slide.slide_model import Point, SlideModel
from slapshot.diagnosis.pucks.slide.tracks import HitTracks
from slapshot.diagnosis.pucks.verdict import NamedEffect, NextHit

HEADINGS = np.radians(np.arange(-90, 91, 15))
SPEEDS = np.array([0.6, 1.2, 1.8, 2.4, 3.0])  # m/s
SPINS = (0.0, 6.0)  # rad/s; an oblique hit gives some
FRAMES_S = 3.0  # s of frames
PERIOD_S = 0.02
BEST = 5


@dataclass(frozen=True)
class _Trials:
    """Hits that could be made: launches (m, 6), see LATENTS, and numbers of recorded hits (m,) like them."""

    launches: Array
    like: Sequence[int | None]


def next_hits(level: Level, named: Sequence[NamedEffect], setting: Setting) -> tuple[NextHit, ...]:
    """The best hits to record next for the first effect that has rivals; none where none has.

    Args:
        level: of the hits.
        named: effects of that level.
        setting: of the scene.
    """
    unsure = next((effect for effect in named if len(effect.members) > 1), None)
    if unsure is None:
        return ()
    rivals = tuple(unsure.members)[:2]
    # What was named need not be among the two that are most likely.
    rest = {effect.name for effect in named} - {unsure.name}
    pair = [level.search.seen.get(tuple(sorted((*rest, name)))) for name in rivals]
    if pair[0] is None or pair[1] is None:
        return ()
    fitter, scatter = level.final.fitter, level.final.fit.scatter
    if isinstance(fitter.launches, LaunchModel):
        trials, nats = _recorded(fitter, (pair[0], pair[1]), scatter)
    else:
        trials = _recorded_slides(fitter, level.final.fit) if setting.scene is not None else _grid(fitter)
        nats = _parted(fitter, trials.launches, (pair[0], pair[1]), scatter, setting)
    return _best(trials, nats, (rivals[0], rivals[1]))


def _best(trials: _Trials, nats: Array, rivals: tuple[str, str]) -> tuple[NextHit, ...]:
    """Those that part rivals best and are unlike each other."""
    found: list[NextHit] = []
    for i in np.argsort(-nats):
        vx, vy = trials.launches[i, 2:4]
        heading, speed = float(np.arctan2(vy, vx)), float(np.hypot(vx, vy))
        same = [h for h in found if abs(h.heading_rad - heading) < 0.2 and abs(h.speed_m_s - speed) < 0.5]
        if not same:
            found.append(NextHit(heading, speed, rivals, float(nats[i]), trials.like[i]))
        if len(found) == BEST:
            break
    return tuple(found)


def _parted(
    fitter: HitFitter,
    launches: Array,
    pair: tuple[Candidate, Candidate],
    scatter: Scatter,
    setting: Setting,
) -> Array:
    """(m,) nats by which the track of a launch under the first rival speaks against the second."""
    tracks = _tracks_of(fitter.model.tracks, launches)
    model = SlideModel(tracks, fitter.effects, setting.radius, setting.camera)
    trial = HitFitter(model, fitter.noise)
    nuisance = [candidate.fit.point.nuisance[:1] for candidate in pair]
    first = model.predict(Point(launches, nuisance[0], pair[0].fit.point.effects))
    trial.model.tracks = replace(tracks, places=first)
    # The second rival may explain a track with another launch.
    second = Point(launches, nuisance[1], pair[1].fit.point.effects)
    return trial.evaluate(second, [], scatter).squares / 2


def _recorded(
    fitter: HitFitter, pair: tuple[Candidate, Candidate], scatter: Scatter
) -> tuple[_Trials, Array]:
    """One hit of every command that was recorded, and nats (m,) by which it would part the rivals."""
    first, second = (candidate.fit.point for candidate in pair)
    begins = [
        np.column_stack([candidate.fitter.launches.means(point), np.zeros(len(point.latents))])
        for candidate, point in zip(pair, (first, second), strict=True)
    ]
    trial = pair[1].fitter.about(pair[1].fitter.launches.without_encoders())
    trial.model = fitter.model.of(
        replace(
            fitter.model.tracks,
            places=fitter.model.predict(replace(first, latents=begins[0])),
            spin=begins[0][:, SPIN],
        )
    )
    nats = trial.evaluate(replace(second, latents=begins[1]), [], scatter).squares / 2
    _, rows = np.unique(fitter.model.tracks.command, return_index=True)
    return _Trials(begins[0][rows], fitter.model.tracks.hit[rows].tolist()), nats[rows]


def _recorded_slides(fitter: HitFitter, fit: Fit) -> _Trials:
    """The same where launches are not simulated."""
    tracks = fitter.model.tracks
    _, first = np.unique(tracks.command, return_index=True)
    launches = fit.point.latents[first].copy()
    launches[:, 5] = 0.0
    return _Trials(launches, tracks.hit[first].tolist())


def _grid(fitter: HitFitter) -> _Trials:
    """Hits of all headings, speeds and spins from the usual start."""
    grid = np.array([(h, v, w) for h in HEADINGS for v in SPEEDS for w in SPINS])
    launches = np.zeros((len(grid), 6))
    launches[:, :2] = np.median(fitter.model.tracks.start, axis=0)
    launches[:, 2], launches[:, 3] = grid[:, 1] * np.cos(grid[:, 0]), grid[:, 1] * np.sin(grid[:, 0])
    launches[:, 4] = grid[:, 2]
    return _Trials(launches, [None] * len(grid))


def _tracks_of(recorded: HitTracks, launches: Array) -> HitTracks:
    """Empty tracks for launches (m, 6) of the first object."""
    count, frames = len(launches), round(FRAMES_S / PERIOD_S)
    zero = np.zeros(count)
    return HitTracks(
        hit=np.arange(count),
        object=np.zeros(count, np.int64),
        objects=recorded.objects[:1],
        order=zero,
        command=np.arange(count),
        start=launches[:, :2],
        seen_start=launches[:, :2],
        release=zero,
        times=np.tile(np.arange(frames) * PERIOD_S, (count, 1)),
        places=np.zeros((count, frames, 2)),
        valid=np.ones((count, frames), bool),
        turned=zero,
        turn_seen=np.zeros(count, bool),
        spin=zero,
        spin_sd=np.full(count, np.inf),
        resting=recorded.resting,
        dropped={},
    )
