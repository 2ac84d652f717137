import mujoco
import numpy as np
from slapshot.arrays import GRAVITY
from slapshot.rollouts.reach import first_within, has_parted

HALF, RADIUS, HEIGHT = 0.006, 0.0381, 0.0254


def moving(speed, ticks, period, lean=0.0):
    """(1, ticks, 3) striker and normal of a face that goes along x and leans by `lean` rad."""
    striker = np.zeros((1, ticks, 3))
    striker[0, :, 0] = speed * period * np.arange(ticks)
    normal = np.tile([np.cos(lean), 0.0, np.sin(lean)], (1, ticks, 1))
    return striker, normal


def test_nothing_touches_before_the_plane_does(scene, rig):
    # MuJoCo's own distance of blade and puck, where no puck moves.
    model, layout, info = scene.compile(), scene.layout, scene.info
    data, swings = mujoco.MjData(model), rig.swings
    blade, puck = (model.geom(name).id for name in ("blade", "puck"))
    rng = np.random.default_rng(0)
    window = swings.positions.shape[1]
    reached = 0
    for swing in rng.integers(0, len(swings.latents), 12):
        error = rng.normal(0, 0.02, 2)
        middle = np.array([[*(error + info.start), info.object_height / 2]])
        tick = first_within(
            np.array([swing]), swings.first, window, swings.striker, swings.normal, middle,
            info.striker_half_thickness, info.object_radius, info.object_height, 0.0,
        )[0]  # fmt: skip
        row = tick - swings.first[swing]
        distances = []
        for k in range(row + 3 if row < window - 3 else row):
            data.qpos[layout.arm_q] = swings.positions[swing, k]
            data.qpos[layout.object_q[:2]] = error
            mujoco.mj_kinematics(model, data)
            distances.append(mujoco.mj_geomDistance(model, data, blade, puck, 1.0, None))
        assert min(distances[:row]) > 0
        # A face that comes up in full height reaches it within the next two ticks.
        reached += min(distances) < 1e-4
    assert reached >= 9


def test_an_object_that_is_faster_has_parted_and_one_that_will_be_caught_has_not():
    # The striker does 1 m/s for a second. The object leaves it at v and is slowed at mu g: they meet at
    # t = 2 (v - 1) / (mu g), if that is before the second is over.
    period, mu = 1e-3, 0.4
    striker, normal = moving(1.0, 1000, period)

    def parted(speed, falling=0.0, margin=0.001):
        states = np.array([[0.01 + HALF + RADIUS, 0.0, 0.0, speed, 0.0, 0.0]])
        return has_parted(
            np.zeros(1, int), np.zeros(1, int), period, striker, normal, states, np.array([falling]),
            np.array([mu]), HALF + RADIUS, margin, 5,
        )[0]  # fmt: skip

    # Slowed all the way to rest at v^2 / (2 mu g), which must be beyond the striker's end at 1 m.
    least = np.sqrt(2 * mu * GRAVITY * 0.99)
    assert least > 2
    assert not parted(0.98 * least)
    assert parted(1.02 * least)
    assert not parted(1.02 * least, margin=0.1)
    # What a fall presses costs mu w at once.
    assert not parted(1.02 * least, falling=0.03 * least / mu)


def test_an_object_that_goes_the_other_way_is_caught():
    striker, normal = moving(1.0, 100, 1e-3)
    states = np.array([[0.3, 0.0, 0.0, -4.0, 0.0, 0.0]])
    found = has_parted(
        np.zeros(1, int), np.zeros(1, int), 1e-3, striker, normal, states, np.zeros(1), np.full(1, 0.3),
        HALF + RADIUS, 0.001, 5,
    )  # fmt: skip
    assert not found[0]


def test_a_face_that_leans_forward_comes_nearer_at_the_foot():
    # The cylinder's edge towards the face is lower than the middle by half its height times sin(lean).
    for lean in (-0.2, 0.0, 0.2):
        striker, normal = moving(1.0, 1000, 1e-3, lean)
        middle = np.array([[0.5, 0.0, 0.01]])
        tick = first_within(
            np.zeros(1, int), np.zeros(1, int), 1000, striker, normal, middle, HALF, RADIUS, HEIGHT, 0.0
        )[0]
        # (0.5 - x) cos + 0.01 sin = half thickness + R cos + H / 2 |sin|.
        towards = HALF + RADIUS * np.cos(lean) + HEIGHT / 2 * abs(np.sin(lean))
        expected = 0.5 - (towards - 0.01 * np.sin(lean)) / np.cos(lean)
        assert 0 <= tick * 1e-3 - expected < 1.001e-3
