"""From a recording and a scene to a verdict."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from slapshot.diagnosis.pucks.diagnose_rests import diagnose_rests
from slapshot.diagnosis.pucks.free_form import FREE_FORMS, FREE_LAUNCH
from slapshot.diagnosis.pucks.gauss_newton import Fit
from slapshot.diagnosis.pucks.headline import distrust, headline_of, names_hold, settled, undecided
from slapshot.diagnosis.pucks.held_out import FittedScene, errors_of_scenes, split_hits
from slapshot.diagnosis.pucks.judgement import (
    found_effects,
    limits,
    location_of,
    strongest,
)
from slapshot.diagnosis.pucks.launch_fit import launch_fitter
from slapshot.diagnosis.pucks.level import Level, examine, refuted_notes
from slapshot.diagnosis.pucks.next_hits import next_hits
from slapshot.diagnosis.pucks.noise import CameraNoise, estimate_noise, timing_jitter
from slapshot.diagnosis.pucks.result import Diagnosis, Setting
from slapshot.diagnosis.pucks.rig_model import RigModel
from slapshot.diagnosis.pucks.search import Search
from slapshot.diagnosis.pucks.signatures import Signatures
from slapshot.diagnosis.pucks.simulated import LaunchEvidence, launches_about
from slapshot.diagnosis.pucks.slide_fit import SlideFitter
from slapshot.diagnosis.pucks.slide_model import Point, SlideModel
from slapshot.diagnosis.pucks.spin import SimulatedSpin
from slapshot.diagnosis.pucks.suitability import cannot_tell, untold
from slapshot.diagnosis.pucks.tracks import PUSHED_AGAIN, HitTracks, hit_tracks
from slapshot.diagnosis.pucks.trial import dropped_note, that_work
from slapshot.diagnosis.pucks.verdict import Errors
from slapshot.effects.catalogue import catalogue
from slapshot.effects.effect import Effect
from slapshot.recordings.data_quality import quality_warnings
from slapshot.recordings.format import Recording
from slapshot.recordings.quality_warning import QualityWarning

FIRST_S = 0.24  # s of a slide that launches are told from where the law of the slide was mended
# Findings of a check that say of a hit that it is no single push followed by a slide to rest.
NO_CLEAN_SLIDE = ("second_push", "moves_again", "not_slowing", "moving_at_start", "moving_at_end")


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
    if recording.tracks is None:
        return diagnose_rests(recording, setting, seed, known, threads, signatures)
    findings = quality_warnings(recording)
    tracks = hit_tracks(recording, dict.fromkeys(_hits_of(findings, "second_push"), PUSHED_AGAIN))
    shown: dict[str, Any] = {"recording": recording, "left_out": tracks.dropped}
    reason = cannot_tell(recording, tracks)
    if reason is not None:
        return Diagnosis(untold(recording, tracks, findings, reason, tracks.notes), **shown)
    known, failed = that_work(known, tracks.start.mean(0), setting.friction, setting.radius)
    # Named in this order whatever the order in which the table lists them.
    split_rng, flip_rng, resample_rng = np.random.default_rng(seed).spawn(3)
    kept, held = split_hits(tracks, split_rng)
    noise = _noise(tracks)
    everything = known | {effect.name: effect for effect in FREE_FORMS}
    fitter, test = (
        SlideFitter(SlideModel(tracks.take(rows), everything, setting.radius, setting.camera, threads), noise)
        for rows in (kept, held)
    )
    rig = None
    if full and setting.scene is not None:
        # A first fit, because a launch hardly depends on friction.
        friction = np.exp(fitter.fit(fitter.start()).point.nuisance)
        rig = RigModel(
            recording, tracks, setting.scene, everything, setting.camera, friction, signatures, threads
        )
        dropped = rig.signatures.dropped
        known = {n: e for n, e in known.items() if n not in dropped}
        failed = (*failed, *(dropped_note(name, why) for name, why in dropped.items()))
        fitter.spin, test.spin = (SimulatedSpin(rig.launches(rows)) for rows in (kept, held))
    slides = [n for n, e in known.items() if e.acts_on_slide or e.acts_on_camera]
    free = [e.name for e in FREE_FORMS if e.name != FREE_LAUNCH]
    search = Search(fitter, slides, free, flip_rng)
    if rig is not None:
        search.beside = LaunchEvidence(fitter, search.nominal().fit, rig, kept, everything)
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
    used = set(tracks.hit.tolist())
    doubtful = [hit for hit in _hits_of(findings, *NO_CLEAN_SLIDE) if hit in used]
    doubt = distrust(levels, tracks.hit[kept], doubtful)
    notes = (*tracks.notes, *failed, *(note for part in levels for note in part.notes))
    if doubt is not None:
        verdict = untold(recording, tracks, findings, doubt.reason, notes, doubt.hits)
        return Diagnosis(verdict, signatures=rig.signatures if rig is not None else None, **shown)
    nominal = FittedScene(*(part.nominal.fit for part in levels))
    test.drop_jumps(_start_of(test, level.nominal.fit))

    def errors(of: Sequence[Level]) -> dict[str, Errors]:
        named = any(part.final.effects for part in of)
        return errors_of_scenes(
            test,
            nominal,
            FittedScene(*(part.final.fit for part in of)) if named else nominal,
            setting.friction,
            rig.about({n: v for part in of for n, v in part.final.fit.point.effects.items()}).launches(held)
            if rig
            else None,
            resample_rng,
        )

    tried = levels
    # The last level stands on those before it: its names go first.
    for count in range(len(levels), -1, -1):
        levels = [*tried[:count], *(part.without_names() for part in tried[count:])]
        if names_hold(fit := errors(levels)):
            break
    notes = (*notes, *refuted_notes(tried, levels))
    level = levels[0]
    named_by_level = [found_effects(each.search, each.final) for each in levels]
    named = tuple(sorted((e for part in named_by_level for e in part), key=lambda e: -e.shift_m))
    hits = [next_hits(each, part, setting) for each, part in zip(levels, named_by_level, strict=True)]
    unknown = max((part.unknown for part in levels), key=lambda u: (u.flagged, u.log_evidence))
    mismatch = strongest([each.mismatch for each in levels])
    headline = headline_of(mismatch.found, bool(named), fit)
    if headline == "nothing_found":
        doubt = undecided(levels, tracks.hit[kept], doubtful)
        if doubt is not None:
            verdict = untold(recording, tracks, findings, doubt.reason, notes, doubt.hits)
            return Diagnosis(verdict, signatures=rig.signatures if rig is not None else None, **shown)
    mismatch = settled(mismatch, headline)
    verdict = replace(
        untold(recording, tracks, findings, None, notes),
        headline=headline,
        mismatch=mismatch,
        location=location_of(mismatch, named, unknown, known),
        effects=named,
        unknown=unknown,
        limits=() if mismatch.found else limits(search, level.nominal),
        noise_sd_m=noise.sd,
        noise_time_s=noise.time,
        noise_jitter_s=noise.jitter,
        friction_scatter=level.final.fit.scatter,
        fit=fit,
        next_hits=next((some for some in hits if some), ()),
    )
    return Diagnosis(
        verdict,
        search,
        level.nominal,
        level.final,
        level.screen,
        test,
        levels[1] if len(levels) > 1 else None,
        signatures=rig.signatures if rig is not None else None,
    )


def _hits_of(findings: Sequence[QualityWarning], *kinds: str) -> list[int]:
    """Numbers of the hits that findings of some kinds are about."""
    return sorted({hit for finding in findings if finding.kind in kinds for hit in finding.hits})


def _noise(tracks: HitTracks) -> CameraNoise:
    """Of the camera, at rest and while objects move."""
    noise = estimate_noise(*tracks.resting)
    return replace(noise, jitter=timing_jitter(tracks.times, tracks.places, tracks.valid, noise.sd))


def _start_of(fitter: SlideFitter, fit: Fit) -> Point:
    """Launches of other hits under a fit's shared parameters."""
    start = fitter.start()
    return Point(start.latents, fit.point.nuisance, fit.point.effects)
