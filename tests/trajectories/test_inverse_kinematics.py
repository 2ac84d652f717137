"""Poses of the blade, solved for all at once, and by dm_control one by one."""

import mujoco
import numpy as np
import pytest
from dm_control import mujoco as dm_mujoco
from dm_control.utils import inverse_kinematics as reference
from slapshot.domains.hockey.demonstrations import SEED_POSE
from slapshot.errors import InputError
from slapshot.trajectories.inverse_kinematics import InverseKinematics
from slapshot.trajectories.kinematics import Kinematics, matrix

TOLERANCE = 1e-6  # m plus rad, of a pose


@pytest.fixture(scope="module")
def arm(scene):
    model = scene.compile()
    site = model.site(scene.info.striker_site).id
    return model, site, InverseKinematics(model, site, list(scene.info.joints))


def poses(model, site, joints, positions):
    body = int(model.site_bodyid[site])
    kinematics = Kinematics(model, [body], joints)
    places, turns = kinematics.poses(positions)
    place, turn = places[:, kinematics.row(body)], turns[:, kinematics.row(body)]
    return place + turn @ model.site_pos[site], turn @ matrix(model.site_quat[site])


def far_and_near(joints: int, count: int = 24):
    rng = np.random.default_rng(1)
    spread = np.repeat([0.02, 0.5], count // 2)[:, None]
    return np.array(SEED_POSE) + spread * rng.normal(size=(count, joints))


def test_a_pose_that_is_reached_is_the_one_asked_for(scene, arm):
    model, site, solver = arm
    joints = list(scene.info.joints)
    wanted = far_and_near(len(joints))
    start = np.tile(SEED_POSE, (len(wanted), 1))
    places, turns = poses(model, site, joints, wanted)
    found, reached = solver.solve(start, places, turns)
    assert reached[:12].all()
    assert reached.sum() > 20
    here, turned = poses(model, site, joints, found[reached])
    assert here == pytest.approx(places[reached], abs=TOLERANCE)
    assert turned == pytest.approx(turns[reached], abs=TOLERANCE)


def test_solutions_are_those_of_dm_control(scene, arm, monkeypatch):
    """Both with the shortest step: dm_control's own has rounding errors where a pose leaves a joint free."""

    def shortest(jacobian, error, regularization_strength=0.0):
        if regularization_strength:
            return plain(jacobian, error, regularization_strength)
        return np.linalg.lstsq(jacobian, error, rcond=None)[0]

    plain = reference.nullspace_method
    monkeypatch.setattr(reference, "nullspace_method", shortest)
    model, site, solver = arm
    joints = list(scene.info.joints)
    places, turns = poses(model, site, joints, far_and_near(len(joints)))
    start = np.tile(SEED_POSE, (len(places), 1))
    found, reached = solver.solve(start, places, turns)
    physics = dm_mujoco.Physics.from_xml_string(scene.xml)
    for k, (place, turn) in enumerate(zip(places, turns, strict=True)):
        quaternion = np.empty(4)
        mujoco.mju_mat2Quat(quaternion, turn.ravel())
        physics.data.qpos[:] = 0
        physics.data.qpos[: len(joints)] = SEED_POSE
        own = reference.qpos_from_site_pose(
            physics, scene.info.striker_site, place, quaternion, joint_names=joints, tol=TOLERANCE
        )
        assert own.success == reached[k]
        if own.success:
            assert found[k] == pytest.approx(own.qpos[: len(joints)], abs=1e-6)


def test_a_pose_out_of_reach_is_told_and_the_others_are_solved(scene, arm):
    model, site, solver = arm
    joints = list(scene.info.joints)
    places, turns = poses(model, site, joints, far_and_near(len(joints), 4))
    places[1] += [5.0, 0.0, 0.0]
    _, reached = solver.solve(np.tile(SEED_POSE, (4, 1)), places, turns)
    assert reached[0]
    assert not reached[1]


def test_what_is_no_arm_of_hinges_is_refused():
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><body><joint name='a' type='slide'/><geom size='.1'/><site name='tip'/></body>"
        "</worldbody></mujoco>"
    )
    with pytest.raises(InputError, match="must be hinges, one on each body"):
        InverseKinematics(model, 0, ["a"])
