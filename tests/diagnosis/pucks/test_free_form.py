"""Free forms of launches, and the contact that they stand on."""

import mujoco
import numpy as np
import pytest
from slapshot.diagnosis.pucks.launch.contact_features import approach_of
from slapshot.diagnosis.pucks.launch.on_the_way import OnTheWay
from slapshot.diagnosis.pucks.selection.free_form import (
    FREE_FORMS,
    FreeArm,
    FreeContact,
    FreeLaunchForm,
    FreePlaceForce,
    NominalLaunches,
)
from slapshot.effects.effect import ARM_JOINTS
from slapshot.effects.place_friction import PlaceFriction
from slapshot.effects.tilt import Tilt
from slapshot.effects.uneven_board import UnevenBoard


@pytest.fixture
def rng():
    return np.random.default_rng(4)


def nominal(rng, count=30, joints=ARM_JOINTS, turned_by=0.0):
    heading, speed = rng.uniform(-1, 1, count) + turned_by, rng.uniform(1, 2, count)
    velocity = speed[:, None] * np.stack([np.cos(heading), np.sin(heading)], axis=1)
    simulated = np.column_stack([rng.normal(size=(count, 2)), velocity, rng.normal(size=count)])
    return NominalLaunches(simulated, rng.normal(size=(count, 5, 2 * joints)), rng.normal(size=(count, 2)))


@pytest.mark.parametrize(
    "form", [f for f in FREE_FORMS if isinstance(f, FreeLaunchForm)], ids=lambda f: f.name
)
def test_each_parameter_of_a_form_of_launches_does_something_of_its_own(rng, form):
    basis = form.basis(nominal(rng))
    assert basis.shape == (30, 5, len(form.parameters))
    assert np.linalg.matrix_rank(basis.reshape(150, -1)) == len(form.parameters)


def test_a_curved_face_lies_within_the_form_of_the_contact(rng):
    """A face whose normal turns with the offset from its middle: launches turn in proportion to both."""
    of = nominal(rng)
    heading = np.arctan2(of.simulated[:, 3], of.simulated[:, 2])
    speed = np.hypot(*of.simulated[:, 2:4].T)
    turn = 0.3 * of.approach[:, 0]
    change = np.zeros((30, 5))
    change[:, 2], change[:, 3] = -np.sin(heading) * turn * speed, np.cos(heading) * turn * speed
    basis = FreeContact().basis(of).reshape(150, -1)
    weights, *_ = np.linalg.lstsq(basis, change.ravel(), rcond=None)
    np.testing.assert_allclose(basis @ weights, change.ravel(), atol=1e-10)


def test_an_arm_of_fewer_joints_leaves_the_rest_without_a_change(rng):
    of = nominal(rng, joints=3)
    basis = FreeArm().basis(of)
    np.testing.assert_array_equal(basis[..., :3], of.by_joints[..., :3])
    np.testing.assert_array_equal(basis[..., ARM_JOINTS : ARM_JOINTS + 3], of.by_joints[..., 3:])
    assert not basis[..., 3:ARM_JOINTS].any()
    assert not basis[..., ARM_JOINTS + 3 :].any()


def test_the_approach_is_that_of_the_face_as_it_moves(rng, scene):
    """Offset and direction of motion by poses a moment apart, the object on the face."""
    info, model = scene.info, scene.compile()
    data = mujoco.MjData(model)
    angles = [model.joint(name).qposadr[0] for name in info.joints]
    q, dq = rng.uniform(-0.5, 0.5, len(angles)), rng.uniform(-1, 1, len(angles))

    def face(at):
        data.qpos[angles] = at
        mujoco.mj_kinematics(model, data)
        return data.site(info.striker_site).xpos.copy(), data.site(info.striker_site).xmat.reshape(
            3, 3
        ).copy()

    place, turned = face(q)
    normal = turned[:2, 0] / np.linalg.norm(turned[:2, 0])
    along = np.array([-normal[1], normal[0]])
    # A point of a body that turns about the vertical with the face, level with its middle.
    step = 1e-6
    ahead, turned_ahead = face(q + step * dq)
    behind, turned_behind = face(q - step * dq)
    spin = (turned_ahead - turned_behind) @ turned.T / (2 * step)  # the matrix of the angular velocity
    velocity = (ahead - behind)[:2] / (2 * step) + spin[1, 0] * np.array([-along[1], along[0]]) * 0.02
    start = place[:2] + 0.05 * normal + 0.02 * along
    (offset, angle), (other, _) = approach_of(
        scene, np.stack([q, q]), np.stack([dq, dq]), np.stack([start, start + 0.01 * along])
    )
    assert offset == pytest.approx(0.02, abs=1e-9)
    assert other == pytest.approx(0.03, abs=1e-9)
    assert angle == pytest.approx(np.arctan2(along @ velocity, normal @ velocity), abs=1e-6)


def test_what_slides_linearly_moves_launches_on_the_way_by_its_shapes(rng):
    launches = np.column_stack(
        [rng.uniform(0.8, 1.2, (6, 2)), rng.uniform(0.5, 1.5, (6, 2)), rng.normal(size=6)]
    )
    friction = np.tile([0.4, 0.4, 0.008], (6, 1))
    way = OnTheWay(launches, rng.uniform(0.02, 0.05, 6), np.zeros(6), friction)
    for effect in (UnevenBoard(), PlaceFriction(), FreePlaceForce()):
        names = [p.name for p in effect.parameters if effect.reaches(p.name, launches[:, :2])]
        step = 1e-4 * effect.parameters[0].scale
        neutral = effect.neutral()
        expected = [way.shift([(effect, {**neutral, n: step})], friction) / step for n in names]
        np.testing.assert_allclose(
            way.by_shapes(effect, names), np.stack(expected, axis=-1), rtol=1e-3, atol=1e-9
        )
    assert way.by_shapes(Tilt(), ["slope_x"]) is None
