"""The rigs that config/rigs holds as files."""

from pathlib import Path

import pytest
from mujoco import MjSpec
from slapshot.diagnosis.model.rig_file import bound_rig, read_rig_file
from slapshot.lab.joints.record_case import make_case
from slapshot.lab.joints.rigs import nominal_model

FILES = Path(__file__).parents[3] / "config/rigs"


@pytest.mark.parametrize(("rig", "name"), [("kuka", "kuka-lbr4"), ("fetchslide_arm", "fetchslide-arm")])
def test_a_rig_file_is_of_the_rig_that_the_lab_records(rig, name):
    file = read_rig_file(FILES / f"{name}.yaml")
    assert MjSpec.from_file(str(file.model)).to_xml() == MjSpec.from_string(nominal_model(rig)).to_xml()
    recording, _ = make_case(rig, (), 1, episodes=2, seconds=0.5)
    bound, used = bound_rig(file, recording)
    # Every input is recorded, and every joint of the arm observed.
    assert all(control.channel in used.channels for control in bound.controls)
    assert sum(observation.dof is not None for observation in bound.observations) == 7
