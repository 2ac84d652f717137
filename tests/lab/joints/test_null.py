"""A rig that conceals nothing: what its nominal model makes of the commands, by other numerics.

Measured over sessions of 20 episodes of 3 s: the nominal model, integrated as it says, is off by 0.0001 mrad
(pendulum), 0.0026 mrad (arm) and 0.0015 mrad (kuka) rms at the worst joint; encoders have a noise of 1 mrad.
With MuJoCo's implicitfast it would be off by 2.3, 2.2 and 1.4 mrad at steps of 2.5 ms, and by 0.2 at 0.25 ms.
"""

import mujoco
import numpy as np
import pytest
from slapshot.lab.joints.clutter import LAW_ERROR, LawError
from slapshot.lab.joints.noise import (
    CORRELATION,
    NOISE_SD,
    OUTLIER_SIZE,
    MeasurementCondition,
    draw_sensor_noise,
    quantise,
    read_clean,
)
from slapshot.lab.joints.rig import CLOCK, draw_excitation
from slapshot.lab.joints.rig_simulator import RigSimulator

from .conftest import short

PERIOD = CLOCK.period


def replayed(rig, motion, timestep=None, integrator=None):
    """Angles (episodes, samples, joints) of the nominal model, sent the commands from where it began."""
    model = mujoco.MjModel.from_xml_string(rig.xml)
    model.opt.timestep = timestep or model.opt.timestep
    model.opt.integrator = model.opt.integrator if integrator is None else integrator
    steps = round(PERIOD / model.opt.timestep)
    angles = np.empty_like(motion.commands)
    for episode, told in enumerate(motion.commands):
        data = mujoco.MjData(model)
        data.qpos[:], data.qvel[:] = motion.start[episode]
        for sample, command in enumerate(told):
            angles[episode, sample] = data.qpos
            data.ctrl[:] = command
            mujoco.mj_step(model, data, steps)
    return angles


@pytest.mark.parametrize("name", ["pendulum", "arm", "kuka"])
def test_nominal_model_and_lab_integrate_alike(name):
    rig = short(name)
    motion = RigSimulator(rig).execute(draw_excitation(rig, 2, 1.5, np.random.default_rng(2)))
    clean = read_clean(rig, motion, ())
    off = np.sqrt(((replayed(rig, motion) - clean) ** 2).mean((0, 1))).max()
    assert off < 0.005 * NOISE_SD
    # The measure would see a method of first order.
    rough = replayed(rig, motion, 0.0025, mujoco.mjtIntegrator.mjINT_IMPLICITFAST)
    assert np.sqrt(((rough - clean) ** 2).mean((0, 1))).max() > 0.3 * NOISE_SD


def test_errors_of_laws_are_of_shape_and_smooth(size_calibrations):
    nominal = size_calibrations["arm"].nominal
    error = LawError(nominal, np.random.default_rng(0))
    for own, law in ((error.actuators, nominal.forces), (error.dampings, nominal.speeds)):
        factor = own(nominal.speeds, nominal.forces)
        assert np.sqrt((factor**2).mean((0, 1))) == pytest.approx([LAW_ERROR] * 3, rel=1e-9)
        # The best gain for the law that is off is 1.
        assert ((1 + factor) * law * law).sum((0, 1)) == pytest.approx((law * law).sum((0, 1)), rel=1e-9)
        nearby = own(nominal.speeds + 0.01 * nominal.speeds.std(), nominal.forces)
        assert np.abs(nearby - factor).max() < 0.3 * LAW_ERROR


@pytest.mark.parametrize("colour", CORRELATION)
def test_noise_has_its_size_and_colour(colour):
    added = (
        draw_sensor_noise(MeasurementCondition(colour), (40, 600, 2), PERIOD, np.random.default_rng(5)).added
        / NOISE_SD
    )
    keeps = np.exp(-PERIOD / CORRELATION[colour]) if CORRELATION[colour] else 0.0
    free = added.size * (1 - keeps**2) / (1 + keeps**2)  # independent squares among correlated ones
    assert (added**2).mean() == pytest.approx(1.0, abs=4 * np.sqrt(2 / free))
    assert (added[:, :1] ** 2).mean() == pytest.approx(1.0, abs=4 * np.sqrt(2 / 80))
    assert (added[:, 1:] * added[:, :-1]).mean() == pytest.approx(keeps, abs=0.05)


def test_clutter_has_outliers_jitter_growth_and_drift():
    plain = draw_sensor_noise(MeasurementCondition("white"), (40, 600, 2), PERIOD, np.random.default_rng(5))
    sensor_noise = draw_sensor_noise(
        MeasurementCondition("white", cluttered=True), (40, 600, 2), PERIOD, np.random.default_rng(5)
    )
    assert not plain.sample_delay.any()
    assert sensor_noise.sample_delay.std() == pytest.approx(0.1 * PERIOD, rel=0.05)
    grows = sensor_noise.truth["noise_grows_by"]
    session = np.linspace(-0.5, 0.5, 40 * 600).reshape(40, 600, 1)
    drift = sensor_noise.added - plain.added * grows**session
    typical = np.median(np.abs(drift))
    assert typical < 2 * 3e-4  # the drift alone, but for the outliers
    outliers = np.abs(drift) > 2e-3
    # Of noise that grows fivefold, those are seen whose usual noise is above 0.5 sd or so.
    assert 0.004 < outliers.mean() < 0.01
    ratio = np.abs(sensor_noise.added[outliers] / (plain.added * grows**session)[outliers])
    assert np.median(ratio) == pytest.approx(OUTLIER_SIZE, rel=0.1)


def test_quantised_angles_are_steps():
    angles = np.linspace(-0.01, 0.01, 101)
    assert quantise(angles, None) is angles
    steps = quantise(angles, 2e-3)
    assert np.abs(steps - angles).max() <= 1e-3 + 1e-12
    assert len(np.unique(np.round(steps / 2e-3))) == 11
