"""Launches of objects that hop, as launches of objects that slide: in closed form, and against MuJoCo."""

import mujoco
import numpy as np
import pytest
from slapshot.arrays import GRAVITY
from slapshot.diagnosis.pucks.launch.approach import resting_height
from slapshot.diagnosis.pucks.launch.strikes import _as_if_sliding

LATER = 0.2  # s: it has landed, and still moves
SPEED, PLACE = np.array([1.6, 0.9]), np.array([0.3, 0.2])
HOPS = [(1e-3, 0.0), (2e-4, 0.1), (1.5e-3, -0.08), (0.0, 0.05)]  # m above rest, and m/s upwards


def told(height: float, rising: float, friction: np.ndarray) -> np.ndarray:
    launches = np.array([[*PLACE, *SPEED, 0.3]])
    return _as_if_sliding(launches, np.array([height]), np.array([rising]), friction[None])[0]


@pytest.mark.parametrize(("height", "rising"), HOPS)
def test_it_flies_is_slowed_by_the_landing_and_slides(height, rising):
    mu = 0.4
    landing = np.sqrt(rising**2 + 2 * GRAVITY * height)  # m/s downwards
    flight = (rising + landing) / GRAVITY
    along = SPEED / np.linalg.norm(SPEED)
    after, slides = SPEED - mu * landing * along, LATER - flight
    place = PLACE + SPEED * flight + after * slides - mu * GRAVITY * along * slides**2 / 2
    x, y, vx, vy, spin = told(height, rising, np.array([mu, mu]))
    assert [vx, vy] - mu * GRAVITY * along * LATER == pytest.approx(after - mu * GRAVITY * along * slides)
    assert [x, y] + np.array([vx, vy]) * LATER - mu * GRAVITY * along * LATER**2 / 2 == pytest.approx(place)
    assert spin == 0.3


def test_what_lies_on_the_board_or_does_not_move_stays_as_it_is():
    friction = np.array([[0.4, 0.3]])
    for launches in ([[*PLACE, *SPEED, 0.3]], [[*PLACE, 0.0, 0.0, 0.0]]):
        for height in (0.0, -1e-5):  # contacts give way
            same = _as_if_sliding(np.array(launches), np.array([height]), np.zeros(1), friction)
            np.testing.assert_array_equal(same, launches)


@pytest.mark.parametrize(("height", "rising"), HOPS)
def test_speeds_are_those_of_mujoco(scene, height, rising):
    model = scene.compile(5e-5)
    info, data = scene.info, mujoco.MjData(model)
    q = [model.joint(name).qposadr[0] for name in info.object_joints]
    v = [model.joint(name).dofadr[0] for name in info.object_joints]
    mu_y, mu_x = model.pair_friction[model.pair(info.object_pair).id, :2]
    # Apart from the arm, where nothing but the board acts on it.
    data.qpos[q] = *PLACE, resting_height(model, info) + height, 0.0
    data.qvel[v] = *SPEED, rising, 0.0
    mujoco.mj_step(model, data, round(LATER / model.opt.timestep))
    launch = told(height, rising, np.array([mu_x, mu_y]))[2:4]
    still = data.qvel[v[2]]  # m/s upwards: a contact of points never quite comes to rest
    slowed = np.array([mu_x, mu_y]) * (GRAVITY * LATER + still) * launch / np.linalg.norm(launch)
    # While it bounces on such contacts friction is a little off.
    assert data.qvel[v[:2]] == pytest.approx(launch - slowed, abs=0.009)
