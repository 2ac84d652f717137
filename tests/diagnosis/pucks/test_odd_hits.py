"""Hits and recordings that are odd, but not bad: lost frames, few commands, no noise, places far away."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from slapshot.calibration.slide_recordings import CAMERA, RADIUS
from slapshot.calibration.slide_recordings import slide_recording as recording
from slapshot.diagnosis.pucks import held_out
from slapshot.diagnosis.pucks.diagnose import LEAST_NOISE, _noise, diagnose
from slapshot.diagnosis.pucks.fit.hit_fit import HitFitter
from slapshot.diagnosis.pucks.held_out import FEWEST_COMMANDS, split_hits
from slapshot.diagnosis.pucks.launch.execution import readings_of
from slapshot.diagnosis.pucks.launch.strikes import commands_through
from slapshot.diagnosis.pucks.report import wording
from slapshot.diagnosis.pucks.result import Setting
from slapshot.diagnosis.pucks.selection.judgement import _limits_of
from slapshot.diagnosis.pucks.selection.search import Search
from slapshot.diagnosis.pucks.slide.noise import CameraNoise, leaps
from slapshot.diagnosis.pucks.slide.slide_model import Column, Point, SlideModel
from slapshot.diagnosis.pucks.slide.suitability import REMEDIES, cannot_tell
from slapshot.diagnosis.pucks.slide.tracks import (
    FEW_READINGS,
    NO_COMMAND,
    NO_READINGS,
    ONE_COMMAND,
    HitTracks,
    hit_tracks,
    hits_without_swing,
    rest_tracks,
)
from slapshot.effects.catalogue import catalogue


def fast(rng, lost=()):
    """Times, places and validity of one hit at 2.5 m/s seen at 30 Hz with noise of 1 mm, some frames lost."""
    kept = np.setdiff1d(np.arange(30), lost)
    t = kept / 30
    places = np.stack([2.5 * t - 0.8 * t**2, 0.3 * t], axis=1) + rng.normal(0, 1e-3, (len(t), 2))
    return t[None], places[None], np.ones((1, len(t)), bool)


@pytest.mark.parametrize("lost", [(), (10,), (3, 4), (10, 12, 14)])
def test_good_frames_beside_lost_ones_do_not_leap(lost):
    times, places, valid = fast(np.random.default_rng(1), lost)
    assert not leaps(times, places, valid, 1e-3).any()
    places[0, 12, 1] += 0.1
    told = np.flatnonzero(leaps(times, places, valid, 1e-3)[0]).tolist()
    assert 12 in told
    assert set(told) <= {11, 12, 13}  # what is told by it leaps, too


def test_a_start_leaves_all_frames_where_they_are():
    """However often it is asked for; frames that show something else are left out once."""
    made = recording(np.random.default_rng(5), 12, rate=30.0, missing=0.05, mistracks=0.02)
    fitter = HitFitter(SlideModel(hit_tracks(made), {}, RADIUS, CAMERA), CameraNoise(0.003, 0.0))
    valid, places = fitter.valid.copy(), fitter.model.tracks.places.copy()
    assert (~valid).sum() > 0
    for _ in range(3):
        fitter.start()
    assert np.array_equal(fitter.valid, valid)
    assert np.array_equal(fitter.model.tracks.places, places)


@pytest.mark.parametrize(("commands", "whole"), [(2, False), (FEWEST_COMMANDS, True)])
def test_of_few_commands_hits_are_held_out_and_of_many_whole_commands(commands, whole):
    tracks = hit_tracks(recording(np.random.default_rng(2), 40))
    tracks = replace(tracks, command=np.arange(len(tracks)) % commands)
    kept, held = split_hits(tracks, np.random.default_rng(0))
    assert len(held) == pytest.approx(len(tracks) / 4, abs=1)
    shared = set(tracks.command[kept]) & set(tracks.command[held])
    assert shared == (set() if whole else {0, 1})


@pytest.mark.parametrize("seed", range(20))
def test_no_object_is_held_out_whole(seed):
    """Ten objects of four hits each, of which a quarter is held out; and one of a single hit."""
    tracks = hit_tracks(recording(np.random.default_rng(2), 48)).take(np.arange(41))
    tracks = replace(tracks, object=np.append(np.arange(40) % 10, 10), command=np.arange(41))
    kept, held = split_hits(tracks, np.random.default_rng(seed))
    assert np.bincount(tracks.object[kept], minlength=11).tolist() == [3] * 10 + [1]
    assert len(held) == 10


def test_of_objects_that_are_hit_twice_hits_are_held_out_all_the_same():
    tracks = hit_tracks(recording(np.random.default_rng(2), 48)).take(np.arange(40))
    tracks = replace(tracks, object=np.arange(40) // 2, command=np.arange(40))
    kept, held = split_hits(tracks, np.random.default_rng(0))
    assert (len(kept), len(held)) == (30, 10)


@pytest.mark.parametrize(
    ("rate", "begin", "expected"), [(1000, 0.003, 0.01), (125, 0.0, 0.01), (100, 0.0, 0.01), (50, 0.01, 0.02)]
)
def test_encoders_are_read_where_swings_are_known(rate, begin, expected):
    """At a kilohertz from 3 ms on, at 125 Hz, and as seldom as they are read."""
    t = begin + np.arange(round(0.6 * rate)) / rate
    joints = pd.concat([pd.DataFrame({"hit": hit, "t": t, "q0": hit + 2 * t, "q1": -t}) for hit in (4, 7)])
    times, read = readings_of(joints, np.array([4, 7]), 1e-3, 0.5)
    assert np.diff(times) == pytest.approx(expected)
    assert times / expected == pytest.approx(np.round(times / expected))
    assert (times[0], times[-1]) == pytest.approx((np.ceil(begin / expected) * expected, 0.5), abs=1e-9)
    np.testing.assert_allclose(read[1], np.stack([7 + 2 * times, -times], axis=1), atol=1e-12)


def moved(made, x):
    """The same recording in a frame whose origin is elsewhere along x, in m."""
    tracks, hits = made.tracks.copy(), made.hits.copy()
    tracks["x"] += x
    hits[["start_x", "rest_x"]] += x
    return replace(made, tracks=tracks, hits=hits)


def test_a_field_that_no_object_reaches_is_no_hypothesis():
    """A robot that faces the other way: no bump of a board is near."""
    names = ("tilt", "uneven_board")
    known = {name: catalogue()[name] for name in names}
    tracks = hit_tracks(moved(recording(np.random.default_rng(3), 16), -20.0))
    fitter = HitFitter(SlideModel(tracks, known, RADIUS, CAMERA), CameraNoise(0.003, 0.0))
    search = Search(fitter, names, (), np.random.default_rng(0))
    screen = search.screen(search.nominal(), names)
    assert screen.best(names) == ["tilt", "uneven_board"]
    assert np.isneginf(screen.log_evidence["uneven_board"])
    assert search.unreached == {"uneven_board"}
    assert not search.failed


def test_a_diagnosis_goes_on_where_no_place_can_be_told():
    made = moved(recording(np.random.default_rng(3), 24, {"tilt": {"slope_x": 0.0, "slope_y": 0.03}}), -20.0)
    known = {name: catalogue()[name] for name in ("tilt", "uneven_board")}
    verdict = diagnose(made, Setting(RADIUS, CAMERA - [20.0, 0.0], (0.35, 0.32, 0.005)), 0, known).verdict
    assert [effect.name for effect in verdict.effects] == ["tilt"]
    (told,) = [note for note in verdict.notes if "could act" in note]
    assert "where free place, uneven board could act" in told


def test_hits_of_whose_swing_nothing_is_known_are_left_out_with_the_reason():
    made = recording(np.random.default_rng(4), 6)
    numbers = made.hits["hit"].tolist()
    rows = pd.DataFrame({"hit": np.repeat(numbers, 3), "t": np.tile([0.0, 0.1, 0.2], 6), "q0": 0.0})
    assert hits_without_swing(made) == {}
    made = replace(made, commands=rows[rows["hit"] != numbers[2]], joints=rows[rows["hit"] != numbers[4]])
    assert hits_without_swing(made) == {numbers[2]: NO_COMMAND, numbers[4]: NO_READINGS}
    tracks = rest_tracks(made, hits_without_swing(made))
    assert tracks.hit.tolist() == [numbers[k] for k in (0, 1, 3, 5)]
    assert set(tracks.dropped.values()) == {NO_COMMAND, NO_READINGS}


def test_hits_whose_swing_is_told_in_part_are_left_out_and_do_not_shorten_the_others():
    made = recording(np.random.default_rng(4), 6)
    numbers = made.hits["hit"].tolist()
    t = np.arange(10) / 10
    rows = pd.DataFrame({"hit": np.repeat(numbers, 10), "t": np.tile(t, 6), "q0": 0.0})
    hit = rows["hit"]
    # Of .9 s, one is read for .4 and one for .3; another one is read twice at both ends.
    unread = (
        ((hit == numbers[0]) & (rows["t"] < 0.45))
        | ((hit == numbers[1]) & (rows["t"] > 0.35))
        | ((hit == numbers[3]) & rows["t"].between(0.05, 0.85))
    )
    once = (hit == numbers[2]) & (rows["t"] > 0)
    found = hits_without_swing(replace(made, joints=rows[~unread], commands=rows[~once]))
    assert found == {numbers[k]: FEW_READINGS for k in (0, 1, 3)} | {numbers[2]: ONE_COMMAND}
    assert set(REMEDIES) >= set(found.values())


def test_an_arm_waits_where_its_command_begins():
    """A swing of .8 rad, read with an encoder's noise, that begins half a second late."""
    info = SimpleNamespace(control_period=0.02, servo_time=0.1)
    t = 0.5 + np.arange(50) * 0.02
    share = (t - t[0]) / (t[-1] - t[0])
    q = 0.8 * share**3 * (10 - 15 * share + 6 * share**2) + np.random.default_rng(0).normal(0, 1e-4, len(t))
    told = commands_through([np.column_stack([t, q])], SimpleNamespace(info=info), 2.0)
    before, after = told.positions[0, :25, 0], told.positions[0, 76:, 0]
    assert before == pytest.approx(np.full(25, q[0]), abs=1e-12)
    assert after == pytest.approx(np.full(len(after), q[-1]), abs=1e-12)
    np.testing.assert_array_equal(told.targets[0, :25, 0], before)


def seen(places: np.ndarray, resting: np.ndarray) -> HitTracks:
    """Tracks of one hit, and residuals at rest."""
    tracks = hit_tracks(recording(np.random.default_rng(6), 1))
    return replace(
        tracks,
        times=np.arange(len(places))[None] / 50,
        places=places[None],
        valid=np.ones((1, len(places)), bool),
        resting=(resting, np.concatenate([[np.inf], np.full(len(resting) - 1, 0.02)])),
    )


@pytest.mark.parametrize(
    ("unit", "step", "sd"), [(1.0, 1e-3, 1e-3 / np.sqrt(12)), (0.0254, 0.1, 0.00254 / np.sqrt(12))]
)
def test_places_that_were_rounded_have_at_least_the_noise_of_rounding(unit, step, sd):
    """Whatever a conversion, as from inches, does to the last bits."""
    way = np.stack([np.linspace(0, 60, 90) ** 0.9, np.linspace(0, 50 * step, 90)], axis=1)
    noise = _noise(seen(np.round(way / step) * step * unit, np.zeros((40, 2))))
    assert noise.sd == pytest.approx(sd, rel=1e-6)


def test_places_without_any_noise_have_the_least_that_a_camera_has():
    way = np.stack([np.linspace(0, 3, 90) ** 0.9, np.linspace(0, 1, 90)], axis=1)
    assert _noise(seen(way, np.zeros((40, 2)))).sd == LEAST_NOISE


def test_without_frames_at_rest_nothing_can_be_told():
    made = recording(np.random.default_rng(8), 16)
    tracks = hit_tracks(made)
    assert cannot_tell(made, tracks) is None
    few = replace(tracks, resting=(np.zeros((8, 2)), np.full(8, np.inf)))
    assert "only 8 frames show an object at rest" in cannot_tell(made, few)


def test_a_twist_of_a_joint_is_no_bump_of_a_board():
    assert wording.is_bump("height_12")
    assert wording.is_bump("log_friction_3")
    assert not wording.is_bump("twist_3")
    assert "board" not in wording.parameter_label("twist_3", "of joint 3")
    assert " m" not in wording.parameter_label("twist_3", "of joint 3")


def test_what_a_recording_says_nothing_about_has_no_limit():
    """A middle of a lens that does not distort is as uncertain as its prior."""
    lens = {p.name: p for p in catalogue()["lens_distortion"].parameters}
    columns = [Column("lens_distortion", name, -1, 0.1) for name in ("radial", "middle_x")]
    prior = np.array([lens[c.parameter].scale for c in columns])
    search = SimpleNamespace(fitter=SimpleNamespace(effects=catalogue()))
    told = _limits_of(
        search, columns, np.zeros(2), np.diag((prior * [0.1, 1.0]) ** 2), "lens_distortion", prior
    )
    assert [limit.parameter for limit in told] == ["radial"]
    assert told[0].at_most == pytest.approx(1.96 * 0.1 * prior[0])


def test_each_scene_is_held_against_hits_as_it_is_simulated_itself(monkeypatch):
    asked = []
    nominal, final = (SimpleNamespace(point=Point(np.zeros((2, 6)), np.zeros((1, 3))), of=n) for n in "nf")

    def predicted(fitter, fit):
        asked.append((fitter.about, getattr(fit, "of", None)))
        return SimpleNamespace(loglik=np.zeros(2))

    monkeypatch.setattr(held_out, "replace", lambda fit, point: SimpleNamespace(point=point, of="believed"))
    monkeypatch.setattr(held_out, "predict_held_out", predicted)
    monkeypatch.setattr(held_out, "errors_of", lambda *_: None)
    monkeypatch.setattr(held_out, "noise_floor", lambda *_: None)
    test, about = (SimpleNamespace(about=name, noise=SimpleNamespace(error=0.0)) for name in ("it", "found"))
    held_out.errors_of_scenes(test, about, nominal, final, (0.3, 0.3, 0.01), np.random.default_rng(0))
    assert sorted(asked) == [("found", "f"), ("it", "believed"), ("it", "n")]
