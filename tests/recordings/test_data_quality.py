"""What is odd in a recording: each oddity is put into good hits, and must be told with its hits."""

import argparse
import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from slapshot.recordings.cli import format_warnings, run_check
from slapshot.recordings.data_quality import quality_warnings
from slapshot.recordings.format import Recording
from slapshot.recordings.quality_warning import QualityWarning, WarningKind
from slapshot.recordings.track_features import hit_tracks, rest_noise, slide_table
from slapshot.recordings.write import write_recording

from .builder import make_recording
from .slide_tracks import RATE_HZ, G, recording_of, slide, varied_slides

Tracks = list[tuple[np.ndarray, np.ndarray]]


def clocked(tracks: Tracks) -> Tracks:
    """Tracks whose clock is real: now and then a frame is missing."""
    rng = np.random.default_rng(9)
    keep = [np.sort(rng.permutation(len(t))[: round(0.98 * len(t))]) for t, _ in tracks]
    return [(t[rows], xy[rows]) for (t, xy), rows in zip(tracks, keep, strict=True)]


@pytest.fixture
def good() -> Tracks:
    return clocked(varied_slides())


def texts(recording: Recording) -> list[str]:
    return [finding.what for finding in quality_warnings(recording)]


def test_nothing_is_odd_in_good_hits(good: Tracks) -> None:
    assert quality_warnings(recording_of(good)) == []


def test_a_recording_without_tracks_has_only_too_few_hits() -> None:
    recording = dataclasses.replace(make_recording(), tracks=None)
    assert texts(recording) == ["only 6 hits"]


def break_clock(tracks: Tracks) -> Tracks:
    return [(t[0] + np.arange(len(t)) / RATE_HZ, xy) for t, xy in tracks]


def freeze(tracks: Tracks) -> Tracks:
    for _, xy in tracks[:4]:
        xy[62:65] = xy[61]
    return tracks


def repeat_at_rest(tracks: Tracks) -> Tracks:
    for _, xy in tracks:
        xy[:40] = np.repeat(xy[:40:2], 2, axis=0)
    return tracks


def mistrack(tracks: Tracks) -> Tracks:
    for _, xy in tracks[:5]:
        xy[30] += [0.1, -0.2]
    return tracks


def put_back(tracks: Tracks) -> Tracks:
    for _, xy in tracks[:2]:
        xy[-20:] = xy[0]
    return tracks


def drift_at_rest(tracks: Tracks) -> Tracks:
    for _, xy in tracks[:3]:
        xy[:48] += np.linspace(0, 0.006, 48)[:, None]
    return tracks


def colour(tracks: Tracks) -> Tracks:
    rng = np.random.default_rng(0)
    for _, xy in tracks:
        walk = np.zeros(xy.shape)
        for i in range(1, len(walk)):
            walk[i] = 0.9 * walk[i - 1] + rng.normal(0, 0.0002, 2)
        xy += walk
    return tracks


def round_to_millimetres(tracks: Tracks) -> Tracks:
    return [(t, np.round(xy, 3)) for t, xy in tracks]


def lose_frames(tracks: Tracks) -> Tracks:
    return [
        (np.delete(t, slice(60, 80)), np.delete(xy, slice(60, 80), axis=0)) for t, xy in tracks[:3]
    ] + tracks[3:]


def hold_still(tracks: Tracks) -> Tracks:
    return [
        (t, np.random.default_rng(i).normal(0, 2e-4, xy.shape)) for i, (t, xy) in enumerate(tracks[:2])
    ] + tracks[2:]


def cut_beginnings(tracks: Tracks) -> Tracks:
    return [(t[55:] - t[55], xy[55:]) for t, xy in tracks[:2]] + tracks[2:]


def cut_ends(tracks: Tracks) -> Tracks:
    return [(t[:70], xy[:70]) for t, xy in tracks[:2]] + tracks[2:]


def push_again(tracks: Tracks) -> Tracks:
    pushed = []
    for t, xy in tracks[:3]:
        ahead = (xy[-1] - xy[0]) / np.linalg.norm(xy[-1] - xy[0])
        _, more = slide(0.9, float(np.arctan2(*ahead[::-1])), before_s=0.8, noise_m=0, start=(0.0, 0.0))
        way = more[np.minimum(np.rint(t * RATE_HZ).astype(int), len(more) - 1)]
        pushed.append((t, xy + way))
    return pushed + tracks[3:]


def nudge(tracks: Tracks) -> Tracks:
    for t, xy in tracks[:2]:
        xy -= np.outer(np.clip((0.3 - t) / 0.1, 0, 1), [0.04, 0.0])
    return tracks


def shake_clock(tracks: Tracks) -> Tracks:
    # A tracker at 250 Hz, read 100 times a second: what is seen is up to 4 ms old.
    shaken = []
    for i, (t, _) in enumerate(tracks):
        fine, places = slide(1.0 + i / 60, i / 20 - 1, noise_m=0.0001, seed=i, rate_hz=1000.0)
        seen = np.floor(t * 250 * 1.01) / (250 * 1.01)
        shaken.append((t, places[np.minimum(np.rint(seen * 1000).astype(int), len(fine) - 1)]))
    return shaken


def vary_friction(tracks: Tracks) -> Tracks:
    # Friction that follows the heading.
    headings = np.linspace(-1.0, 1.0, len(tracks))
    speeds = np.random.default_rng(1).uniform(0.8, 1.6, len(tracks))
    return clocked(
        [
            slide(s, h, friction=0.2 + 0.05 * h, seed=i)
            for i, (s, h) in enumerate(zip(speeds, headings, strict=True))
        ]
    )


def aim_twice(tracks: Tracks) -> Tracks:
    # Two of three hits in one direction within a fraction of a degree; friction follows the speed.
    headings = np.where(np.arange(len(tracks)) % 4 == 0, 1.1, 0.3 + 0.001 * np.sin(np.arange(len(tracks))))
    speeds = np.random.default_rng(1).uniform(0.8, 1.6, len(tracks))
    return clocked(
        [
            slide(s, h, friction=0.1 + 0.1 * s, seed=i)
            for i, (s, h) in enumerate(zip(speeds, headings, strict=True))
        ]
    )


def drag(tracks: Tracks) -> Tracks:
    # Deceleration mu g + c v, in closed form.
    rng, pull, c = np.random.default_rng(2), 0.2 * G, 1.0
    dragged = []
    for i in range(len(tracks)):
        v0, heading = rng.uniform(1.0, 1.8), rng.uniform(-1, 1)
        t = np.arange(200) / RATE_HZ
        since = np.clip(t - 0.5, 0, np.log1p(c * v0 / pull) / c)
        way = (v0 + pull / c) / c * (1 - np.exp(-c * since)) - pull / c * since
        xy = np.outer(way, [np.cos(heading), np.sin(heading)])
        dragged.append((t, xy + np.random.default_rng(i).normal(0, 2e-4, xy.shape)))
    return clocked(dragged)


CASES: dict[str, tuple[WarningKind, Callable[[Tracks], Tracks], str, int]] = {
    "no clock": ("no_clock", break_clock, "no clock: all", 0),
    "frozen": ("frozen_frames", freeze, "repeat the previous position while the object moves", 4),
    "repeated at rest": ("repeated_frames", repeat_at_rest, "of the frames at rest repeat", 0),
    "mistracks": ("mistracks", mistrack, "lie away from their neighbours", 5),
    "put back": ("place_changes", put_back, "jumps between two frames and stays there", 2),
    "drift at rest": ("uneven_noise", drift_at_rest, "in 3 of 40 hits more than 4 times the median", 3),
    "coloured noise": ("correlated_noise", colour, "noise at rest is correlated", 0),
    "coarse": ("coarse_numbers", round_to_millimetres, "have a resolution of 1 mm", 0),
    "gaps": ("gaps", lose_frames, "3 of 40 hits have gaps", 3),
    "still": ("never_moves", hold_still, "2 of 40 hits never move", 2),
    "moving at the start": ("moving_at_start", cut_beginnings, "2 of 40 hits move in their first frame", 2),
    "moving at the end": ("moving_at_end", cut_ends, "2 of 40 hits still move", 2),
    "second push": ("second_push", push_again, "in 3 of 40 hits the speed rises again", 3),
    "nudge": ("moves_again", nudge, "2 of 40 hits move more than once", 2),
    "sampled tracker": ("moving_noise", shake_clock, "long and short steps alternate", 0),
    "friction of two aims": ("scatter", aim_twice, "speed (rank correlation +", 0),
    "friction by heading": ("scatter", vary_friction, "heading (rank correlation +1.00)", 0),
    "drag": ("friction_changes", drag, "in the slower half of the slide", 0),
    "few": ("few_hits", lambda tracks: tracks[:10], "only 10 hits", 0),
    "alike headings": (
        "alike_headings",
        lambda tracks: clocked([slide(0.8 + i / 40, seed=i) for i in range(40)]),
        "headings span 0",
        0,
    ),
    "alike speeds": (
        "alike_speeds",
        lambda tracks: clocked([slide(1.2, i / 20, seed=i) for i in range(40)]),
        "all alike: 1.1 m/s",
        0,
    ),
}


@pytest.mark.parametrize(("kind", "breaker", "words", "hits"), CASES.values(), ids=CASES.keys())
def test_each_oddity_is_told_with_its_hits(
    good: Tracks, kind: WarningKind, breaker: Callable[[Tracks], Tracks], words: str, hits: int
) -> None:
    recording = recording_of(breaker(good))
    found = [finding for finding in quality_warnings(recording) if words in finding.what]
    assert len(found) == 1, texts(recording)
    assert len(found[0].hits) == hits
    assert found[0].kind == kind
    assert found[0].why


def test_a_rate_that_is_not_the_cameras_is_told(good: Tracks) -> None:
    recording = recording_of(good, rate_hz=90.0)
    assert any("at the header's 90 Hz" in text for text in texts(recording))


def test_start_and_rest_points_of_other_places_are_told(good: Tracks) -> None:
    recording = recording_of(good)
    hits = recording.hits.copy()
    hits.loc[3, "start_x"] += 0.03
    hits.loc[[5, 6], "rest_y"] -= 0.05
    found = {f.kind: f.hits for f in quality_warnings(dataclasses.replace(recording, hits=hits))}
    assert (found["start_point"], found["rest_point"]) == ((3,), (5, 6))


def test_friction_that_jumps_from_session_to_session_is_told_by_session() -> None:
    rng = np.random.default_rng(0)
    tracks = clocked(
        [
            slide(rng.uniform(0.8, 1.8), rng.uniform(-1, 1), 0.16 if i < 20 else 0.22, seed=i)
            for i in range(40)
        ]
    )
    recording = recording_of(tracks)
    day = pd.Timestamp("2026-03-01 10:00", tz="UTC")
    when = [day + pd.Timedelta(minutes=i) + pd.Timedelta(days=int(i >= 20)) for i in range(40)]
    dated = dataclasses.replace(recording, hits=recording.hits.assign(recorded_at=when))
    text = next(text for text in texts(dated) if "friction differs" in text)
    assert "by session: 1 0.160, 2 0.220" in text
    assert "order (rank correlation +" in text


def test_the_slide_fit_gives_back_speed_friction_and_noise() -> None:
    speeds, frictions = np.linspace(0.8, 2.0, 8), np.linspace(0.15, 0.4, 8)
    tracks = [
        slide(s, 0.3, f, noise_m=0.0005, seed=i)
        for i, (s, f) in enumerate(zip(speeds, frictions, strict=True))
    ]
    table = slide_table(hit_tracks(recording_of(tracks)))
    # Six standard errors of the fits; the launch is fitted half a window after the peak of speed.
    assert np.abs(table["friction"] - frictions).max() < 6 * table["friction_se"].max()
    assert (table["friction_se"] < 0.01).all()
    np.testing.assert_allclose(table["stopping_friction"], frictions, rtol=0.05)
    np.testing.assert_allclose(table["heading"], 0.3, atol=0.02)
    assert (table["launch_speed"] < speeds).all()
    assert (table["launch_speed"] > speeds - 0.06 * frictions * G - 0.05).all()
    noise = [rest_noise(track) for track in hit_tracks(recording_of(tracks))]
    np.testing.assert_allclose(noise, 0.0005, rtol=0.35)


def test_a_mistrack_in_the_slide_does_not_bend_its_friction() -> None:
    t, xy = slide(1.5, friction=0.2, seed=3)
    clean = slide_table(hit_tracks(recording_of([(t, xy)])))
    wrong = xy.copy()
    wrong[80] += 0.15
    bent = slide_table(hit_tracks(recording_of([(t, wrong)])))
    assert bent["friction"].iloc[0] == pytest.approx(clean["friction"].iloc[0], rel=0.02)


def test_a_finding_reads_as_one_line() -> None:
    finding = QualityWarning("scatter", "something is odd", tuple(range(9)), "it matters")
    assert str(finding) == "something is odd (hits 0, 1, 2, 3, 4, 5 and 3 more) - it matters"
    assert format_warnings([]).endswith("none")
    assert format_warnings([finding]).splitlines()[1].strip() == str(finding)


def test_check_prints_what_is_odd(good: Tracks, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_recording(recording_of(good[:5]), tmp_path / "recording")
    assert run_check(argparse.Namespace(recording=str(tmp_path / "recording"))) == 0
    out = capsys.readouterr().out
    assert "tracks only" in out
    assert "only 5 hits" in out
