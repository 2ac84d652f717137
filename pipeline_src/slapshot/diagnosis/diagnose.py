"""From a recording and a scene to a verdict."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from slapshot.diagnosis.free_form import FREE_FORMS, FREE_LAUNCH
from slapshot.diagnosis.held_out import FittedScene, errors_of_scenes
from slapshot.diagnosis.judgement import (
    found_effects,
    limits,
    location_of,
    strongest,
)
from slapshot.diagnosis.launch_fit import launch_fitter
from slapshot.diagnosis.level import Level, examine
from slapshot.diagnosis.next_hits import next_hits
from slapshot.diagnosis.noise import CameraNoise, estimate_noise, timing_jitter
from slapshot.diagnosis.rig_model import RigModel
from slapshot.diagnosis.search import Candidate, Screen, Search
from slapshot.diagnosis.signatures import Signatures
from slapshot.diagnosis.simulated import LaunchEvidence, launches_about
from slapshot.diagnosis.slide_fit import Fit, SlideFitter
from slapshot.diagnosis.slide_model import Point, SlideModel
from slapshot.diagnosis.spin import SimulatedSpin
from slapshot.diagnosis.suitability import cannot_tell
from slapshot.diagnosis.tracks import HitTracks, hit_tracks
from slapshot.diagnosis.verdict import Verdict
from slapshot.effects.catalogue import catalogue
from slapshot.effects.effect import Effect
from slapshot.recordings.format import Recording
from slapshot.scenes.scene import Scene

Array = NDArray[np.float64]

FIRST_S = 0.24  # s of a slide that launches are told from where the law of the slide was mended
HELD_OUT = 0.25  # share of commands


@dataclass(frozen=True)
class Setting:
    """What a diagnosis knows of the scene.

    Attributes:
        radius: m, of the object as a disc.
        camera: (2,) m, point of the plane that the camera looks at.
        friction: nominal mu_x, mu_y and torsional friction in m.
        scene: to simulate commands with; None to use the slides alone.
    """

    radius: float
    camera: Array
    friction: tuple[float, float, float]
    scene: Scene | None = None


@dataclass(frozen=True)
class Diagnosis:
    """A verdict and what it was read from, for figures.

    Attributes:
        verdict: what was found.
        search: with its fitter (of the hits that were used for it) and all that was refitted; None where
            nothing could be told.
        nominal, final: fits without and with the effects that were found.
        screen: of all hypotheses at the nominal fit.
        held_out: fitter of the held-out hits.
        launches: the same for launches; None where commands are not known.
        signatures: of the commands, given or made; None likewise.
    """

    verdict: Verdict
    search: Search[SlideFitter] | None = None
    nominal: Candidate | None = None
    final: Candidate | None = None
    screen: Screen | None = None
    held_out: SlideFitter | None = None
    launches: "Level | None" = None
    signatures: Signatures | None = None

    def values(self) -> dict[str, dict[str, float]]:
        """Effect -> parameter -> value of all effects that were found."""
        fits = [] if self.final is None else [self.final.fit]
        fits += [] if self.launches is None else [self.launches.final.fit]
        return {name: dict(own) for fit in fits for name, own in fit.point.effects.items()}


def diagnose(
    recording: Recording,
    setting: Setting,
    seed: int = 0,
    effects: Mapping[str, Effect] | None = None,
    threads: int = 1,
    signatures: Signatures | None = None,
) -> Diagnosis:
    """Diagnose a recording: its slides, and where commands are known how objects were launched.

    Args:
        recording: with tracks.
        setting: of the nominal scene.
        seed: of the split into hits to use and to hold out, of sign flips and of bootstraps.
        effects: the catalogue; None for all effects there are.
        threads: for simulations.
        signatures: of a pool that holds the recording's commands; None has them made.
    """
    known = dict(effects if effects is not None else catalogue())
    full = recording.commands is not None and setting.scene is not None
    if not full:
        known = {name: e for name, e in known.items() if e.acts_on_slide or e.acts_on_camera}
    tracks = hit_tracks(recording) if recording.tracks is not None else None
    reason = cannot_tell(recording, tracks)
    if reason is not None or tracks is None:
        used = 0 if tracks is None else len(tracks)
        return Diagnosis(
            Verdict(
                recording.rig, recording.kind, recording.stand_in, len(recording.hits), used, reason,
                notes=_notes(tracks),
            )
        )  # fmt: skip
    # Named in this order whatever the order in which the table lists them.
    split_rng, flip_rng, resample_rng = np.random.default_rng(seed).spawn(3)
    kept, held = _split(tracks, split_rng)
    noise = _noise(tracks)
    everything = known | {effect.name: effect for effect in FREE_FORMS}
    fitter, test = (
        SlideFitter(SlideModel(tracks.take(rows), everything, setting.radius, setting.camera, threads), noise)
        for rows in (kept, held)
    )
    slides = [n for n, e in known.items() if e.acts_on_slide or e.acts_on_camera]
    free = [e.name for e in FREE_FORMS]
    search = Search(fitter, slides, [n for n in free if n != FREE_LAUNCH], flip_rng)
    rig = None
    if full and setting.scene is not None:
        # A first fit, because a launch hardly depends on friction.
        friction = np.exp(fitter.fit(fitter.start()).point.nuisance)
        rig = RigModel(
            recording, tracks, setting.scene, everything, setting.camera, friction, signatures, threads
        )
        fitter.spin, test.spin = (SimulatedSpin(rig.launches(rows)) for rows in (kept, held))
        believed = search.nominal().fit
        search.beside = LaunchEvidence(fitter, believed, rig, kept, everything)
    levels = [level := examine(search)]
    if rig is not None:
        known_by_slides = level.final.fit.point.effects
        first_s = FIRST_S if known_by_slides else np.inf
        launches = launch_fitter(
            fitter,
            level.final.fit,
            rig.about(known_by_slides).launches(kept).given(known_by_slides, level.final.fit.point.nuisance),
            everything,
            first_s,
        )
        candidates = [
            n for n, e in known.items() if (e.acts_on_launch or e.acts_on_camera) and n not in known_by_slides
        ]
        about = launches_about(fitter, level.final.fit, rig, kept, launches, first_s, everything)
        levels.append(examine(Search(launches, candidates, [FREE_LAUNCH], flip_rng, about=about), level))
    found = {n: v for part in levels for n, v in part.final.fit.point.effects.items()}
    named = tuple(e for each in levels for e in found_effects(each.search, each.final))
    unknown = max((part.unknown for part in levels), key=lambda u: (u.flagged, u.log_evidence))
    mismatch = strongest([each.mismatch for each in levels])
    rivals = list(named[0].members)[:2] if named else []
    nominal = FittedScene(*(part.nominal.fit for part in levels))
    test.drop_jumps(_start_of(test, level.nominal.fit))
    verdict = Verdict(
        rig=recording.rig,
        kind=recording.kind,
        stand_in=recording.stand_in,
        hits=len(recording.hits),
        used=len(tracks),
        cannot_tell=None,
        mismatch=mismatch,
        location=location_of(named, unknown),
        effects=tuple(sorted(named, key=lambda e: -e.shift_m)),
        unknown=unknown,
        limits=() if mismatch.found else limits(search, level.nominal),
        noise_sd_m=noise.sd,
        noise_time_s=noise.time,
        friction_scatter=level.final.fit.scatter,
        fit=errors_of_scenes(
            test,
            nominal,
            FittedScene(*(part.final.fit for part in levels)) if named else nominal,
            setting.friction,
            rig.about(found).launches(held) if rig else None,
            resample_rng,
        ),
        next_hits=next_hits(search, level.final, rivals, setting, noise),
        notes=_notes(tracks),
    )
    return Diagnosis(
        verdict,
        search,
        level.nominal,
        level.final,
        level.screen,
        test,
        levels[1] if len(levels) > 1 else None,
        rig.signatures if rig is not None else None,
    )


def _noise(tracks: HitTracks) -> CameraNoise:
    """Of the camera, at rest and while objects move."""
    noise = estimate_noise(*tracks.resting)
    return replace(noise, jitter=timing_jitter(tracks.times, tracks.places, tracks.valid, noise.sd))


def _split(tracks: HitTracks, rng: np.random.Generator) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Rows to use and to hold out; repeats of one command are on one side."""
    commands = np.unique(tracks.command)
    held = rng.permutation(commands)[: max(2, round(HELD_OUT * len(commands)))]
    mask = np.isin(tracks.command, held)
    return np.flatnonzero(~mask), np.flatnonzero(mask)


def _start_of(fitter: SlideFitter, fit: Fit) -> Point:
    """Launches of other hits under a fit's shared parameters."""
    start = fitter.start()
    return Point(start.latents, fit.point.nuisance, fit.point.effects)


def _notes(tracks: HitTracks | None) -> tuple[str, ...]:
    """Hits that were not used, by reason."""
    if tracks is None:
        return ()
    reasons: dict[str, list[int]] = {}
    for hit, why in tracks.dropped.items():
        reasons.setdefault(why, []).append(hit)
    return tuple(f"{len(hits)} hits were left out because {why}" for why, hits in sorted(reasons.items()))
