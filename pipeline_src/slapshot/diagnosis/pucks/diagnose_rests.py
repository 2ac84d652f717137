"""From rest points and commands to a verdict: whether something is missing, and of which class it is.

Rest points hide most of what tracks show, so that a name would be a guess: all effects that explain them
about as well are named together.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from slapshot.arrays import Array
from slapshot.diagnosis.pucks.fit.gauss_newton import Fit
from slapshot.diagnosis.pucks.fit.rest_fit import RestFitter
from slapshot.diagnosis.pucks.headline import distrust, headline_of, names_hold, settled, undecided
from slapshot.diagnosis.pucks.held_out import SURE, mean, root_mean, split_hits
from slapshot.diagnosis.pucks.launch.rig_model import RigModel
from slapshot.diagnosis.pucks.launch.signatures import Signatures
from slapshot.diagnosis.pucks.result import Diagnosis, Setting
from slapshot.diagnosis.pucks.selection.free_form import FREE_FORMS, FREE_LAUNCH
from slapshot.diagnosis.pucks.selection.judgement import found_effects, limits, location_of, with_outside
from slapshot.diagnosis.pucks.selection.level import Level, examine, refuted_note
from slapshot.diagnosis.pucks.selection.search import CLASS, Search
from slapshot.diagnosis.pucks.selection.trial import dropped_note, that_work
from slapshot.diagnosis.pucks.slide.slide_model import Point, SlideModel
from slapshot.diagnosis.pucks.slide.suitability import cannot_tell, untold
from slapshot.diagnosis.pucks.slide.tracks import hits_without_swing, rest_tracks
from slapshot.diagnosis.pucks.verdict import Errors, Interval, NamedEffect
from slapshot.effects.effect import Effect
from slapshot.recordings.data_quality import quality_warnings
from slapshot.recordings.format import Recording

REFITTED = 8  # hypotheses, of those that a screen finds best


def diagnose_rests(
    recording: Recording,
    setting: Setting,
    seed: int,
    known: Mapping[str, Effect],
    threads: int,
    signatures: Signatures | None,
) -> Diagnosis:
    """Diagnose a recording without tracks; arguments as those of `diagnose`."""
    tracks = rest_tracks(recording, hits_without_swing(recording))
    reason = cannot_tell(recording, tracks)
    if reason is None and (recording.commands is None or setting.scene is None):
        reason = (
            "the recording has rest points only, and nothing says how objects were hit: record tracks "
            "(camera frames of the sliding object), or the commands and the arm in the scene"
        )
    findings = quality_warnings(recording)
    if reason is not None or setting.scene is None:
        return Diagnosis(untold(recording, tracks, findings, reason, tracks.notes))
    known, failed = that_work(known, tracks.start.mean(0), setting.friction, setting.radius)
    split_rng, draw_rng, resample_rng = np.random.default_rng(seed).spawn(3)
    kept, held = split_hits(tracks, split_rng)
    effects = {**known, **{e.name: e for e in FREE_FORMS if e.name == FREE_LAUNCH}}
    friction = np.tile(setting.friction, (len(tracks.objects), 1))
    rig = RigModel(recording, tracks, setting.scene, effects, setting.camera, friction, signatures, threads)
    dropped = rig.signatures.dropped
    known = {n: e for n, e in known.items() if n not in dropped}
    fitter, test = (
        RestFitter(
            SlideModel(tracks.take(rows), effects, setting.radius, setting.camera, threads),
            rig.launches(rows),
            effects,
            np.array(setting.friction),
        )
        for rows in (kept, held)
    )
    # Where a clock is late, nobody sees it at rest.
    candidates = [n for n, e in known.items() if not (e.phase == "camera" and e.follows == "time")]
    search = Search(fitter, candidates, [FREE_LAUNCH], draw_rng, refitted=REFITTED, most=1)
    level = examine(search)
    doubt = distrust(level, tracks.hit[kept], ())
    if doubt is not None:
        verdict = untold(
            recording, tracks, findings, doubt.reason, (*tracks.notes, *failed, *level.notes), doubt.hits
        )
        return Diagnosis(verdict, signatures=rig.signatures)
    tried, fit = level, _errors(test, level, setting, resample_rng)
    if level.final.effects and not names_hold(fit):
        level = level.without_names()
        fit = _errors(test, level, setting, resample_rng)
        doubt = distrust(level, tracks.hit[kept], ())
    named = tuple(_of_class(level, effect) for effect in found_effects(search, level.final, level.leftover))
    headline = headline_of(level.mismatch.found, bool(named), fit)
    if headline == "nothing_found":
        doubt = undecided(level, tracks.hit[kept], ())
    if doubt is not None:
        verdict = untold(recording, tracks, findings, doubt.reason, (*tracks.notes, *failed), doubt.hits)
        return Diagnosis(verdict, signatures=rig.signatures)
    mismatch = settled(level.mismatch, headline)
    share = np.sqrt(np.diag(level.final.fit.scatter))
    notes = (
        f"rest points scatter about those of their commands by {100 * share[0]:.0f} % of the distance along "
        f"the way and {100 * share[1]:.0f} % across it; tracks (camera frames of the sliding object) would "
        "tell far more",
        *tracks.notes,
        *failed,
        *(dropped_note(name, why) for name, why in dropped.items()),
        *level.notes,
        *((refuted_note(tried),) if level is not tried else ()),
    )
    location = location_of(mismatch, named, level.unknown, known)
    named, unknown = with_outside(named, level.unknown, mismatch.found)
    verdict = replace(
        untold(recording, tracks, findings, None, notes),
        headline=headline,
        mismatch=mismatch,
        location=location,
        effects=named,
        unknown=unknown,
        limits=() if mismatch.found else limits(search, level.nominal),
        fit=fit,
    )
    return Diagnosis(verdict, rests=level, signatures=rig.signatures)


def _of_class(level: Level, effect: NamedEffect) -> NamedEffect:
    """With all effects that explain rest points about as well, refitted or by the screen alone."""
    evidence = {name: level.screen.log_evidence[name] for name in level.search.catalogue}
    alone = {names[0]: c for names, c in level.search.seen.items() if len(names) == 1}
    evidence |= {name: alone[name].log_evidence for name in evidence if name in alone}
    for name, candidate in alone.items():
        if name != effect.name and level.search.at_bound(candidate):
            evidence.pop(name, None)
    best = max(evidence.values())
    near = {n: float(np.exp(e - best)) for n, e in evidence.items() if e > best - CLASS}
    near.setdefault(effect.name, float(np.exp(evidence[effect.name] - best)))
    total = sum(near.values())
    members = dict(sorted(((n, p / total) for n, p in near.items()), key=lambda item: -item[1]))
    return replace(effect, members=members)


def _errors(test: RestFitter, level: Level, setting: Setting, rng: np.random.Generator) -> dict[str, Errors]:
    """Of rest points predicted from commands, on hits that took no part in fitting or choosing."""
    nominal, final = level.nominal.fit, level.final.fit
    mu = np.tile(np.log(setting.friction), (len(nominal.point.nuisance), 1))
    believed = replace(nominal, point=replace(nominal.point, nuisance=mu))
    reference = _log_likelihood(test, nominal)
    scenes = {"nominal": believed, "refitted": nominal, "augmented": final}
    found = {name: _errors_of(test, fit, reference, rng) for name, fit in scenes.items()}
    if final is nominal:
        found["augmented"] = found["refitted"]
    point = _of_other_hits(test, final)
    state = test.evaluate(point, [], final.scatter)
    floor = -(test.freedom() + state.log_volume) / 2
    exact = Interval(1.0, 1.0, 1.0)
    expected = root_mean(test.expected(point, final.scatter), rng)
    return found | {
        "noise_floor": Errors(None, None, expected, mean(floor - reference, rng), exact, None, None)
    }


def _errors_of(test: RestFitter, fit: Fit, reference: Array, rng: np.random.Generator) -> Errors:
    point = _of_other_hits(test, fit)
    state = test.evaluate(point, [], fit.scatter)
    square = ((test.measured - test.predict(point)) ** 2).sum(1)
    gain = _log_likelihood(test, fit) - reference
    place, likelihood = root_mean(square, rng), mean(gain, rng)
    return Errors(None, None, place, likelihood, mean(state.squares / 2, rng, SURE), None, None)


def _log_likelihood(test: RestFitter, fit: Fit) -> Array:
    state = test.evaluate(_of_other_hits(test, fit), [], fit.scatter)
    return -(state.squares + state.log_volume) / 2


def _of_other_hits(test: RestFitter, fit: Fit) -> Point:
    return replace(fit.point, latents=test.start().latents)
