"""Concealed physics of the slide against what mechanics says in closed form, or as an integral."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad
from slapshot.arrays import GRAVITY
from slapshot.lab.slide import _run, slide
from slapshot.lab.surface import EVEN, push, rise, weight

RADIUS = 0.0381
MU = 0.3
SPEED = 1.7


def stopped(rig, heading=0.0, place=(0.0, 0.0), speed=SPEED, mu=MU):
    """(2,) m from `place` to rest, of an object that does not spin."""
    velocity = speed * np.array([np.cos(heading), np.sin(heading)])
    state = np.array([*place, 0.0, *velocity, 0.0])
    return slide(state, (mu, mu, 1e-6), RADIUS, 0.01, rig.ground).rest[:2] - place


def frictionless(ground, state, seconds, period=1e-3, start=0.0):
    """(rows, 3) x, y, yaw of an object that nothing rubs."""
    track = np.empty((30_000, 3))
    _run(np.array(state, float), 0.0, 0.0, 0.0, RADIUS, 12, ground, start, 2e-4, period, track)
    return track[: round(seconds / period) + 1]


def velocities(track, period=1e-3):
    """(rows - 2, 3) by central differences."""
    return (track[2:] - track[:-2]) / (2 * period)


def distance(deceleration, speed=SPEED):
    """Integral of v dv / a(v), m."""
    return quad(lambda v: v / deceleration(v), 0, speed)[0]


@pytest.mark.parametrize(("name", "power"), [("linear_drag", 1.13), ("quadratic_drag", 1.87)])
def test_drag_with_a_power_of_speed(conceal, name, power):
    rig = conceal(name, 0.8, power=power)
    assert stopped(rig)[0] == pytest.approx(distance(lambda v: MU * GRAVITY + 0.8 * v**power), rel=1e-5)


def test_drag_of_whole_powers_has_the_textbook_distances(conceal):
    dry, strength = MU * GRAVITY, 0.8
    linear = SPEED / strength - dry / strength**2 * np.log(1 + strength * SPEED / dry)
    quadratic = np.log(1 + strength * SPEED**2 / dry) / (2 * strength)
    assert stopped(conceal("linear_drag", strength, power=1.0))[0] == pytest.approx(linear, rel=1e-5)
    assert stopped(conceal("quadratic_drag", strength, power=2.0))[0] == pytest.approx(quadratic, rel=1e-5)


@pytest.mark.parametrize("towards", [0.0, 2.1])
def test_a_tilt_is_gravity_along_the_board(conceal, towards):
    # Up the slope: v^2 / (2 g (mu + s)), down v^2 / (2 g (mu - s)). Across it friction turns with the motion.
    rig = conceal("tilt", 0.05, towards_rad=towards, bow_share_per_m=0.0)
    for sign, heading in ((1, towards), (-1, towards + np.pi)):
        expected = SPEED**2 / (2 * GRAVITY * (MU + sign * 0.05))
        assert np.linalg.norm(stopped(rig, heading)) == pytest.approx(expected, rel=1e-5)
    assert rig.concealed[0].truth()["parameters"] == pytest.approx(
        {"slope_x": 0.05 * np.cos(towards), "slope_y": 0.05 * np.sin(towards)}
    )
    still = np.array([push(rig.ground, x, y, 0.0, 0.0, 0.0, 0.0) for x, y in ((0, 0), (1, 2))])
    assert still == pytest.approx(-0.05 * GRAVITY * np.tile([np.cos(towards), np.sin(towards)], (2, 1)))


def test_a_bow_lifts_by_its_height(conceal):
    # Along the bow h = s x + b (x - c)^2 / 2: v^2 / 2 = g (mu d + h(d) - h(0)).
    s, b, c = 0.04, 0.04 * 0.3, 0.7
    rig = conceal("tilt", 0.04, towards_rad=0.0, bow_share_per_m=0.3, bow_towards_rad=0.0, middle_m=[c, 0.3])
    d = stopped(rig)[0]
    rise_of = s * d + b * ((d - c) ** 2 - c**2) / 2
    assert GRAVITY * (MU * d + rise_of) == pytest.approx(SPEED**2 / 2, rel=1e-5)


def test_an_uneven_board_trades_speed_for_height(conceal):
    rig = conceal("uneven_board", 0.03)
    waves = rig.ground.height
    assert np.sqrt(np.sum((waves[:, 2] * np.hypot(waves[:, 0], waves[:, 1])) ** 2) / 2) == pytest.approx(0.03)
    track = frictionless(rig.ground, [0.1, 0.2, 0.0, 1.5, 0.3, 0.0], 1.0)
    speed = velocities(track)
    x, y = track[1:-1, 0], track[1:-1, 1]
    height = (waves[:, 2] * np.cos(np.outer(x, waves[:, 0]) + np.outer(y, waves[:, 1]) + waves[:, 3])).sum(1)
    energy = (speed[:, :2] ** 2).sum(1) / 2 + GRAVITY * height
    assert np.ptp(GRAVITY * height) > 1e-2
    assert np.ptp(energy) < 1e-4


@pytest.mark.parametrize("power", [0.0, 0.8, 1.4])
def test_stribeck_friction_falls_with_slip(conceal, power):
    rig = conceal("stribeck_friction", 0.6, speed_m_s=0.4, power=power)

    def factor(v):
        return 1 + 0.6 * (np.exp(-((v / 0.4) ** power)) if power else 1 / (1 + (v / 0.4) ** 2))

    assert rise(rig.ground, 0.0) == pytest.approx(1.6)
    expected = distance(lambda v: MU * GRAVITY * factor(v))
    # The slope of friction is steep where the object stops: a step there counts as friction at its start.
    assert stopped(rig)[0] == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize("power", [0.0, 0.8, 1.4])
def test_the_nearest_stribeck_curve_is_near(conceal, power):
    named = conceal("stribeck_friction", 0.6, speed_m_s=0.4, power=power).concealed[0].truth()["parameters"]
    assert 0.3 < named["rise"] < 0.7
    assert 0.3 < np.exp(named["log_speed"]) < 1.2


def test_grooves_hold_back_along_and_let_go_across(conceal):
    # Linear law: -mu N (1 + a A) v / |v| has the eigenvalues 1 + a along and 1 - a across.
    angle = 0.6
    rig = conceal("turned_anisotropy", 0.2, angle_rad=angle)
    for heading, share in ((angle, 1.2), (angle + np.pi / 2, 0.8)):
        moved = stopped(rig, heading)
        assert np.linalg.norm(moved) == pytest.approx(SPEED**2 / (2 * GRAVITY * MU * share), rel=1e-5)
        assert np.arctan2(moved[1], moved[0]) == pytest.approx(heading, abs=1e-6)
    # Halfway in between an object turns towards where it is let go.
    moved = stopped(rig, angle + np.pi / 4)
    assert np.arctan2(moved[1], moved[0]) > angle + np.pi / 4 + 0.03


def test_grooves_give_the_share_of_a_tensor_that_comes_nearest(conceal):
    # Over all headings h, of -(cos h, sin h) (1 + a sin 2h) + ... against a symmetric logarithm with cross c.
    amplitude, h = 0.1, np.linspace(0, 2 * np.pi, 1000)
    rig = conceal("turned_anisotropy", amplitude, angle_rad=np.pi / 4)
    cross = rig.concealed[0].truth()["parameters"]["cross"]
    costs = {
        c: np.mean(((amplitude - c) * np.sin(2 * h)) ** 2 + ((amplitude - 2 * c) * np.cos(2 * h)) ** 2)
        for c in (cross, 0.98 * cross, 1.02 * cross)
    }
    assert min(costs, key=costs.get) == cross


def test_a_curl_bends_the_path_into_a_circle(conceal):
    # a = A w_s tanh(w / w_s) z x v turns the velocity at that rate, whatever its size.
    spin, most = 3.0, 2.0
    rig = conceal("curl", 0.4, sign=1.0, saturation_rad_s=most)
    track = frictionless(rig.ground, [0, 0, 0, 1.2, 0, spin], 1.0)
    speed = velocities(track)
    turned = np.unwrap(np.arctan2(speed[:, 1], speed[:, 0]))
    rate = 0.4 * most * np.tanh(spin / most)
    assert (turned[-1] - turned[0]) / (len(turned) - 1) / 1e-3 == pytest.approx(rate, rel=1e-4)
    assert np.hypot(speed[:, 0], speed[:, 1]) == pytest.approx(1.2, rel=1e-4)
    other = frictionless(
        conceal("curl", 0.4, sign=-1.0, saturation_rad_s=most).ground, track_start(spin), 1.0
    )
    assert other[:, 1] == pytest.approx(-track[:, 1])


def track_start(spin):
    return [0, 0, 0, 1.2, 0, spin]


def test_the_middle_goes_round_a_centre_of_mass_that_is_elsewhere(conceal):
    # Free of friction the centre of mass, o ahead of the middle, goes straight on with v + w x o.
    offset, spin = 0.01, 4.0
    rig = conceal("offcentre_mass", offset, towards_rad=0.0)
    track = frictionless(rig.ground, [0, 0, 0, 1.0, 0, spin], 1.0)
    t = 1e-3 * np.arange(len(track))
    assert track[:, 2] == pytest.approx(spin * t)
    assert track[:, 0] == pytest.approx(offset + t - offset * np.cos(spin * t), abs=1e-6)
    assert track[:, 1] == pytest.approx(spin * offset * t - offset * np.sin(spin * t), abs=1e-6)


def test_an_object_that_presses_harder_on_its_heavy_side_turns_it_ahead(conceal):
    # With the slug to the left, the left is held back by more than it is heavier by half: loads are
    # N (1 + 2 r.o / R^2), whose friction acts at o on average, as inertia does. So it slides straight.
    rig = conceal("offcentre_mass", 0.008, towards_rad=np.pi / 2)
    state = np.array([0, 0, 0, SPEED, 0, 0.0])
    rest = slide(state, (MU, MU, 1e-6), RADIUS, 0.01, rig.ground).rest
    assert rest[0] == pytest.approx(SPEED**2 / (2 * MU * GRAVITY), rel=1e-5)
    assert abs(rest[2]) < 1e-6


def test_a_slug_adds_to_the_moment_of_inertia_by_steiner(conceal):
    offset, share = 0.009, 0.45
    rig = conceal("offcentre_mass", offset, slug_share=share, radius_m=RADIUS)
    # A disc of mass 1 - s around its middle and a point of mass s at o / s, both about o.
    inertia = (1 - share) * (RADIUS**2 / 2 + offset**2) + share * (offset / share - offset) ** 2
    assert rig.ground.centres[0, 2] * RADIUS**2 / 2 == pytest.approx(inertia)


def test_a_spot_attracts_from_its_range_and_presses_down(conceal):
    rig = conceal("attracting_spot", 1.2, place_m=[1.0, 0.2], depth_m=0.1, pull_share=0.5)
    ground = rig.ground
    pulls = {d: push(ground, 1.0 - d, 0.2, 0.0, 0.0, 0.0, 0.0) for d in np.linspace(0, 0.5, 501)}
    assert all(across == 0 for _, across in pulls.values())
    assert max(along for along, _ in pulls.values()) == pytest.approx(1.2, rel=0.03)
    assert pulls[0.0][0] == 0.0
    assert all(along == 0.0 for d, (along, _) in pulls.items() if d > 0.4)
    assert weight(ground, 1.0, 0.2) == pytest.approx(1 + 1.2 * 0.5 / GRAVITY)
    # It stores energy: what an object gains on its way in it loses on its way out.
    track = frictionless(ground, [0.5, 0.21, 0, 1.0, 0, 0], 1.0)
    speed = velocities(track)
    assert speed[:, 0].max() > 1.05
    assert speed[-1, 0] ** 2 + speed[-1, 1] ** 2 == pytest.approx(1.0, abs=1e-5)


def test_a_tether_pulls_back_beyond_its_length(conceal):
    stiffness, length = 16.0, 0.5
    plain = {"anchor_m": [0.0, 0.0], "length_m": length}
    free = frictionless(conceal("tether", stiffness, **plain, loss_s_m=0.0).ground, [0, 0, 0, 1, 0, 0], 2.0)
    # v^2 = k e^2 at the turning point; slack it goes straight on.
    assert free[:, 0].max() == pytest.approx(length + 1 / np.sqrt(stiffness), rel=1e-5)
    assert free[:500, 0] == pytest.approx(1e-3 * np.arange(500), abs=1e-9)
    assert velocities(free)[-1, 0] == pytest.approx(-1.0, rel=1e-3)
    lossy = frictionless(conceal("tether", stiffness, **plain, loss_s_m=0.5).ground, [0, 0, 0, 1, 0, 0], 2.0)
    assert lossy[:, 0].max() < free[:, 0].max()
    assert -1.0 < velocities(lossy)[-1, 0] < -0.3


def test_a_jet_gives_its_impulse_to_what_crosses_it(conceal):
    # Across a strip A sech^2(s / w): the integral over s / v is 2 A w / v.
    plain = {"place_m": [1.0, 0.0], "towards_rad": np.pi / 2, "frequency_hz": 1.0, "phase_rad": 0.3}
    jet = conceal("pulsing_fan", 0.5, **plain, width_m=0.15, gust_share=0.0).ground
    speed = velocities(frictionless(jet, [0, 0, 0, 2.0, 0, 0], 1.0))
    assert speed[-1, 0] == pytest.approx(2.0)
    assert speed[-1, 1] == pytest.approx(2 * 0.5 * 0.15 / 2.0, rel=1e-3)
    # Gusts everywhere: over whole periods what they give is their mean, and they go with the hit's time.
    gusts = conceal("pulsing_fan", 0.5, **plain, width_m=0.0, gust_share=0.8).ground
    speed = velocities(frictionless(gusts, [0, 0, 0, 2.0, 0, 0], 1.5, start=0.7))
    assert speed[1001, 1] - speed[1, 1] == pytest.approx(0.5, rel=1e-3)
    assert push(gusts, 0.0, 0.0, 0.0, 0.0, 0.0, 0.7)[1] == pytest.approx(
        0.5 * (1 + 0.8 * np.cos(2 * np.pi * 0.7 + 0.3))
    )


def test_a_jet_has_a_curl_and_no_height_explains_it(conceal):
    jet = conceal("pulsing_fan", 0.5, place_m=[1.0, 0.0], towards_rad=0.4, width_m=0.15, gust_share=0.0)
    corners = np.array([[0.9, -0.1], [1.1, -0.1], [1.1, 0.3], [0.9, 0.3], [0.9, -0.1]])
    work = 0.0
    for a, b in pairwise(corners):
        places = a + np.linspace(0, 1, 401)[:, None] * (b - a)
        forces = np.array([push(jet.ground, x, y, 0.0, 0.0, 0.0, 0.0) for x, y in places])
        work += float(np.trapezoid(forces @ (b - a), dx=1 / 400))
    assert abs(work) > 0.01


def test_friction_of_a_place_is_multiplied_there(conceal):
    lane = {"what": "lane", "sign": -1.0, "place_m": [0.5, 0.0], "towards_rad": 0.0}
    rig = conceal("place_friction", 0.4, **lane, half_size_m=[3.0, 0.5], edge_m=0.05)
    inside = SPEED**2 / (2 * GRAVITY * MU * np.exp(-0.4))
    assert stopped(rig)[0] == pytest.approx(inside, rel=1e-5)
    outside = stopped(rig, place=(0.0, 1.0))[0]
    assert outside == pytest.approx(SPEED**2 / (2 * GRAVITY * MU), rel=1e-4)
    rms = conceal(
        "place_friction", 0.3, what="waves", waves=[[3.0, 1.0, np.sqrt(2), 0.2]]
    ).ground.log_friction
    assert np.sqrt(np.sum(rms[:, 2] ** 2) / 2) == pytest.approx(0.3)


def test_friction_drifts_one_way_and_saturates(conceal):
    rig = conceal("friction_drift", 0.3, sign=1.0, saturation=0.4, walk_share=0.0)
    logs = np.log([rig.friction_factor(u) for u in np.linspace(0, 1, 2001)])
    assert logs[-1] - logs[0] == pytest.approx(0.3)
    assert np.all(np.diff(logs) > 0)
    assert logs[500] - logs[0] > 2 * (logs[-1] - logs[-501])
    assert logs.mean() == pytest.approx(0.0, abs=1e-4)


def test_the_walk_of_friction_is_that_of_brownian_motion(conceal, nominal):
    # Its variance at u is u; the series leaves out 1 / (pi^2 16) = 0.6 % of the sum at most.
    walks = []
    for seed in range(400):
        walk = np.random.default_rng(seed).normal(size=16).tolist()
        rig = conceal("friction_drift", 1.0, sign=1.0, saturation=1.0, walk_share=1.0, walk=walk)
        still = conceal("friction_drift", 1.0, sign=1.0, saturation=1.0, walk_share=0.0, walk=walk)
        ends = [np.log(r.friction_factor(1.0) / r.friction_factor(0.0)) for r in (rig, still)]
        walks.append(ends[0] - ends[1])
    assert np.var(walks) == pytest.approx(1.0, rel=6 * np.sqrt(2 / 400))


def test_without_anything_the_ground_is_even():
    assert push(EVEN, 0.3, 0.2, 1.0, 0.5, 2.0, 0.7) == (0.0, 0.0)
    assert rise(EVEN, 0.1) == weight(EVEN, 0.3, 0.2) == 1.0
