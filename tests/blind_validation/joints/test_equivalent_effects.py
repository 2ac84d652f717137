"""Names that are right: every kind has its effect, and an alias is the same law to the last digit."""

import mujoco
import numpy as np
import pytest
from slapshot.arrays import GRAVITY
from slapshot.blind_validation.joints.score import (
    ALIASES,
    ConcealedEffect,
    LocatedEffect,
    equivalent_effects,
    parse_key,
)
from slapshot.effects.joints.catalogue import instances, joint_effects
from slapshot.effects.joints.effect import Joint, RigMotion
from slapshot.lab.joints.hidden_effect import Concealed
from slapshot.lab.joints.registry import HIDDEN_EFFECTS
from slapshot.lab.joints.rigs import RIGS, nominal_model, rig_named

from .conftest import concealed

# HiddenEffect that has an alias -> a shape and an amplitude of it in the lab.
CHANGES = {
    "joint_offset": ({"sign": 1.0}, 0.3),
    "armature": ({"sign": 1.0}, 0.02),
    "link_mass": ({"sign": 1.0, "inertia_power": 1.2}, 0.4),
}


def test_every_catalogued_kind_has_an_effect_of_its_name():
    catalogued = {name for name, kind in HIDDEN_EFFECTS.items() if kind.catalogued}
    assert len(catalogued) > 20
    assert catalogued <= set(joint_effects())


@pytest.mark.parametrize(
    ("one", "names"),
    [
        (concealed("spring", "joint1"), [LocatedEffect("spring", "joint1")]),
        (concealed("payload", body="lower"), [LocatedEffect("payload", "lower")]),
        (concealed("gravity_tilt", None), [LocatedEffect("gravity_tilt", "")]),
        (concealed("base_compliance", body="base"), [LocatedEffect("base_compliance", "")]),
        (
            concealed("joint_offset", "joint1"),
            [LocatedEffect("joint_offset", "joint1"), LocatedEffect("gravity_tilt", "")],
        ),
        (concealed("joint_offset", "joint2"), [LocatedEffect("joint_offset", "joint2")]),
        (concealed("armature", "joint1"), [LocatedEffect("armature", "joint1")]),
    ],
)
def test_right_names_on_the_pendulum(one, names):
    assert list(equivalent_effects("pendulum", ConcealedEffect(**one))) == names


@pytest.mark.parametrize(
    ("key", "name"),
    [
        ("spring@joint1", ("spring", "joint1")),
        ("gravity_tilt", ("gravity_tilt", "")),
        ("backlash@joint2 (read at the motor)", ("backlash", "joint2")),
        ("command_delay@all actuators", ("command_delay", "all actuators")),
        ("torque_ripple@robot0:elbow from order 12.5", ("torque_ripple", "robot0:elbow")),
    ],
)
def test_keys_of_effects_are_read(key, name):
    assert parse_key(key) == LocatedEffect(*name)


def test_keys_of_effects_are_those_of_the_catalogue():
    """`named_of` reads what `JointEffect.key` writes, on every part of a rig."""
    model = mujoco.MjModel.from_xml_string(nominal_model("pendulum"))
    joints = tuple(
        Joint(name, i, i, "N m", (i,), 1.0, (1.0,), 1.0, 0.5, 0.0, 0.1)
        for i, name in enumerate(("joint1", "joint2"))
    )
    found = instances(RigMotion(model, joints, (), (), 0.005, 20))
    assert len(found) > 30
    for effect in found:
        assert parse_key(effect.key) == LocatedEffect(effect.name, effect.part), effect.key


def inverse(model, rng):
    """Torques that make a model move in given ways, (ways, joints)."""
    data, found = mujoco.MjData(model), []
    for _ in range(20):
        data.qpos[:] = rng.uniform(-0.6, 0.6, model.nq)
        data.qvel[:] = rng.normal(size=model.nv)
        data.qacc[:] = rng.normal(size=model.nv)
        mujoco.mj_inverse(model, data)
        found.append(data.qfrc_inverse.copy())
    return np.array(found)


def with_concealed(rig, kind, part):
    """Model of the rig that conceals a kind."""
    shape, amplitude = CHANGES[kind]
    where = "joint" if part in rig.joints else "body"
    one = Concealed(HIDDEN_EFFECTS[kind], amplitude, shape | {where: part})
    spec = mujoco.MjSpec.from_string(rig.xml)
    one.effect.build(one.amplitude, one.shape, spec, rig)
    model = spec.compile()
    one.effect.tune(one.amplitude, one.shape, model, rig)
    mujoco.mj_setConst(model, mujoco.MjData(model))
    return model


def with_alias(rig, alias, amplitude):
    model = mujoco.MjModel.from_xml_string(rig.xml)
    if alias.effect == "gravity_tilt":
        model.opt.gravity[:] = -GRAVITY * np.array((np.sin(amplitude), 0, np.cos(amplitude)))
    elif alias.effect == "armature":
        model.dof_armature[model.joint(alias.part).dofadr[0]] += amplitude
    else:
        model.body_mass[model.body(alias.part).id] *= 1 + amplitude
        model.body_inertia[model.body(alias.part).id] *= 1 + amplitude
    mujoco.mj_setConst(model, mujoco.MjData(model))
    return model


def change(model, rig):
    """What differs from the nominal model in the torques of the same motions."""
    nominal = inverse(mujoco.MjModel.from_xml_string(rig.xml), np.random.default_rng(3))
    return inverse(model, np.random.default_rng(3)) - nominal


@pytest.mark.parametrize(("rig_name", "own"), list(ALIASES))
def test_an_alias_makes_the_same_torques_at_some_value(rig_name, own):
    rig, alias = rig_named(rig_name), ALIASES[rig_name, own]
    wanted = change(with_concealed(rig, own.effect, own.part), rig)
    assert np.abs(wanted).max() > 1e-4
    if alias.effect == "gravity_tilt":
        value = CHANGES[own.effect][1]
    else:  # linear in its value
        unit = change(with_alias(rig, alias, 0.1), rig)
        value = 0.1 * float((wanted * unit).sum() / (unit**2).sum())
    assert change(with_alias(rig, alias, value), rig) == pytest.approx(wanted, abs=1e-9)


def test_what_is_merely_alike_is_no_alias():
    """Of a joint that gravity loads, a rotor is not a heavier link: the same comparison tells them apart."""
    rig = rig_named("arm")
    wanted = change(with_concealed(rig, "armature", "joint3"), rig)
    unit = change(with_alias(rig, LocatedEffect("link_mass", "fore"), 0.1), rig)
    value = 0.1 * float((wanted * unit).sum() / (unit**2).sum())
    assert (
        np.abs(change(with_alias(rig, LocatedEffect("link_mass", "fore"), value), rig) - wanted).max() > 1e-3
    )


def test_aliases_are_of_rigs_and_parts_that_there_are():
    for (rig_name, own), alias in ALIASES.items():
        assert rig_name in RIGS
        rig = rig_named(rig_name)
        assert {own.part, alias.part} <= {*rig.joints, *rig.links, ""}
