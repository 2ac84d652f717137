"""From a recording and a scene to a verdict."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from slapshot.diagnosis.pucks.diagnose_rests import diagnose_rests
from slapshot.diagnosis.pucks.fit.gauss_newton import Fit
from slapshot.diagnosis.pucks.fit.hit_fit import HitFitter
from slapshot.diagnosis.pucks.headline import distrust, explained, headline_of, names_hold, settled, undecided
from slapshot.diagnosis.pucks.held_out import errors_of_scenes, split_hits
from slapshot.diagnosis.pucks.launch.launch_model import LaunchModel
from slapshot.diagnosis.pucks.launch.rig_model import RigModel
from slapshot.diagnosis.pucks.launch.signatures import Signatures
from slapshot.diagnosis.pucks.launch.swing_error import LATENESS, JointLateness, error_note
from slapshot.diagnosis.pucks.result import Diagnosis, Setting
from slapshot.diagnosis.pucks.selection.free_form import FREE_FORMS, FreeLaunchForm
from slapshot.diagnosis.pucks.selection.judgement import (
    found_effects,
    limits,
    location_of,
    with_outside,
)
from slapshot.diagnosis.pucks.selection.level import Level, examine, refuted_note
from slapshot.diagnosis.pucks.selection.next_hits import next_hits
from slapshot.diagnosis.pucks.selection.search import Search
from slapshot.diagnosis.pucks.selection.trial import dropped_note, that_work
from slapshot.diagnosis.pucks.slide.noise import CameraNoise, estimate_noise, timing_jitter
from slapshot.diagnosis.pucks.slide.slide_model import Point, SlideModel
from slapshot.diagnosis.pucks.slide.suitability import cannot_tell, untold
from slapshot.diagnosis.pucks.slide.tracks import PUSHED_AGAIN, HitTracks, hit_tracks, hits_without_swing
from slapshot.diagnosis.pucks.verdict import Errors
from slapshot.effects.catalogue import catalogue
from slapshot.effects.effect import Effect
from slapshot.recordings.data_quality import quality_warnings
from slapshot.recordings.format import Recording
from slapshot.recordings.quality_warning import QualityWarning

LEAST_NOISE = 1e-5  # m, finer than any camera's
SAME_PLACE = 1e-7  # m, by which places differ that were rounded to the same number and then converted
LARGEST_ERROR = 0.3  # share by which a law may err that is still the right one
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
        seed: of the split into hits to use and to hold out, of draws without a mismatch and of bootstraps.
        effects: the catalogue; None for all effects there are.
        threads: for simulations.
        signatures: of a pool that holds the recording's commands; None has them made.
    """
    known = dict(effects if effects is not None else catalogue())
    full = recording.commands is not None and setting.scene is not None
    if not full:
        # Where nobody knows when an object should move, a clock that is late changes nothing.
        known = {n: e for n, e in known.items() if e.acts_on_slide or (e.acts_on_camera and not e.delays)}
    if recording.tracks is None:
        return diagnose_rests(recording, setting, seed, known, threads, signatures)
    findings = quality_warnings(recording)
    left_out = hits_without_swing(recording) if full else {}
    left_out |= dict.fromkeys(_hits_of(findings, "second_push"), PUSHED_AGAIN)
    tracks = hit_tracks(recording, left_out)
    shown: dict[str, Any] = {"recording": recording, "left_out": tracks.dropped}
    reason = cannot_tell(recording, tracks)
    if reason is not None:
        return Diagnosis(untold(recording, tracks, findings, reason, tracks.notes), **shown)
    known, failed = that_work(known, tracks.start.mean(0), setting.friction, setting.radius)
    # Named in this order whatever the order in which the table lists them.
    split_rng, draw_rng, resample_rng = np.random.default_rng(seed).spawn(3)
    kept, held = split_hits(tracks, split_rng)
    noise = _noise(tracks)
    everything = known | {effect.name: effect for effect in (*FREE_FORMS, JointLateness())}
    fitter, test = (
        HitFitter(SlideModel(tracks.take(rows), everything, setting.radius, setting.camera, threads), noise)
        for rows in (kept, held)
    )
    free = [e.name for e in FREE_FORMS if full or not isinstance(e, FreeLaunchForm)]
    search = Search(fitter, list(known), free, draw_rng)
    rig = None
    if full and setting.scene is not None:
        # A first fit of the slides alone, because a launch hardly depends on friction.
        friction = np.exp(fitter.fit(fitter.start()).point.nuisance)
        rig = RigModel(
            recording, tracks, setting.scene, everything, setting.camera, friction, signatures, threads
        )
        dropped = rig.signatures.dropped
        failed = (*failed, *(dropped_note(name, why) for name, why in dropped.items()))
        simulated = rig.launches(kept)
        fitter.launches = simulated
        test.launches = rig.launches(held, simulated.execution)
        search.catalogue = [n for n in known if n not in dropped]
        latest = rig

        def about(fit: Fit, derivatives: bool) -> HitFitter:
            nonlocal latest
            latest = latest.about(fit.point.effects)
            return fitter.about(latest.launches(kept, simulated.execution, derivatives))

        search.about = about
    level = examine(search)
    used = set(tracks.hit.tolist())
    doubtful = [hit for hit in _hits_of(findings, *NO_CLEAN_SLIDE) if hit in used]
    doubt = distrust(level, tracks.hit[kept], doubtful)
    notes = (*tracks.notes, *failed, *level.notes)
    made = rig.signatures if rig is not None else None
    if doubt is not None:
        verdict = untold(recording, tracks, findings, doubt.reason, notes, doubt.hits)
        return Diagnosis(verdict, signatures=made, **shown)
    test.drop_jumps(_start_of(test, level.nominal.fit))

    def errors(of: Level) -> dict[str, Errors]:
        nominal, final = of.nominal.fit, of.final.fit
        there = test
        if final is not nominal and rig is not None and isinstance(test.launches, LaunchModel):
            about = rig.about(final.point.effects)
            there = test.about(about.launches(held, test.launches.execution, fitted=False))
        return errors_of_scenes(test, there, nominal, final, setting.friction, resample_rng)

    fit = errors(level)
    while level.final.effects and not names_hold(fit):
        notes = (*notes, refuted_note(level))
        level = level.without_weakest_name()
        fit = errors(level)
        doubt = distrust(level, tracks.hit[kept], doubtful)
    named = tuple(sorted(found_effects(search, level.final, level.leftover), key=lambda e: -e.shift_m))
    unknown, mismatch = level.unknown, level.mismatch
    if named and not unknown.flagged and not explained(fit, LARGEST_ERROR):
        unknown = replace(unknown, flagged=True)
    fitted = level.final.fit.point.effects
    if LATENESS in fitted and setting.scene is not None:
        notes = (*notes, error_note(everything, fitted, len(setting.scene.info.joints)))
    headline = headline_of(mismatch.found, bool(named), fit)
    if headline == "nothing_found":
        doubt = undecided(level, tracks.hit[kept], doubtful)
    if doubt is not None:
        verdict = untold(recording, tracks, findings, doubt.reason, notes, doubt.hits)
        return Diagnosis(verdict, signatures=made, **shown)
    mismatch = settled(mismatch, headline)
    location = location_of(mismatch, named, unknown, known)
    named, unknown = with_outside(named, unknown, mismatch.found)
    verdict = replace(
        untold(recording, tracks, findings, None, notes),
        headline=headline,
        mismatch=mismatch,
        location=location,
        effects=named,
        unknown=unknown,
        limits=() if mismatch.found else limits(search, level.nominal),
        noise_sd_m=noise.sd,
        noise_time_s=noise.time,
        noise_jitter_s=noise.jitter,
        friction_scatter=level.final.fit.scatter.friction,
        fit=fit,
        next_hits=next_hits(level, named, setting),
    )
    return Diagnosis(
        verdict,
        search,
        level.nominal,
        level.final,
        level.screen,
        test,
        signatures=made,
    )


def _hits_of(findings: Sequence[QualityWarning], *kinds: str) -> list[int]:
    """Numbers of the hits that findings of some kinds are about."""
    return sorted({hit for finding in findings if finding.kind in kinds for hit in finding.hits})


def _noise(tracks: HitTracks) -> CameraNoise:
    """Of the camera, at rest and while objects move; never less than what rounding of places makes."""
    noise = estimate_noise(*tracks.resting)
    steps = np.diff(np.unique(tracks.places[tracks.valid]))
    rounding = float(steps[steps > SAME_PLACE].min(initial=np.inf)) / np.sqrt(12)
    noise = replace(noise, sd=max(noise.sd, LEAST_NOISE, rounding if np.isfinite(rounding) else 0.0))
    return replace(noise, jitter=timing_jitter(tracks.times, tracks.places, tracks.valid))


def _start_of(fitter: HitFitter, fit: Fit) -> Point:
    """Launches of other hits under a fit's shared parameters."""
    start = fitter.start()
    return Point(start.latents, fit.point.nuisance, fit.point.effects)
