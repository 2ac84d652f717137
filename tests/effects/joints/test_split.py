"""Joints that are added to a model are as they are said to be, whatever the model's own defaults are."""

import mujoco
import numpy as np
import pytest
from slapshot.effects.joints.split import base_joint, deflection, put_on_base, split_joint

TETRAHEDRON = "v 0 0 0\nv .1 0 0\nv 0 .1 0\nv 0 0 .1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
DEFAULTS = (
    'limited="true" armature="1" frictionloss="2" damping="3" stiffness="4" springref="0.5" '
    'actuatorfrclimited="true" actuatorfrcrange="-5 5"'
)


@pytest.fixture
def spec(tmp_path):
    """An arm of two links, whose defaults and whose mesh are anything but plain."""
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes/link.obj").write_text(TETRAHEDRON)
    model = tmp_path / "arm.xml"
    model.write_text(f"""<mujoco>
  <compiler meshdir="meshes"/>
  <asset><mesh name="link" file="link.obj"/></asset>
  <default><joint {DEFAULTS}/><default class="arm"><joint {DEFAULTS}/></default></default>
  <worldbody><body childclass="arm"><joint name="shoulder" axis="0 1 0" range="-1 1"/>
    <geom type="mesh" mesh="link"/>
    <body pos=".1 0 0"><joint name="elbow" axis="0 1 0" range="-1 1"/><geom type="mesh" mesh="link"/></body>
  </body></worldbody>
</mujoco>""")
    return mujoco.MjSpec.from_file(str(model))


def check_plain(model, name):
    """A joint without stops, springs, friction, inertia and limits of its own."""
    joint = model.joint(name)
    dof, address = joint.dofadr[0], joint.qposadr[0]
    assert not model.jnt_limited[joint.id]
    assert not model.jnt_actfrclimited[joint.id]
    told = [model.dof_armature[dof], model.dof_frictionloss[dof], model.dof_damping[dof]]
    told += [model.jnt_stiffness[joint.id], model.qpos0[address], model.qpos_spring[address]]
    assert np.all(np.array(told) == 0)


def test_the_deflection_of_a_joint_has_nothing_from_the_defaults_of_the_model(spec):
    split_joint(spec, "elbow", rotor=0.1)
    model = spec.compile()
    check_plain(model, deflection("elbow"))
    assert model.dof_armature[model.joint("elbow").dofadr[0]] == 1  # the model's own joints keep theirs


def test_a_base_that_tilts_has_nothing_from_the_defaults_of_the_model_and_finds_its_meshes(spec):
    model = put_on_base(spec, inertia=1.0).compile()
    for axis in "xy":
        check_plain(model, base_joint(axis))
    assert model.nmesh == 1
