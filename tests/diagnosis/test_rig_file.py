"""Rig files: what they may say, what becomes of it, and refusals of one line."""

from pathlib import Path

import numpy as np
import pytest
from slapshot.diagnosis.diagnose import free_effects
from slapshot.diagnosis.model.rig import Rig
from slapshot.diagnosis.model.rig_file import bound_rig, read_rig_file, rig_of_model
from slapshot.diagnosis.model.segments import segment_recording
from slapshot.diagnosis.selection.problem import Problem
from slapshot.errors import InputError
from slapshot.recordings.signals import SignalRecording

from .mechanisms import PENDULUM, control_channel, joint, recording, simulate


@pytest.fixture(name="folder")
def _folder(tmp_path: Path) -> Path:
    (tmp_path / "rod.xml").write_text(PENDULUM)
    return tmp_path


def taken(*, angle: str = "swing", drive: str = "drive") -> SignalRecording:
    """A second of a driven rod, with a rate beside its angle."""
    t = np.arange(100) * 0.01
    u = np.sin(6 * t)[:, None]
    qpos, qvel, *_ = simulate(PENDULUM, t, u, [0.5], [0.0], finer=1)
    return recording(
        t,
        {
            "angle": (joint(angle), qpos[:, 0]),
            "rate": (joint("swing", "velocity", "rad/s"), qvel[:, 0]),
            "motor": (control_channel(actuator=drive), u[:, 0]),
        },
    )


def bound(folder: Path, text: str, of: SignalRecording | None = None) -> tuple[Rig, SignalRecording]:
    file = folder / "rig.yaml"
    file.write_text(text)
    return bound_rig(read_rig_file(file), of or taken())


def refusal(folder: Path, text: str, of: SignalRecording | None = None) -> str:
    with pytest.raises(InputError) as caught:
        bound(folder, text, of)
    said = str(caught.value)
    assert "\n" not in said
    assert str(folder) in said
    return said


def problem(rig: Rig, of: SignalRecording) -> Problem:
    return Problem.of(rig, of.channels, segment_recording(of, rig))


def test_a_rig_file_says_all_that_it_may(folder: Path):
    rig, used = bound(
        folder,
        "model: rod.xml\nname: my rod\nignore: [rate]\nfree: [viscous_friction]\ntimestep: 0.002\n"
        "channels:\n  angle: {joint: swing}\n  motor: {actuator: drive}\n",
        taken(angle="unknown", drive="unknown"),
    )
    assert (rig.name, rig.free) == ("my rod", ("viscous_friction",))
    assert [(c.input, c.channel) for c in rig.controls] == [("drive", "motor")]
    assert [(o.channel, o.part) for o in rig.observations] == [("angle", "swing")]
    # Both in the model that is simulated and in the one that may be written.
    assert rig.model.opt.timestep == rig.spec.option.timestep == 0.002
    assert list(used.channels) == ["angle", "motor"]
    assert [e.key for e in free_effects(rig, problem(rig, used))] == ["viscous_friction@swing"]


def test_without_overrides_the_recordings_own_names_hold(folder: Path):
    rig, used = bound(folder, "model: rod.xml\n")
    assert rig.name == used.rig == "mechanism"
    assert rig.model.opt.timestep == 0.01
    assert list(used.channels) == ["angle", "rate", "motor"]
    assert used.stand_in


def test_a_model_alone_is_a_rig(folder: Path):
    of = rig_of_model(folder / "rod.xml")
    rig, used = bound_rig(of, taken())
    other, same = bound(folder, "model: rod.xml\n")
    assert of.effects == {}
    assert (rig.observations, rig.controls) == (other.observations, other.controls)
    assert used.channels == same.channels


def test_a_binding_replaces_the_target_whole(folder: Path):
    """A channel that named an actuator is a torque of a joint: the actuator's name must not stay."""
    of = taken()
    motor = of.channels["motor"].model_copy(update={"quantity": "torque", "unit": "N m"})
    of.channels["motor"] = motor
    without = PENDULUM.replace('<actuator><motor name="drive" joint="swing"/></actuator>', "")
    (folder / "rod.xml").write_text(without)
    rig, used = bound(folder, "model: rod.xml\nchannels:\n  motor: {joint: swing}\n", of)
    assert (used.channels["motor"].joint, used.channels["motor"].actuator) == ("swing", None)
    assert [(c.input, c.channel) for c in rig.controls] == [("slapshot:swing", "motor")]
    assert of.channels["motor"] is motor  # the recording that was given is left as it is


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("model: rod.xml\nfre: [link_mass]\n", ("fre", "free")),
        ("name: rod\n", ("model",)),
        ("model: other.xml\n", ("other.xml", "missing")),
        ("model: bad.xml\n", ("bad.xml", "does not compile")),
        ("model: rod.xml\nignore: [torque]\n", ("'torque'", "angle, rate, motor")),
        ("model: rod.xml\nchannels:\n  torque: {joint: swing}\n", ("'torque'", "angle, rate, motor")),
        ("model: rod.xml\nchannels:\n  angle: {joint: swing, site: tip}\n", ("name one of", "joint")),
        ("model: rod.xml\nchannels:\n  angle: {component: x}\n", ("name one of",)),
        ("model: rod.xml\nchannels:\n  angle: {joint: elbow}\n", ("no joint 'elbow'", "swing")),
        ("model: rod.xml\nignore: [angle, rate]\n", ("nothing is observed",)),
        ("model: rod.xml\nchannels:\n  angle: {site: tip}\n", ("channels.angle", "component")),
        ("model: rod.xml\nignore: [rate]\nchannels:\n  rate: {joint: swing}\n", ("'rate'", "keep one")),
        ("model: rod.xml\ntimestep: 0\n", ("timestep",)),
        ("model: rod.xml\ntimestep: fast\n", ("timestep",)),
        ("model: rod.xml\neffects: [/tmp/mine.py]\n", ("effects",)),
    ],
)
def test_refusals_are_one_line_that_says_what_and_where(folder: Path, text: str, words: tuple[str, ...]):
    (folder / "bad.xml").write_text("<mujoco><worldbody><body><joint/></body></worldbody></mujoco>")
    said = refusal(folder, text)
    for word in words:
        assert word in said


def test_a_channel_may_be_ignored_twice(folder: Path):
    rig, _ = bound(folder, "model: rod.xml\nignore: [rate, rate]\n")
    assert [observation.channel for observation in rig.observations] == ["angle"]


def test_a_rig_file_that_is_missing_is_refused(folder: Path):
    with pytest.raises(InputError, match=r"none\.yaml") as caught:
        read_rig_file(folder / "none.yaml")
    assert "\n" not in str(caught.value)


def test_free_names_are_those_of_effects_on_this_model(folder: Path):
    for wanted in ("viscous_fricton", "viscous_friction@elbow", "backlash"):  # the last has a state
        rig, used = bound(folder, f"model: rod.xml\nfree: ['{wanted}']\n")
        with pytest.raises(InputError, match=f"free: '{wanted}' is no parameter") as caught:
            free_effects(rig, problem(rig, used))
        said = str(caught.value)
        assert "\n" not in said
        assert "viscous_friction" in said.split("use some of")[1]
        assert "backlash" not in said.split("use some of")[1]
