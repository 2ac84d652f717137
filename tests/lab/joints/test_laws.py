"""Closed forms: what a single joint does by physics that can be worked out on paper."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import ellipk
from slapshot.lab.joints.hidden_effect import Concealed, StepState
from slapshot.lab.joints.hidden_effects.drive import _Delay, _Limit
from slapshot.lab.joints.hidden_effects.friction import Bristles
from slapshot.lab.joints.hidden_effects.surroundings import _Magnet
from slapshot.lab.joints.noise import read_clean
from slapshot.lab.joints.registry import HIDDEN_EFFECTS
from slapshot.lab.joints.rig import CLOCK, Excitation, Rig
from slapshot.lab.joints.rig_simulator import RigSimulator

PERIOD = CLOCK.period
MASS, LENGTH, ARMATURE = 0.7, 0.4, 0.02
INERTIA = MASS * LENGTH**2 + 1e-9 + ARMATURE  # about the joint
WEIGHT = MASS * 9.81 * LENGTH  # N m of a level link
KP, KV = 50.0, 6.0


def single(gravity=True, servo=False, pose=0.0, seconds=3.0, gravcomp=0, axis="0 1 0"):
    """A point mass on a massless link, hanging at an angle of 0, with the means to move it or none."""
    drive = f'<position joint="j" name="j" kp="{KP}" kv="{KV}"/>' if servo else '<motor joint="j" name="j"/>'
    xml = f"""<mujoco><compiler angle="radian"/>
      <option gravity="0 0 {-9.81 if gravity else 0}" timestep="0.0025" integrator="RK4"/>
      <worldbody><body name="base"><geom type="box" size=".1 .1 .1" mass="3" contype="0" conaffinity="0"/>
        <body name="link"  gravcomp="{gravcomp}"><joint name="j" axis="{axis}" armature="{ARMATURE}"/>
          <inertial pos="0 0 {-LENGTH}" mass="{MASS}" diaginertia="1e-9 1e-9 1e-9"/></body></body></worldbody>
      <actuator>{drive}</actuator></mujoco>"""
    rig = Rig(
        name="single",
        xml=xml,
        drive="servo" if servo else "torque",
        base="base",
        tip=("link", (0, 0, -LENGTH)),
        loaded=("j",),
        centre=((pose, pose),),
        swing=(1.0,),
        band=(0.5, 2.0),
        settle=0.0,
    )
    return rig, Excitation(np.array([[pose]]), np.zeros((1, round(seconds / PERIOD), 1)))


def conceal(name, amplitude, **shape):
    return Concealed(HIDDEN_EFFECTS[name], amplitude, {"joint": "j", "sign": 1.0} | shape)


def moved(rig, excitation, *concealed):
    """Times (s) and angles (rad) of the joint."""
    motion = RigSimulator(rig, concealed).execute(excitation)
    return motion.times, motion.positions[0, :, 0]


def period(times, angles):
    """S from one passage upwards through 0 to the last one, over how many there are in between."""
    up = np.flatnonzero((angles[:-1] < 0) & (angles[1:] >= 0))
    at = times[up] - angles[up] * (times[up + 1] - times[up]) / (angles[up + 1] - angles[up])
    return (at[-1] - at[0]) / (len(at) - 1)


def swings(stiffness, extra=(), pose=0.2, seconds=3.0):
    rig, excitation = single(gravity=False, pose=pose, seconds=seconds)
    spring = conceal("spring", stiffness, rest_rad=0.0, stiffens_at_rad=1e3)
    return moved(rig, excitation, spring, *extra)


def test_a_pendulum_swings_with_the_period_of_its_amplitude():
    rig, excitation = single(pose=0.9, seconds=6.0)
    # 4 K(sin(a / 2)) sqrt(I / (m g l)); passages are interpolated, hence the tolerance.
    closed = 4 * ellipk(np.sin(0.45) ** 2) * np.sqrt(INERTIA / WEIGHT)
    assert period(*moved(rig, excitation)) == pytest.approx(closed, rel=1e-6)


def test_a_heavier_rotor_and_a_load_lengthen_the_period():
    rig, excitation = single(pose=0.3, seconds=6.0)
    share = 4 * ellipk(np.sin(0.15) ** 2)
    found = period(*moved(rig, excitation, conceal("armature", 0.05)))
    assert found == pytest.approx(share * np.sqrt((INERTIA + 0.05) / WEIGHT), rel=1e-6)
    load, radius, away = 0.3, 0.03, 0.05
    payload = conceal("payload", load, body="link", from_tip_m=[0, 0, -away], radius_m=radius)
    arm = LENGTH + away
    inertia = INERTIA + load * arm**2 + 0.4 * load * radius**2
    closed = share * np.sqrt(inertia / (WEIGHT + load * 9.81 * arm))
    assert period(*moved(rig, excitation, payload)) == pytest.approx(closed, rel=1e-6)


def test_a_spring_swings_with_its_own_period():
    assert period(*swings(9.0)) == pytest.approx(2 * np.pi * np.sqrt(INERTIA / 9.0), rel=1e-4)


def test_coulomb_friction_takes_as_much_of_every_half_swing():
    # x'' = -(k x + F sign(v)) / I: a turning point is 2 F / k nearer than the one before. Bristles bend by
    # 1e-5 rad before they slip, and wear off some of that.
    stiffness, friction, bend = 9.0, 0.06, 1e-5
    dry = conceal("coulomb_friction", friction, bend_rad=bend, damping_time_s=0.0005)
    _, angles = swings(stiffness, [dry])
    rate = np.diff(angles)
    turns = np.abs(angles[1:-1][rate[:-1] * rate[1:] < 0])[:8]
    assert -np.diff(turns) == pytest.approx(np.full(len(turns) - 1, 2 * friction / stiffness), abs=4 * bend)


def test_viscous_friction_takes_a_share_of_every_swing():
    stiffness, damping = 9.0, 0.05
    film = conceal("viscous_friction", damping, answer_s=1e-6, thins_at_rad_s=1e6)
    times, angles = swings(stiffness, [film])
    peaks = np.flatnonzero((angles[1:-1] > angles[:-2]) & (angles[1:-1] >= angles[2:])) + 1
    decay = -np.polyfit(times[peaks], np.log(angles[peaks]), 1)[0]
    assert decay == pytest.approx(damping / (2 * INERTIA), rel=2e-3)


def test_bristles_slide_at_their_level_and_stick_like_a_spring():
    bristles = Bristles(bend=5e-4, scale=2.0, damping_time=0.0, timestep=2.5e-4)
    for _ in range(200):
        torque = bristles.torque(np.array([0.7, -0.7]), 2.0)
    assert torque == pytest.approx([-2.0, 2.0], rel=1e-9)
    stuck = Bristles(bend=5e-4, scale=2.0, damping_time=0.0, timestep=2.5e-4)
    assert stuck.torque(np.array([1e-5 / 2.5e-4]), 2.0) == pytest.approx([-1e-5 * 2.0 / 5e-4], rel=0.02)


def test_a_soft_gear_gives_way_by_torque_over_stiffness():
    pose, stiffness = 1.2, 40.0
    rig, excitation = single(servo=True, pose=pose, seconds=4.0)
    stiff = moved(rig, excitation)[1][-1]
    soft = moved(rig, excitation, conceal("joint_elasticity", 1 / stiffness, damping_ratio=0.3))[1][-1]
    # Of a link at rest: u - q = w sin(q) (1 / kp + 1 / k).
    assert pose - stiff == pytest.approx(WEIGHT * np.sin(stiff) / KP, abs=1e-6)
    assert pose - soft == pytest.approx(WEIGHT * np.sin(soft) * (1 / KP + 1 / stiffness), abs=1e-5)


def test_a_gap_is_as_wide_as_it_is_said_to_be():
    pose, gap = 1.2, 0.04
    rig, excitation = single(servo=True, pose=pose, seconds=4.0)
    loose = moved(rig, excitation, conceal("backlash", gap, damping_ratio=0.7, drag_share=0.1))[1][-1]
    # The weight holds the link at the end of the gap, which gives way by less than 0.1 mrad.
    assert pose - loose == pytest.approx(WEIGHT * np.sin(loose) / KP + gap / 2, abs=1e-4)


def test_a_hose_pulls_a_servo_off():
    rig, excitation = single(gravity=False, servo=True, pose=0.5)
    hose = conceal("spring", 8.0, rest_rad=-0.3, stiffens_at_rad=1e3)
    assert moved(rig, excitation, hose)[1][-1] == pytest.approx((KP * 0.5 - 8.0 * 0.3) / (KP + 8.0), abs=1e-6)


def test_what_hangs_shows_where_gravity_is_and_where_zero_is():
    rig, excitation = single(seconds=6.0)
    rig = replace(rig, hold=(0.0, 0.4))  # damping alone
    tilt = Concealed(HIDDEN_EFFECTS["gravity_tilt"], 0.1, {"towards_rad": np.pi})
    # About +y, an angle carries a hanging link towards -x.
    assert moved(rig, excitation, tilt)[1][-1] == pytest.approx(0.1, abs=1e-4)
    assert moved(rig, excitation, conceal("joint_offset", 0.07))[1][-1] == pytest.approx(0.07, abs=1e-4)


def test_a_controller_compensates_the_mass_that_it_believes_in():
    rig, excitation = single(servo=True, pose=1.2, gravcomp=1)
    assert moved(rig, excitation)[1][-1] == pytest.approx(1.2, abs=1e-9)
    heavy = Concealed(HIDDEN_EFFECTS["link_mass"], 0.2, {"body": "link", "sign": 1.0, "inertia_power": 1.0})
    sagged = moved(rig, excitation, heavy)[1][-1]
    assert 1.2 - sagged == pytest.approx((np.exp(0.2) - 1) * WEIGHT * np.sin(sagged) / KP, abs=1e-6)


def test_a_base_leans_as_its_spring_lets_it():
    rig, excitation = single(servo=True, pose=np.pi / 2, seconds=4.0, gravcomp=0)
    compliance = 0.002
    soft = Concealed(
        HIDDEN_EFFECTS["base_compliance"], compliance, {"body": "base", "ratio": 1.0, "damping_ratio": 0.7}
    )
    null, angle = moved(rig, excitation)[1][-1], moved(rig, excitation, soft)[1][-1]
    # The link's torque tilts the base by compliance times torque, which turns gravity against the link; to
    # first order its sag w sin(q) / kp changes by w cos(q) tilt / kp.
    tilt = compliance * WEIGHT * np.sin(null)
    lean = WEIGHT * np.cos(null) / KP
    assert angle - null == pytest.approx(lean * tilt / (1 + lean), rel=0.05)


def test_commands_and_readings_come_late_by_their_delays():
    times = np.arange(0, 3, PERIOD)
    rig, excitation = single(gravity=False, servo=True)
    excitation = replace(excitation, wave=0.4 * np.sin(3 * times)[None, :, None])
    null = RigSimulator(rig).execute(excitation)
    sample_delay = RigSimulator(rig, [conceal("command_delay", 0.013, stream=4)]).execute(excitation)
    after = null.times > 1
    for delay in (0.013,):
        expected = np.interp(null.times[after] - delay, null.times, null.positions[0, :, 0])
        off = sample_delay.positions[0, after, 0] - expected
        # Single commands are late by 10 % more or less, 1.3 ms at 1.2 rad/s, of which the servo takes a mean.
        assert np.sqrt((off**2).mean()) < 4e-4
    assert np.sqrt(((sample_delay.positions - null.positions)[0, after] ** 2).mean()) > 5e-3
    delayed = read_clean(rig, null, [conceal("encoder_delay", 0.013, wander_share=0, wander_hz=1)])
    assert delayed[0, 10:, 0] == pytest.approx(
        np.interp(times[10:] - 0.013, null.times, null.positions[0, :, 0])
    )


class _Plant:
    def __init__(self):
        self.rig, _ = single()
        self.timestep = 2.5e-4
        self.session = np.zeros(1)


def test_a_command_that_arrives_within_a_step_acts_for_a_part_of_it():
    law = _Delay(0.0061, {"joint": "j", "stream": 0}, _Plant())
    law._rng = type("Still", (), {"normal": lambda self, size: np.zeros(size)})()
    acted = []
    for step in range(60):
        commands = np.array([[float(step // 20)]])
        law.command(commands, StepState((step + 0.5) * 2.5e-4, None, None, None, None))
        acted.append(commands[0, 0])
    # The step to 1 is told at 5 ms and arrives at 11.1 ms: in step 44, which is from 11 to 11.25 ms.
    assert acted[43] == 0.0
    assert acted[44] == pytest.approx(0.6)
    assert acted[45:] == [1.0] * 15


def test_an_actuator_does_no_more_than_its_limit():
    law = _Limit(0.75, {"joint": "j", "peak_n_m": 8.0, "sharpness": 12}, _Plant())
    force = np.array([[0.5], [2.0], [100.0]])
    law.drive(force, None)
    assert force[0, 0] == pytest.approx(0.5, rel=1e-6)
    assert force[1, 0] == pytest.approx(2.0 / 2 ** (1 / 12))
    assert force[2, 0] == pytest.approx(2.0, rel=1e-9)


def test_a_magnet_pulls_hardest_at_half_its_reach():
    magnet = _Magnet.__new__(_Magnet)
    magnet._place, magnet._reach, magnet._size = np.zeros(3), 0.1, 5.0 / (0.5 / 1.25**2.5)
    distance = np.linspace(0.001, 0.3, 600)
    places = np.zeros((600, 3))
    places[:, 0] = distance
    force = magnet.force(places, places)
    assert force[:, 0].min() == pytest.approx(-5.0, rel=1e-4)
    assert distance[force[:, 0].argmin()] == pytest.approx(0.05, abs=1e-3)
