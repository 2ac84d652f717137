"""The slide of many hits at once, against closed forms, its own convergence, and the law of the rollouts."""

import numpy as np
import pytest
from slapshot.arrays import GRAVITY
from slapshot.effects.linear_drag import LinearDrag
from slapshot.effects.offcentre_mass import LEAST_OFFSET, OffcentreMass
from slapshot.effects.slide_law import STEP, ActiveEffect, slide
from slapshot.effects.tilt import Tilt
from slapshot.effects.turned_anisotropy import TurnedAnisotropy
from slapshot.rollouts.slide import slide as rollouts_slide

RADIUS = 0.0381


@pytest.fixture
def launches():
    rng = np.random.default_rng(1)
    n = 40
    heading, speed = rng.uniform(-1.5, 1.5, n), rng.uniform(0.5, 2.5, n)
    spin = rng.normal(0, 4, n)
    zero = np.zeros(n)
    return np.column_stack([zero, zero, zero, speed * np.cos(heading), speed * np.sin(heading), spin])


def friction(n, x=0.35, y=0.3, torsional=0.006):
    return np.tile([x, y, torsional], (n, 1))


def everywhere(effect, n, **values):
    return ActiveEffect(effect, np.arange(n), {k: np.full(n, float(v)) for k, v in values.items()})


def test_without_spin_and_anisotropy_the_distance_is_v_squared_over_2_mu_g(launches):
    launches[:, 5] = 0.0
    tracks = slide(launches, friction(40, 0.3, 0.3), RADIUS, 3.0)
    speed = np.hypot(launches[:, 3], launches[:, 4])
    distance = np.linalg.norm(tracks.rests, axis=1)
    np.testing.assert_allclose(distance, speed**2 / (2 * 0.3 * GRAVITY), rtol=1e-6)
    np.testing.assert_allclose(tracks.durations, speed / (0.3 * GRAVITY), rtol=1e-6)


def test_it_is_the_law_of_the_rollouts(launches):
    """They carry the disc on three points and this one on four: 0.3 mm, 5e-4 of the longest slides here."""
    ours = slide(launches, friction(40), RADIUS, 3.0)
    theirs, _ = rollouts_slide(launches, friction(40), RADIUS)
    assert np.abs(ours.rests - theirs[:, :2]).max() < 3e-4


def test_it_converges_with_the_square_of_the_step(launches):
    """Heun's method; the last, partial step is of higher order."""
    finest = slide(launches, friction(40), RADIUS, 3.0, step=STEP / 16).rests
    coarse, fine = (np.abs(slide(launches, friction(40), RADIUS, 3.0, step=s).rests - finest).mean()
                    for s in (STEP * 2, STEP))  # fmt: skip
    assert 3.0 < coarse / fine < 6.0


def test_on_a_slope_the_deceleration_is_that_of_friction_plus_gravity(launches):
    uphill = np.array([[0.0, 0.0, 0.0, 1.5, 0.0, 0.0]])
    tilt = everywhere(Tilt(), 1, slope_x=0.02, slope_y=0.0)
    tracks = slide(uphill, friction(1, 0.3, 0.3), RADIUS, 3.0, [tilt])
    assert tracks.rests[0, 0] == pytest.approx(1.5**2 / (2 * GRAVITY * (0.3 + 0.02)), rel=1e-6)


def test_linear_drag_has_the_closed_form():
    """With deceleration mu g + c v: x = v/c - mu g / c^2 log(1 + c v / (mu g))."""
    drag = everywhere(LinearDrag(), 1, rate=0.5)
    tracks = slide(np.array([[0, 0, 0, 2.0, 0, 0.0]]), friction(1, 0.2, 0.2), RADIUS, 3.0, [drag])
    dry = 0.2 * GRAVITY
    expected = 2.0 / 0.5 - dry / 0.5**2 * np.log(1 + 0.5 * 2.0 / dry)
    assert tracks.rests[0, 0] == pytest.approx(expected, rel=1e-5)


def test_anisotropy_turned_by_45_degrees_is_that_along_the_axes_seen_from_45_degrees(launches):
    """exp of [[m, c], [c, m]] has eigenvalues exp(m + c) along x = y and exp(m - c) across it."""
    cross = 0.2
    turned = everywhere(TurnedAnisotropy(), 40, cross=cross)
    ours = slide(launches, friction(40, 0.3, 0.3), RADIUS, 3.0, [turned]).rests
    half = np.pi / 4
    rotation = np.array([[np.cos(half), np.sin(half)], [-np.sin(half), np.cos(half)]])
    rotated = launches.copy()
    rotated[:, 3:5] = launches[:, 3:5] @ rotation.T
    # Four points of the rim, turned along, so that yaw starts elsewhere too.
    rotated[:, 2] -= half
    straight = slide(rotated, friction(40, 0.3 * np.exp(cross), 0.3 * np.exp(-cross)), RADIUS, 3.0).rests
    np.testing.assert_allclose(ours @ rotation.T, straight, atol=1e-9)


def test_an_effect_acts_on_its_rows_alone(launches):
    rows = np.array([3, 7, 20])
    some = ActiveEffect(Tilt(), rows, {"slope_x": np.full(3, 0.01), "slope_y": np.zeros(3)})
    plain, tilted = (slide(launches, friction(40), RADIUS, 3.0, a) for a in ([], [some]))
    changed = np.abs(plain.rests - tilted.rests).max(1) > 1e-9
    np.testing.assert_array_equal(np.flatnonzero(changed), rows)


def test_compiled_and_with_an_effect_that_does_nothing_it_is_the_same(launches):
    nothing = [everywhere(LinearDrag(), len(launches), rate=0)]
    still = launches.copy()
    still[0, 3:] = 0.0
    for longest in (12.0, 0.3):
        free, acted_on = (
            slide(still, friction(len(still)), RADIUS, 3.0, acting=acting, longest=longest)
            for acting in ([], nothing)
        )
        for name in ("times", "places", "rests", "durations"):
            np.testing.assert_allclose(getattr(free, name), getattr(acted_on, name), atol=1e-12)


def test_a_hit_does_not_depend_on_the_others(launches):
    all_of_them = slide(launches, friction(40), RADIUS, 3.0)
    alone = slide(launches[5:6], friction(1), RADIUS, 3.0)
    np.testing.assert_array_equal(all_of_them.places[5], alone.places[0])


def test_an_object_whose_mass_is_off_centre_turns_about_its_centre_of_mass():
    """Without friction worth speaking of, the camera sees the middle go round a point that flies straight."""
    offset = everywhere(OffcentreMass(), 1, offset_x=0.01, offset_y=0.0, log_inertia=0.0)
    launch = np.array([[0.0, 0.0, 0.0, 1.0, 0.0, 10.0]])
    tracks = slide(launch, friction(1, 1e-6, 1e-6, 1e-6), RADIUS, 0.5, [offset])
    t = tracks.times[:40]
    # The middle starts at 0, the centre of mass 1 cm ahead, so that it moves sideways by spin x offset.
    expected_x = 0.01 + t - 0.01 * np.cos(10 * t)
    expected_y = 0.1 * t - 0.01 * np.sin(10 * t)
    np.testing.assert_allclose(tracks.places[0, :40], np.column_stack([expected_x, expected_y]), atol=2e-5)


def test_a_slug_stops_spinning_as_its_moment_of_inertia_says():
    """Friction's torque on a disc that spins in place, mu_t >> mu r, takes omega I / torque seconds."""
    inertia = np.exp(-0.7) * RADIUS**2 / 2
    # Far enough from the middle to be a slug: inertia is as it says but for exp(-9).
    slug = everywhere(OffcentreMass(), 1, offset_x=3 * LEAST_OFFSET, offset_y=0.0, log_inertia=-0.7)
    # About the centre of mass, which lies still.
    launch = np.array([[0.0, 0.0, 0.0, 0.0, -10.0 * 3 * LEAST_OFFSET, 10.0]])
    stopped = slide(launch, friction(1, 1e-6, 1e-6, 0.01), RADIUS, 0.5, [slug]).durations[0]
    assert stopped == pytest.approx(10.0 * inertia / (0.01 * GRAVITY), rel=1e-3)


def test_what_still_moves_at_the_end_is_left_where_it_is():
    launch = np.array([[0.0, 0.0, 0.0, 2.0, 0.0, 0.0]])
    tracks = slide(launch, friction(1, 1e-9, 1e-9, 1e-9), RADIUS, 0.5, longest=0.5)
    assert tracks.durations[0] == 0.5
    assert tracks.rests[0, 0] == pytest.approx(1.0, abs=1e-6)


def test_what_does_not_move_the_centre_of_mass_has_no_inertia_of_its_own(launches):
    even = slide(launches, friction(40), RADIUS, 3.0).rests
    slug = everywhere(OffcentreMass(), 40, offset_x=0.0, offset_y=0.0, log_inertia=-0.7)
    np.testing.assert_allclose(slide(launches, friction(40), RADIUS, 3.0, [slug]).rests, even, atol=1e-12)


def test_places_between_rows_are_interpolated_and_stay_after_rest(launches):
    tracks = slide(launches, friction(40), RADIUS, 3.0)
    late = tracks.at(np.full((40, 1), 2.9))
    np.testing.assert_array_equal(late[:, 0], tracks.rests)
    middle = (tracks.times[3] + tracks.times[4]) / 2
    between = tracks.at(np.full((40, 1), middle))[:, 0]
    np.testing.assert_allclose(between, (tracks.places[:, 3] + tracks.places[:, 4]) / 2)


def test_spin_that_dies_fast_does_not_upset_coarse_steps():
    """Torsional friction of 7 cm, which a fit may try: at 4 ms Heun's method alone was off by 14 mm."""
    launches, torsional = np.zeros((8, 6)), friction(8)
    launches[:, 3], launches[:, 4], launches[:, 5] = 0.35, np.linspace(-0.6, 0.6, 8), np.linspace(-6, 6, 8)
    torsional[:, 2] = 0.07
    times = np.tile(np.linspace(0, 0.4, 60), (8, 1))
    fine = slide(launches, torsional, RADIUS, 1.0, step=STEP / 16)
    coarse = slide(launches, torsional, RADIUS, 1.0, step=2 * STEP)
    # Rows of the coarse one are 20 ms apart: a deceleration of 4 m/s^2 bends by 0.2 mm in between.
    assert np.abs(coarse.at(times) - fine.at(times)).max() < 3e-4
    # Heun: at half the step a quarter, or less where steps near the rest follow the time that is left.
    off = [
        np.abs(slide(launches, torsional, RADIUS, 1.0, step=h).rests - fine.rests).max()
        for h in (STEP, 2 * STEP)
    ]
    assert off[0] < 3e-5
    assert off[1] < 16 * off[0]
    none = everywhere(Tilt(), 8, slope_x=0.0, slope_y=0.0)  # not compiled, and for all discs at once
    same = slide(launches, torsional, RADIUS, 1.0, [none], step=2 * STEP)
    np.testing.assert_allclose(same.poses, coarse.poses, atol=1e-9)
