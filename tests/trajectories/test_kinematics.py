import mujoco
import numpy as np
import pytest
from slapshot.errors import InputError
from slapshot.trajectories.kinematics import Kinematics
from slapshot.trajectories.safety import SafetyCheck

BRANCHED = """
<mujoco>
  <worldbody>
    <body name="rail" pos="0.1 0.2 0.3" euler="20 0 30">
      <joint name="along" type="slide" axis="1 2 0" pos="0.3 0 0" ref="0.2"/>
      <joint name="about" axis="0 1 1" pos="0 0.1 0.2" ref="0.4"/>
      <geom size="0.1"/>
      <body name="left" pos="0.4 0 0"><joint name="bend" axis="0 0 1" pos="0.1 0 0"/><geom size="0.1"/></body>
      <body name="right" pos="0 0.4 0" euler="0 50 0"><joint name="held"/><geom size="0.1"/></body>
    </body>
  </worldbody>
</mujoco>"""


def frames(model, joints, positions, body):
    """(n, 3) and (n, 3, 3) of one body, by MuJoCo."""
    data, places, turns = mujoco.MjData(model), [], []
    for row in positions:
        for name, value in zip(joints, row, strict=True):
            data.qpos[model.joint(name).qposadr[0]] = value
        mujoco.mj_kinematics(model, data)
        places.append(data.xpos[body].copy())
        turns.append(data.xmat[body].reshape(3, 3).copy())
    return np.array(places), np.array(turns)


@pytest.mark.parametrize("names", [["blade"], ["link5", "link7", "blade"], ["link7"]])
def test_frames_of_the_arm_are_those_of_mujoco(scene, names):
    model, joints = scene.compile(), list(scene.info.joints)
    bodies = [model.body(name).id for name in names]
    kinematics = Kinematics(model, bodies, joints)
    positions = np.random.default_rng(0).uniform(-2, 2, (50, len(joints)))
    places, turns = kinematics.poses(positions)
    for body in bodies:
        place, turn = frames(model, joints, positions, body)
        # Nine bodies within 2 m, a few roundings of 1e-16 each.
        assert places[:, kinematics.row(body)] == pytest.approx(place, abs=1e-13)
        assert turns[:, kinematics.row(body)] == pytest.approx(turn, abs=1e-13)


def test_slides_branches_references_and_joints_that_are_held():
    model = mujoco.MjModel.from_xml_string(BRANCHED)
    joints = ["bend", "along", "about"]
    bodies = [model.body(name).id for name in ("left", "right")]
    kinematics = Kinematics(model, bodies, joints)
    positions = np.random.default_rng(1).normal(size=(20, 3))
    places, turns = kinematics.poses(positions)
    for body in bodies:
        place, turn = frames(model, joints, positions, body)
        assert places[:, kinematics.row(body)] == pytest.approx(place, abs=1e-13)
        assert turns[:, kinematics.row(body)] == pytest.approx(turn, abs=1e-13)


def test_a_free_body_is_refused():
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><body><freejoint/><geom size='0.1'/></body></worldbody></mujoco>"
    )
    with pytest.raises(InputError, match="neither a hinge nor a slide"):
        Kinematics(model, [1], [])


def test_clearance_is_that_of_the_lowest_point(scene, rig):
    # Of the corners of the blade, carried along by MuJoCo; nothing else of the arm comes as low.
    model = scene.compile()
    data = mujoco.MjData(model)
    check = SafetyCheck(scene)
    motion = rig.model.motion(np.zeros(rig.model.sizes.latent))
    positions = motion.position(np.linspace(0, motion.duration, 81))
    corners = np.stack(np.meshgrid(*[[-1, 1]] * 3), -1).reshape(-1, 3)
    lowest = np.inf
    for q in positions:
        data.qpos[scene.layout.arm_q] = q
        mujoco.mj_kinematics(model, data)
        blade = model.geom("blade").id
        points = (
            data.geom_xpos[blade] + corners * model.geom_size[blade] @ data.geom_xmat[blade].reshape(3, 3).T
        )
        lowest = min(lowest, points[:, 2].min())
    assert check.report(motion).clearance == pytest.approx(lowest, abs=1e-12)
