"""FetchSlide's robot in the lab: the environment's own steps, and commands that its model can follow."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from slapshot.domains.fetchslide.reference import make_environment
from slapshot.lab.joints.noise import NOISE_SD, read_clean
from slapshot.lab.joints.rig import draw_excitation
from slapshot.lab.joints.rig_simulator import RigSimulator
from slapshot.lab.joints.rigs import rig_named


@pytest.fixture(scope="module")
def session():
    rig = replace(rig_named("fetchslide_arm"), settle=0.4)
    excitation = draw_excitation(rig, 2, 1.6, np.random.default_rng(3))
    return rig, excitation, RigSimulator(rig).execute(excitation)


def test_the_lab_steps_as_the_environment_does(session):
    rig, excitation, motion = session
    environment = make_environment()
    environment.model.geom_contype[:] = environment.model.geom_conaffinity[:] = 0
    columns = [environment.model.joint(name).qposadr[0] for name in rig.joints]
    settling = round(rig.settle / rig.clock.period)
    for episode in range(2):
        environment.reset(seed=0)
        requested = [excitation.centre[episode]] * round(0.6 * settling) + [np.zeros(3)] * round(
            0.4 * settling
        )
        found = []
        for command in [*requested, *excitation.wave[episode]]:
            environment.step(np.append(command, 0.0))
            found.append(environment.data.qpos[columns])
        every = round(rig.clock.period / rig.clock.kept)
        kept = motion.positions[episode, every::every, : len(columns)]
        assert kept == pytest.approx(np.array(found), abs=1e-7)


def test_the_nominal_model_follows_what_was_told(session):
    rig, _, motion = session
    model = mujoco.MjModel.from_xml_string(rig.xml)
    joints = [model.joint(name).qposadr[0] for name in rig.joints]
    every = round(rig.clock.sample / model.opt.timestep)
    clean = read_clean(rig, motion, ())
    for episode, commands in enumerate(motion.commands):
        data = mujoco.MjData(model)
        data.qpos[:], data.qvel[:] = motion.start[episode]
        found = []
        for pose in commands:
            data.mocap_pos[0], data.mocap_quat[0] = pose[:3], pose[3:]
            for _ in range(round(rig.clock.period / rig.clock.sample)):
                mujoco.mj_kinematics(model, data)
                found.append(np.append(data.qpos[joints], data.site(rig.site).xpos))
                mujoco.mj_step(model, data, every)
        # What is left is that the environment closes the fingers, which the model lets drift.
        assert np.sqrt(((np.array(found) - clean[episode]) ** 2).mean(0)).max() < 0.02 * NOISE_SD
