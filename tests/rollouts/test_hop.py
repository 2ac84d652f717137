import mujoco
import numpy as np
import pytest
from slapshot.arrays import GRAVITY
from slapshot.rollouts.hop import hop
from slapshot.rollouts.slide import slide
from slapshot.scenes.scene import set_condition

R = 0.0381


def one(velocity, spin, height, rising, friction):
    states, times = hop(
        np.array([[0.3, 0.1, 0.2, *velocity, spin]]), np.array([height]), np.array([rising]), [friction], R
    )
    return states[0], times[0]


def test_flight_is_a_parabola():
    # Where nothing rubs, only place and time tell that it flew: h + u t - g t^2 / 2 = 0.
    state, time = one((1.2, -0.3), 4.0, 0.02, 0.5, (1e-9, 1e-9, 0.0))
    assert 0.02 + 0.5 * time - GRAVITY * time**2 / 2 == pytest.approx(0, abs=1e-12)
    assert time > 0.1
    assert state[:3] == pytest.approx([0.3 + 1.2 * time, 0.1 - 0.3 * time, 0.2 + 4.0 * time])
    assert state[3:] == pytest.approx([1.2, -0.3, 4.0], rel=1e-6)


@pytest.mark.parametrize("axis", [0, 1])
def test_landing_takes_friction_times_what_the_fall_presses(axis):
    # m w upwards, mu m w backwards, w^2 = u^2 + 2 g h. Heun's method is exact where nothing turns.
    friction = (0.3, 0.42, 0.005)
    state, _ = one(np.eye(2)[axis] * 1.5, 0.0, 0.03, 0.4, friction)
    fall = np.sqrt(0.4**2 + 2 * GRAVITY * 0.03)
    assert state[3 + axis] == pytest.approx(1.5 - friction[axis] * fall, rel=1e-9)
    assert abs(state[4 - axis]) < 1e-12


def test_landing_takes_spin():
    # Every point slips with R w: m w sqrt(mu^2 R^2 + mu_t^2) over the inertia m R^2 / 2.
    mu, mu_t, fall = 0.4, 0.01, 0.3
    state, time = one((0.0, 0.0), 25.0, 0.0, -fall, (mu, mu, mu_t))
    assert time == 0
    assert state[5] == pytest.approx(25.0 - fall * np.hypot(R * mu, mu_t) / (R**2 / 2), rel=1e-6)


def test_a_landing_that_takes_everything_stops_the_object():
    state, _ = one((0.05, 0.02), 0.3, 0.0, -1.0, (0.5, 0.4, 0.005))
    assert np.linalg.norm(state[3:] * [1, 1, R]) < 2e-3


def test_what_comes_down_at_once_is_the_limit_of_small_hops():
    still, _ = one((1.0, 0.2), 2.0, 0.0, 0.0, (0.4, 0.3, 0.01))
    assert still == pytest.approx([0.3, 0.1, 0.2, 1.0, 0.2, 2.0], abs=1e-15)
    pressed, time = one((1.0, 0.2), 2.0, -1e-4, 0.0, (0.4, 0.3, 0.01))
    assert time == 0
    assert pressed == pytest.approx(still, abs=1e-15)


@pytest.mark.parametrize("rising", [0.05, 0.2, 0.5, 0.8])
@pytest.mark.parametrize("mass", [0.015, 0.09])
def test_against_mujoco(scene, rising, mass):
    # A tenth of the scene's step, so that what is left is the law. MuJoCo's object bounces several times
    # where this one lands once; both come to rest at the same place (to 0.03 mm when written) without spin,
    # which MuJoCo's contacts treat otherwise (see rollouts.slide).
    friction = {"friction_x": 0.35, "friction_y": 0.35, "friction_torsional": 0.004, "friction_rolling": 0.1}
    model, layout = scene.compile(5e-5), scene.layout
    set_condition(model, layout, {"mass": mass, **friction})
    data = mujoco.MjData(model)
    data.qpos[layout.object_q[0]] = 5.0
    mujoco.mj_step(model, data, 4000)
    data.qpos[layout.object_q[2]] += 1e-4  # off the plane, which pushes what rubs on it
    begin = data.qpos[layout.object_q].copy()
    data.qvel[layout.object_v] = [1.3, 0.4, rising, 0.0]
    heights, pushed = np.zeros((2, 16_000))
    for i in range(len(heights)):
        mujoco.mj_step(model, data)
        heights[i] = data.qpos[layout.object_q[2]]
        # m (g t + w - u) upwards, and mu times that backwards, bounces or not.
        up = GRAVITY * (i + 1) * model.opt.timestep + data.qvel[layout.object_v[2]] - rising
        pushed[i] = np.hypot(1.3, 0.4) - np.hypot(*data.qvel[layout.object_v[:2]]) - 0.35 * up
        if np.hypot(*data.qvel[layout.object_v[:2]]) < 0.02:
            break
    assert np.abs(pushed[: i + 1]).max() < 1e-3 * 1.36
    mujoco.mj_step(model, data, 4000)
    moved = data.qpos[layout.object_q[:2]] - begin[:2]
    law = np.array([[0.35, 0.35, 0.004]])
    state = np.array([[0.0, 0.0, 0.0, 1.3, 0.4, 0.0]])
    landed, time = hop(state, begin[2:3], np.array([rising]), law, R)
    flying = heights[: round(time[0] / model.opt.timestep)]
    assert flying.max() == pytest.approx(begin[2] + rising**2 / 2 / GRAVITY, rel=0.01)
    rest, _ = slide(landed, law, R)
    assert rest[0, :2] == pytest.approx(moved, abs=2e-4)
    # The same object let lie flat at once ends elsewhere, by what flying and landing do.
    flat, _ = slide(state, law, R)
    assert np.linalg.norm(flat[0, :2] - moved) > 0.02 * rising
