"""Where a slide begins: not before its striker has let go of the object, and not later."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from slapshot.calibration.slide_recordings import slide_recording as recording
from slapshot.diagnosis.pucks.slide.release_detection import (
    NEVER_RESTED,
    RELEASE_DISTANCE,
    moving_frames,
)
from slapshot.diagnosis.pucks.slide.tracks import hit_tracks

RATE = 50.0
NOISE = 0.001  # m
SLOWING = 3.0  # m/s^2
CONTACT = 0.5  # s


@pytest.fixture
def rng():
    return np.random.default_rng(4)


def of_paths(rng, paths, noise=NOISE, rate=RATE):
    """Recording of ways (frames,) in m along x."""
    made = recording(rng, hits=len(paths))
    tracks = [
        pd.DataFrame(
            {
                "hit": hit,
                "t": np.arange(len(path)) / rate,
                "x": path + rng.normal(0, noise, len(path)),
                "y": rng.normal(0, noise, len(path)),
                "yaw": np.nan,
            }
        )
        for hit, path in enumerate(paths)
    ]
    return replace(made, tracks=pd.concat(tracks, ignore_index=True))


def pushed(length, speed):
    """An object that is sped up evenly over a length in m to a speed in m/s, and then slows down."""
    pushing = 2 * length / speed
    t = np.arange(0, CONTACT + pushing + speed / SLOWING + 1.0, 1 / RATE)
    push = np.clip(t - CONTACT, 0, pushing)
    slide = np.clip(t - CONTACT - pushing, 0, speed / SLOWING)
    return speed * push**2 / (2 * pushing) + speed * slide - SLOWING * slide**2 / 2


@pytest.mark.parametrize("length", [0.3, 0.4])
def test_an_object_that_is_followed_for_long_is_released_where_it_begins_to_slow_down(rng, length):
    speeds = np.linspace(1.2, 2.0, 20)
    tracks = hit_tracks(of_paths(rng, [pushed(length, speed) for speed in speeds]))
    released = CONTACT + 2 * length / speeds[tracks.hit]
    # Two frames to either side belong to the median of five.
    assert np.abs(tracks.release - released).max() < 3 / RATE


def test_a_struck_object_is_released_at_a_fixed_distance(rng):
    speeds = np.linspace(1.2, 2.2, 200)
    tracks = hit_tracks(of_paths(rng, [pushed(0.03, speed) for speed in speeds]))
    assert len(tracks) == len(speeds)
    # Within two frames, of which one belongs to the median.
    assert (tracks.places[:, 0, 0] > RELEASE_DISTANCE - 3 * NOISE).all()
    assert (tracks.places[:, 0, 0] < RELEASE_DISTANCE + 3 * NOISE + 2 * speeds / RATE).all()


def test_where_a_slide_begins_is_not_chosen_by_the_noise_of_its_first_frame(rng):
    """Of 1,500 frames 30 mm apart and with noise of 6 mm; the first beyond a distance errs by 36 / 30 mm."""
    noise, paths = 0.006, [pushed(0.03, 1.5 + 0.03 * phase) for phase in rng.uniform(size=1500)]
    tracks = hit_tracks(of_paths(rng, paths, noise))
    frames = np.round(tracks.release * RATE).astype(int)
    ahead = tracks.places[:, 0, 0] - [
        paths[hit][frame] for hit, frame in zip(tracks.hit, frames, strict=True)
    ]
    assert len(ahead) > 1400
    assert abs(ahead.mean()) < 4 * noise / np.sqrt(len(ahead))


def test_what_gains_speed_after_it_slowed_down_was_released_before(rng):
    slide = pushed(0.03, 1.5)
    half = int((CONTACT + 0.35) * RATE)
    pulled = np.concatenate([slide[:half], slide[half] + pushed(0.1, 2.5)[int(CONTACT * RATE) :]])
    tracks = hit_tracks(of_paths(rng, [pulled]))
    assert tracks.places[0, 0, 0] < RELEASE_DISTANCE + 0.06


def followed(speed, pushing, gained=1.6):
    """An object that is struck, and pushed on for a time in s, in which it gains speed a little."""
    t = np.arange(0, CONTACT + 2.5, 1 / RATE) - CONTACT
    push = np.clip(t, 0, pushing)
    fastest = speed + gained * pushing
    slide = np.clip(t - pushing, 0, fastest / SLOWING)
    return speed * push + gained * push**2 / 2 + fastest * slide - SLOWING * slide**2 / 2


def test_an_object_that_gains_a_little_speed_is_released_where_it_stops_gaining(rng):
    """Of .56 m/s that are gained; the speed over four frames alone has .05 of noise."""
    speeds = np.linspace(1.2, 2.0, 40)
    tracks = hit_tracks(of_paths(rng, [followed(v, 0.35) for v in speeds], noise=0.003))
    late = tracks.release - (CONTACT + 0.35)
    assert len(late) == 40
    assert np.mean(np.abs(late) < 4 / RATE) > 0.95
    struck = hit_tracks(of_paths(rng, [followed(v, 0.0) for v in speeds], noise=0.003))
    assert (struck.places[:, 0, 0] < RELEASE_DISTANCE + 0.01 + 2 * speeds / RATE).all()


def test_noise_of_the_last_frame_does_not_make_an_object_move(rng):
    paths = [pushed(0.03, 1.5) for _ in range(20)]
    for path in paths:
        path[-1] += 0.015
    assert len(hit_tracks(of_paths(rng, paths))) == 20


def test_what_still_moves_in_the_end_is_left_out(rng):
    slide = pushed(0.03, 1.5)
    whole = int((CONTACT + 0.04 + 1.5 / SLOWING) * RATE)
    assert len(hit_tracks(of_paths(rng, [slide[: whole - 10]] * 3))) == 0


@pytest.mark.parametrize("rate", [60, 120, 240, 500, 1000])
def test_a_fast_camera_is_no_reason_to_take_a_moving_object_for_one_at_rest(rate):
    """Cut at .8 m/s; a frame of 1 ms shows less than 1 mm of the way."""
    until = CONTACT + 0.04 + (1.5 - 0.8) / SLOWING
    t = np.arange(0, until, 1 / rate)
    way = np.interp(t, np.arange(len(pushed(0.03, 1.5))) / RATE, pushed(0.03, 1.5))
    assert moving_frames(t, np.stack([way, 0 * way], axis=1)) == NEVER_RESTED


def carried_back(speed, to):
    """An object that slides, rests for a second, and is then carried to a place in m in two seconds."""
    slide = pushed(0.03, speed)
    return np.concatenate([slide, np.linspace(slide[-1], to, int(2 * RATE)), np.full(int(RATE), to)])


@pytest.mark.parametrize("to", [0.0, -0.3])
def test_an_object_that_a_hand_carries_back_slid_before_that(to):
    speeds = np.linspace(1.2, 2.0, 12)
    plain = hit_tracks(of_paths(np.random.default_rng(5), [pushed(0.03, v) for v in speeds]))
    back = hit_tracks(of_paths(np.random.default_rng(5), [carried_back(v, to) for v in speeds]))
    assert back.hit.tolist() == plain.hit.tolist()
    assert np.abs(back.release - plain.release).max() <= 2 / RATE
    ends = [tracks.places[np.arange(12), tracks.valid.sum(1) - 1, 0] for tracks in (plain, back)]
    assert np.abs(ends[1] - ends[0]).max() < 6 * NOISE


def test_where_an_object_lay_is_not_told_by_frames_in_which_it_moves(rng):
    """Of twelve tracks, six begin when the object slides already, of which a frame shows 1 cm."""
    t, rate = np.arange(0, 2, 0.01), 100
    whole = [np.interp(t, np.arange(len(way)) / RATE, way) for way in [pushed(0.03, 1.2)] * 12]
    late = int((CONTACT + 0.06) * rate)
    tracks = hit_tracks(of_paths(rng, [*whole[:6], *(way[late:] for way in whole[6:])], rate=rate))
    seen = np.isfinite(tracks.seen_start).all(1)
    assert tracks.hit.tolist() == list(range(12))
    assert seen.tolist() == [True] * 6 + [False] * 6
