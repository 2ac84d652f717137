"""Models that are written with effects in them: what they compile to, hold and say."""

import copy

import mujoco
import numpy as np
import pytest
from slapshot.arrays import Array
from slapshot.diagnosis.augmented import augmented_model, forces, write_augmented
from slapshot.diagnosis.model.hypothesis import Hypothesis
from slapshot.diagnosis.model.rig import bind
from slapshot.diagnosis.model.structure import restructured
from slapshot.effects.joints.effect import JointEffect, overrides
from slapshot.errors import InputError

from .rigs import RigSimulator, arm, bench, few, has_note, one_sd, pendulum, reads, slide, tells

# Depend on sensors, or on the order in which bounding boxes were put into trees.
_OTHER = ("sensor", "stat", "bvh")


def assert_same(model: mujoco.MjModel, other: mujoco.MjModel) -> None:
    """Every floating-point array and the gravity agree to rounding."""
    compared = 0
    for name in dir(model):
        if name.startswith(("_", *_OTHER)):
            continue
        a, b = getattr(model, name), getattr(other, name, None)
        if isinstance(a, np.ndarray) and a.dtype == float and a.size:
            assert np.allclose(a, b, rtol=1e-9, atol=1e-12), (name, np.abs(a - b).max())
            compared += 1
    assert compared > 30
    assert np.array_equal(model.actuator_forcelimited, other.actuator_forcelimited)
    assert model.opt.gravity == pytest.approx(other.opt.gravity, abs=1e-12)


def from_text(spec: mujoco.MjSpec) -> mujoco.MjModel:
    """Of the XML of a specification."""
    return mujoco.MjModel.from_xml_string(spec.to_xml())


def compiled(of: RigSimulator, effects: list[JointEffect], theta: Array) -> mujoco.MjModel:
    """As the engine simulates it, at the user's time step."""
    return Hypothesis(of.rig, tuple(effects)).compiled(theta, of.rig.model.opt.timestep)


def test_the_written_model_has_the_numbers_of_the_engine(any_bench):
    for effect in few(any_bench):
        values = one_sd(effect)
        spec, notes = augmented_model(any_bench.rig, [effect], values)
        edited = compiled(any_bench, [effect], values)
        assert_same(spec.compile(), edited)
        assert_same(from_text(spec), edited)
        assert len(notes) == has_note(effect)
        if not overrides(effect, "edit"):
            assert_same(edited, any_bench.rig.model)


def test_the_rig_keeps_its_own_model():
    of = arm()
    before = of.rig.spec.to_xml()
    augmented_model(of.rig, few(of)[:20], np.concatenate([one_sd(e) for e in few(of)[:20]]))
    assert of.rig.spec.to_xml() == before


def test_many_effects_at_once():
    of = arm()
    effects = list({e.name: e for e in few(of)}.values())
    theta = np.concatenate([one_sd(e) for e in effects])
    spec, notes = augmented_model(of.rig, effects, theta)
    assert_same(from_text(spec), compiled(of, effects, theta))
    assert len(notes) == len(set(notes)) >= 8


LINK = """<worldbody><body name="a"><joint name="j" axis="0 1 0" ref="10" {}/>
  <inertial pos=".1 0 -.2" mass="2" fullinertia=".1 .12 .05 .01 0 .02"/><geom size=".05" pos="0 0 -.3"/>
  <body name="b" pos="0 0 -.5"><joint name="k" axis="0 1 0" range="-40 90"/>
  <geom name="g" type="capsule" fromto="0 0 0 .3 0 0" size=".03"/><body name="tip" pos=".3 0 0">
  <geom size=".04"/></body></body></body></worldbody>
  <actuator><position name="s" joint="j" kp="10" dampratio="1"/><motor name="m" joint="k"/></actuator>"""


@pytest.mark.parametrize(
    "around",
    [
        '<compiler angle="degree"/><default><joint damping=".3"/><position kp="2"/></default>{}',
        '<compiler settotalmass="5"/>{}',
        '<compiler inertiafromgeom="true"/>{}',
        '<compiler fusestatic="true"/>{}',
        '<compiler boundmass=".1" boundinertia=".01" balanceinertia="true" angle="radian"/>{}',
        '{}<equality><weld body1="b"/><connect body1="a" body2="b" anchor="0 0 -.5"/>'
        '<joint joint1="j" joint2="k"/></equality>',
        '{}<keyframe><key qpos=".1 .2"/></keyframe><tendon><fixed name="t" stiffness="2"><joint joint="j" '
        'coef="1"/></fixed></tendon>',
    ],
    ids=["defaults", "total mass", "from geoms", "fused", "bounds", "equalities", "keyframe"],
)
@pytest.mark.parametrize("joint", ["", 'springdamper=".1 1"'])
@pytest.mark.filterwarnings("ignore:compiler attribute")
def test_models_whose_compiler_derives_numbers(around, joint):
    channels = {"u": tells("s"), "w": tells("m"), "q": reads(joint="j"), "p": reads(joint="k")}
    of = bench(around.format(LINK.format(joint)), channels, commands=lambda t: [np.sin(9 * t), np.cos(5 * t)],
               seconds=0.1, episodes=1)  # fmt: skip
    chosen = [of.effect(name) for name in ("armature", "link_mass", "payload", "joint_offset", "saturation")]
    theta = np.concatenate([one_sd(e) for e in chosen])
    spec, _ = augmented_model(of.rig, chosen, theta)
    assert_same(from_text(spec), compiled(of, chosen, theta))


@pytest.mark.parametrize("make", [arm, pendulum])
def test_what_gives_way_is_written_with_plain_names(make, tmp_path):
    of = make()
    effects = [e for e in of.effects if overrides(e, "restructure")]
    assert {e.name for e in effects} == {"joint_elasticity", "backlash", "base_compliance"}
    for effect in effects:
        values = one_sd(effect)
        rig = restructured(of.rig, effect, of.channels)
        write_augmented(rig, [effect], values, tmp_path)
        model = mujoco.MjModel.from_xml_path(str(tmp_path / "model.xml"))
        edited = Hypothesis(rig, (effect,)).compiled(values, of.rig.model.opt.timestep)
        assert_same(model, edited)
        assert (
            model.joint(effect.added_joint.removeprefix("slapshot:")).id
            == edited.joint(effect.added_joint).id
        )
        text = (tmp_path / "model.xml").read_text() + (tmp_path / "NOTES.md").read_text()
        assert "slapshot" not in text
        assert ("the sum of joints" in text) == has_note(effect) == ("at the link" in effect.variant)


def test_force_laws_step_by_step_make_the_motion_of_the_engine(any_bench):
    """As a user would simulate them, with the written model."""
    step = any_bench.segments.step
    laws = [e for e in few(any_bench) if overrides(e, "force")]
    assert laws
    for effect in {e.name: e for e in laws}.values():
        values = one_sd(effect)
        motion = any_bench.moved(effect, *values)
        model = augmented_model(any_bench.rig, [effect], values)[0].compile()
        model.opt.timestep = step
        law = forces(any_bench.rig, [effect], values, order=any_bench.segments.order[0])
        data = mujoco.MjData(model)
        x = any_bench.start
        data.qpos[:], data.qvel[:] = x[: model.nq], x[model.nq : model.nq + model.nv]
        data.act[:] = x[model.nq + model.nv :]
        trajectory, count = [], any_bench.segments.shape[1]
        for told in any_bench.segments.controls[0]:
            trajectory.append(np.concatenate([data.qpos, data.qvel, data.act]))
            data.ctrl[:] = told
            data.qfrc_applied[:] = law(model, data)
            mujoco.mj_step(model, data)
        got = np.array(trajectory)[:: any_bench.segments.substeps][:count]
        # Dry friction is solved to a tolerance.
        assert got == pytest.approx(motion.x[0], abs=1e-5), effect.key


def test_effects_without_a_law_apply_no_force():
    of = arm()
    effect = of.effect("viscous_friction")
    data = mujoco.MjData(of.rig.model)
    assert np.array_equal(forces(of.rig, [effect], np.array([1.0]))(of.rig.model, data), np.zeros(2))


def test_the_files_hold_the_model_and_say_the_rest(tmp_path):
    of = slide()
    effects = [
        of.effect("viscous_friction", "rail"),
        of.effect("spring", "mast"),
        of.effect("actuator_gain", "mast"),
        of.effect("command_delay", "all actuators"),
    ]
    theta = np.array([2.5, 30.0, -4.0, 0.1, 0.0125])
    write_augmented(of.rig, effects, theta, tmp_path / "new" / "folder")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "new" / "folder" / "model.xml"))
    assert [model.actuator(i).name for i in range(model.nu)] == ["belt", "winch", "mast"]
    assert_same(model, compiled(of, effects, theta))
    text = (tmp_path / "new" / "folder" / "NOTES.md").read_text()
    middle = of.rig_motion.joints[1].middle
    assert text == (
        "# rig with what was found\n\nValues in model.xml:\n\n"
        "- viscous friction at rail: coefficient 2.5 N s/m\n"
        "- gain of actuator mast: excess 0.1\n"
        "\nMJCF cannot hold the rest; add it to your simulation:\n\n"
        f"- Apply as qfrc_applied at joint mast: -4 - 30 (q - {middle:.4g}) (in N; position q in m, "
        "velocity v in m/s).\n"
        "- Delay the controls of all actuators by 0.0125 s; before that time the first command holds.\n"
        "\nMotors that take the recorded torques were added: mast.\n"
    )
    # Written again, the files are replaced.
    write_augmented(of.rig, [], np.zeros(0), tmp_path / "new" / "folder")
    assert "- none\n" in (tmp_path / "new" / "folder" / "NOTES.md").read_text()


def test_friction_without_an_excess_at_low_speed_needs_no_note(tmp_path):
    of = slide()
    effect = of.effect("stribeck_friction", "rail")
    values = np.array([0.4, 0.0, 0.1])
    assert augmented_model(of.rig, [effect], values)[1] == []
    values[1] = 0.2
    (note,) = augmented_model(of.rig, [effect], values)[1]
    assert "-0.2 exp(" in note


def test_the_model_stays_as_its_author_wrote_it():
    of = bench(f'<default><joint damping=".3"/></default>{LINK.format("")}', {"q": reads(joint="j")},
               commands=lambda t: [np.sin(9 * t), 0 * t], seconds=0.1, episodes=1)  # fmt: skip
    spec, _ = augmented_model(of.rig, [of.effect("armature", "j")], np.array([0.0123456789012345]))
    text = spec.to_xml()
    assert '<position name="s" joint="j" kp="10"' in text
    assert 'fromto="0 0 0 0.3 0 0"' in text
    assert 'armature="0.0123456789012345"' in text
    assert 'ref="10"' in text


def test_meshes_are_found_from_the_new_place(tmp_path):
    (tmp_path / "robot" / "meshes").mkdir(parents=True)
    corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
    (tmp_path / "robot" / "meshes" / "part.obj").write_text(corners)
    file = tmp_path / "robot" / "robot.xml"
    file.write_text(
        '<mujoco><compiler meshdir="meshes"/><asset><mesh name="part" file="part.obj"/></asset>'
        '<worldbody><body><joint name="j"/><geom type="mesh" mesh="part"/></body></worldbody></mujoco>'
    )
    rig = bind(mujoco.MjSpec.from_file(str(file)), {"q": reads(joint="j")})
    write_augmented(rig, [], np.zeros(0), tmp_path / "elsewhere")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "elsewhere" / "model.xml"))
    assert model.nmesh == 1


def test_a_change_that_a_model_cannot_hold_is_said_in_one_line():
    """A ball joint has one armature for its three degrees of freedom."""
    of = bench(
        '<worldbody><body name="b"><joint name="j" type="ball"/><geom size=".1"/><body name="c">'
        '<joint name="k"/><geom size=".1" pos=".3 0 0"/></body></body></worldbody>',
        {"q": reads(joint="k")}, seconds=0.1, episodes=1,
    )  # fmt: skip

    class Lopsided(type(of.effect("armature"))):
        def edit(self, model, values):
            model.dof_armature[0] += values[0]

    effect = copy.copy(of.effect("armature"))
    effect.__class__ = Lopsided
    with pytest.raises(InputError, match="cannot represent"):
        augmented_model(of.rig, [effect], np.array([0.1]))
