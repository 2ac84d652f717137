import re
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from slapshot.errors import InputError
from slapshot.lab.blade import compile_rig
from slapshot.lab.blade_truth import BladeTruth
from slapshot.lab.hit import TIMESTEP, RigSimulator
from slapshot.lab.hit_types import HitNoise, HitSpec

SOFT = BladeTruth(segments=3, stiffness=20.0, twist_stiffness=None, damping_ratio=0.1)
TWISTING = replace(SOFT, segments=4, twist_stiffness=60.0)
BLADES = [SOFT, TWISTING, replace(SOFT, segments=2)]
NOTHING = HitNoise(np.zeros(2), 1.0, np.zeros(7), 1.0)


def arm_inertia(model, pose):
    """(7, 7) in kg m^2; the arm's joints come first."""
    data = mujoco.MjData(model)
    data.qpos[:7] = pose
    mujoco.mj_forward(model, data)
    full = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, full)
    return full[:7, :7]


def blade_corners(model):
    """(2, 3) lowest and highest corner of all the blade's boxes in the frame of the blade's site."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    site = data.site("blade")
    rotation = site.xmat.reshape(3, 3)
    boxes = [i for i in range(model.ngeom) if model.geom(i).name.startswith("blade")]
    centre = np.array([rotation.T @ (data.geom_xpos[i] - site.xpos) for i in boxes])
    size = model.geom_size[boxes]
    return np.array([(centre - size).min(0), (centre + size).max(0)])


@pytest.mark.parametrize("blade", BLADES)
def test_it_is_the_rigid_blade_as_long_as_it_does_not_bend(lab_scene, blade):
    rigid, flexible = lab_scene.compile(), compile_rig(lab_scene, blade, TIMESTEP)
    assert flexible.body_mass.sum() == pytest.approx(rigid.body_mass.sum(), rel=1e-12)
    for pose in (np.zeros(7), np.array([0.2, -0.4, 0.1, 1.4, -0.2, -1.2, 0.3])):
        assert arm_inertia(flexible, pose) == pytest.approx(arm_inertia(rigid, pose), abs=1e-9)
    assert blade_corners(flexible) == pytest.approx(blade_corners(rigid), abs=1e-12)


@pytest.mark.parametrize("blade", BLADES)
def test_every_segment_touches_the_object_as_the_rigid_blade_does(lab_scene, blade):
    rigid, flexible = lab_scene.compile(), compile_rig(lab_scene, blade, TIMESTEP)
    expected = rigid.pair(lab_scene.info.striker_pair).id
    touching = set()
    for i in range(flexible.npair):
        ids = int(flexible.pair_geom1[i]), int(flexible.pair_geom2[i])
        names = [flexible.geom(number).name for number in ids]
        if "board" in names:
            continue
        assert names[1] == "puck"  # the frame of a contact points from the first to the second
        touching.add(names[0])
        for field in ("dim", "friction", "solref", "solimp", "solreffriction", "margin", "gap"):
            values = (getattr(m, f"pair_{field}") for m in (flexible, rigid))
            assert np.array_equal(next(values)[i], next(values)[expected]), field
    assert touching == {"blade", *(f"blade_{i}" for i in range(1, blade.segments))}


@pytest.mark.parametrize("blade", BLADES)
def test_springs_in_series_yield_like_one(lab_scene, blade):
    # A moment M on the free end turns it by M / k against the stick, however many hinges there are. The
    # arm holds still: its servos are at rest and gravity is compensated. Damping ends after 0.2 s.
    model = compile_rig(lab_scene, blade, TIMESTEP)
    data = mujoco.MjData(model)
    moment = 0.3
    end = model.body(f"blade_{blade.segments - 1}").id
    for effect, axis, stiffness in (("bend", 1, blade.stiffness), ("twist", 2, blade.twist_stiffness)):
        if stiffness is None:
            continue
        mujoco.mj_resetData(model, data)
        for _ in range(round(0.2 / model.opt.timestep)):
            data.xfrc_applied[end, 3:] = moment * data.xmat[end].reshape(3, 3)[:, axis]
            mujoco.mj_step(model, data)
        hinges = [f"blade_{effect}_{i}" for i in range(1, blade.segments)]
        turned = sum(data.joint(name).qpos[0] for name in hinges)
        # Tolerance: cosines of the angles in between, 1 - cos(0.015), and rounding of what still moves.
        assert turned == pytest.approx(moment / stiffness, rel=2e-3)


def test_the_free_end_yields_backwards(lab_scene):
    # Pushed against its face (along the site's -x), as an object does that is hit.
    model = compile_rig(lab_scene, SOFT, TIMESTEP)
    data = mujoco.MjData(model)
    end = model.body("blade_2").id
    for _ in range(round(0.2 / model.opt.timestep)):
        data.xfrc_applied[end, :3] = -5.0 * data.site("blade").xmat.reshape(3, 3)[:, 0]
        mujoco.mj_step(model, data)
    frame = data.site("blade").xmat.reshape(3, 3)
    moved = frame.T @ (data.geom("blade_2").xpos - data.site("blade").xpos)
    assert moved[0] < -1e-4


def test_stiffness_without_end_is_the_rigid_blade(lab_scene, motions, plain_rig):
    # What is left at 800 N m/rad is the slack of its springs, F l^2 / k = 20 N (0.03 m)^2 / 800 = 0.02 mm
    # against the 3 mm of the contact, and that two segments' contacts hop otherwise than one's: 3 %.
    def travels(blade):
        bench = RigSimulator(lab_scene, replace(plain_rig, blade=blade))
        rests = [bench.hit(motion, "puck", NOTHING).rest[0] for motion in motions[:3]]
        return np.array(rests) - lab_scene.info.start[0]

    rigid = travels(None)
    differences = [
        np.abs(travels(replace(SOFT, stiffness=k)) / rigid - 1).max() for k in (20.0, 100.0, 800.0)
    ]
    assert differences[0] > differences[1] > differences[2]
    assert differences[0] > 0.1
    assert differences[2] < 0.03


def test_a_blade_that_is_rigid_until_it_is_near_strikes_as_one_that_always_bends(
    lab_scene, motions, plain_rig
):
    strokes = [HitSpec(motion, "puck", NOTHING) for motion in motions[:8]]
    bench, whole = (RigSimulator(lab_scene, replace(plain_rig, blade=SOFT)) for _ in range(2))
    assert bench._free is not bench._contact
    whole._free = whole._contact
    fast, slow = bench.launches(strokes), whole.launches(strokes)
    for here, there in zip(fast, slow, strict=True):
        # The arm: an Euler step h of 0.07 ms lags by h / 2 of its motion, at most 2 rad/s.
        assert here.joints.shape == there.joints.shape
        assert np.abs(here.joints - there.joints).max() < 1e-4
        # Nothing has moved before the blade bends, 30 ms before it strikes.
        struck = np.argmax(np.hypot(*(there.track[:, :2] - there.track[0, :2]).T) > 1e-5)
        assert np.allclose(here.track[: struck - 2], there.track[: struck - 2], atol=1e-5)
    # Launches: where the object hops from depends on the last digit; in the mean nothing shifts.
    change = np.array([f.state[3] - s.state[3] for f, s in zip(fast, slow, strict=True)])
    speed = np.mean([s.state[3] for s in slow])
    assert abs(change.mean()) < 0.01 * speed
    assert np.abs(change).max() < 0.05 * speed


def test_a_null_rig_is_the_scene(lab_scene):
    nominal, null = lab_scene.compile(TIMESTEP), compile_rig(lab_scene, None, TIMESTEP)
    sizes = [mujoco.mj_sizeModel(m) for m in (nominal, null)]
    first, second = (np.zeros(n, np.uint8) for n in sizes)
    mujoco.mj_saveModel(nominal, None, first)
    mujoco.mj_saveModel(null, None, second)
    assert np.array_equal(first, second)


def test_what_cannot_be_cut_is_refused(lab_scene):
    with pytest.raises(InputError, match="at least 2"):
        compile_rig(lab_scene, replace(SOFT, segments=1), TIMESTEP)
    with pytest.raises(InputError, match="less stiffness"):
        compile_rig(lab_scene, replace(SOFT, stiffness=1e5), TIMESTEP)
    capsule = re.sub(r'(<geom name="blade"[^>]*)type="box"', r'\1type="ellipsoid"', lab_scene.xml)
    assert capsule != lab_scene.xml
    with pytest.raises(InputError, match="not a box"):
        compile_rig(replace(lab_scene, xml=capsule), SOFT, TIMESTEP)
