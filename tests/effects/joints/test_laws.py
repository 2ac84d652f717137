"""For every effect a motion that is known: a closed form, or another integrator of its equation.

All is simulated by the engine, with steps of 1 ms: MuJoCo's integrators are of first order, and are a step or
so off closed forms. Its dry friction is soft: below some 0.03 rad/s it creeps to rest.
"""

from collections.abc import Callable
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from slapshot.diagnosis.model.hypothesis import Hypothesis
from slapshot.effects.joints.catalogue import joint_effects
from slapshot.effects.joints.command_delay import CommandDelay
from slapshot.effects.joints.effect import Parameter, State
from slapshot.effects.joints.saturation import SHARPNESS, Saturation

from .rigs import Array, Commands, RigSimulator, bench, reads, tells

INERTIA, MASS, ARM, GRAVITY = 0.2, 0.5, 0.4, 9.81
STEP = 1e-3
# Effects that change the model's structure, or whose moment is found by a search, have files of their own.
ELSEWHERE = {"backlash", "base_compliance", "external_pulse", "joint_elasticity"}
_ANSWERED: set[str] = set()


def answers(name: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Marks a test that gives an effect's known answer."""
    _ANSWERED.add(name)
    return lambda test: test


both_ways = pytest.mark.parametrize("way", [1, -1])


def test_every_effect_has_one():
    assert set(joint_effects()) - ELSEWHERE == _ANSWERED


def rotor(
    start: tuple[float, float] = (0, 0), *, joint: str = "", actuator: str = "",
    commands: Commands = lambda t: [], integrator: str = "Euler", **rest: float,
) -> RigSimulator:  # fmt: skip
    """A balanced hinge with an inertia of INERTIA, or a slide with that mass, without gravity."""
    unit = "m" if 'type="slide"' in joint else "rad"
    channels = {"q": reads(joint="j", unit=unit)} | ({"u": tells("a")} if actuator else {})
    return bench(
        f"""<option gravity="0 0 0" timestep="{STEP}" integrator="{integrator}"/><worldbody><body name="b">
        <joint name="j" axis="0 1 0" {joint}/>
        <inertial pos="0 0 0" mass="{INERTIA}" diaginertia="{INERTIA} {INERTIA} {INERTIA}"/></body>
        </worldbody><actuator>{actuator}</actuator>""",
        channels, start, commands, **({"seconds": 0.5, "interval": 2 * STEP, "episodes": 1} | rest),
    )  # fmt: skip


def pendulum(
    start: float = 0.0, joint: str = "", actuator: str = "", commands: Commands = lambda t: []
) -> RigSimulator:
    """A point mass of MASS that hangs ARM below a hinge about +y: at q it is at x = -ARM sin q."""
    return bench(
        f"""<option gravity="0 0 {-GRAVITY}" timestep="{STEP}"/><worldbody><body name="b">
        <joint name="j" axis="0 1 0" {joint}/><geom size=".02" pos="0 0 {-ARM}" mass="0"/>
        <inertial pos="0 0 {-ARM}" mass="{MASS}" diaginertia="1e-9 1e-9 1e-9"/></body></worldbody>
        <actuator>{actuator}</actuator>""",
        {"q": reads(joint="j")} | ({"u": tells("a")} if actuator else {}),
        [start], commands, seconds=1.2, interval=2 * STEP, episodes=1,
    )  # fmt: skip


def flying(velocity: tuple[float, float, float], gravity: float = 0.0, seconds: float = 0.5) -> RigSimulator:
    """A ball of MASS."""
    return bench(
        f"""<option gravity="0 0 {-gravity}" timestep="{STEP}"/><worldbody><body name="ball"><freejoint/>
        <geom size=".03" mass="{MASS}"/></body></worldbody>""",
        {"x": reads(body="ball")}, [0, 0, 0, 1, 0, 0, 0, *velocity],
        seconds=seconds, interval=2 * STEP, episodes=1,
    )  # fmt: skip


MOTOR = '<motor name="a" joint="j"/>'


def small_swing(t: Array, amplitude: float, inertia: float, stiffness: float) -> Array:
    """Of a pendulum about rest; its period is 1/16 of the amplitude squared longer than this."""
    return amplitude * np.cos(np.sqrt(stiffness / inertia) * t)


# --- Friction


@answers("viscous_friction")
@pytest.mark.parametrize("more", [0.8, -0.15])
@pytest.mark.parametrize("kind", ["hinge", "slide"])
def test_speed_decays_at_the_rate_of_viscous_friction(more, kind):
    free = rotor((0, 2), joint=f'type="{kind}" damping=".2"')
    effect = free.effect("viscous_friction")
    assert effect.parameters[0].unit == {"hinge": "N m s/rad", "slide": "N s/m"}[kind]
    assert effect.parameters[0].low == -0.2
    motion, rate = free.moved(effect, more), (0.2 + more) / INERTIA
    # Implicit Euler is late by half a step.
    assert motion.v() == pytest.approx(2 * np.exp(-rate * motion.t), rel=rate**2 * STEP * 0.5 + 1e-9)


@answers("coulomb_friction")
@both_ways
def test_dry_friction_stops_a_joint_where_its_work_is_its_energy(way):
    free = rotor((0, way * 2.0))
    motion = free.moved(free.effect("coulomb_friction"), 2.0)
    assert motion.q()[-1] == pytest.approx(way * INERTIA * 2.0**2 / (2 * 2.0), abs=2 * STEP)
    assert motion.v()[motion.t > 0.25] == pytest.approx(0, abs=1e-3)
    # Less friction than the model has: half of it is left.
    rough = rotor((0, way * 2.0), joint='frictionloss="2"')
    less = rough.moved(rough.effect("coulomb_friction"), -1.0)
    assert less.v() == pytest.approx(way * np.maximum(2.0 - 1.0 / INERTIA * less.t, 0), abs=0.03)


@both_ways
@pytest.mark.parametrize("integrator", ["Euler", "implicitfast", "RK4"])
def test_dry_friction_turns_around_with_the_velocity_and_holds(way, integrator):
    """A torque slows a joint down and drives it back: slower by friction on both ways."""
    back, friction = 4.0, 0.4
    driven = rotor(
        (0, way * 2.0), actuator=MOTOR, commands=lambda t: [-way * back + 0 * t], integrator=integrator
    )
    motion = driven.moved(driven.effect("coulomb_friction"), friction)
    there = 2.0 - (back + friction) / INERTIA * motion.t
    v = np.where(there > 0, there, there * (back - friction) / (back + friction))
    # A step early or late by one step, in which friction does twice what it does.
    assert motion.v() == pytest.approx(way * v, abs=2 * friction / INERTIA * STEP)
    push = way * 0.9 * friction
    held = rotor(actuator=MOTOR, commands=lambda t: [push + 0 * t], integrator=integrator)
    still = held.moved(held.effect("coulomb_friction"), friction)
    # What the constraint's greatest stiffness, of 1 in 10,000, lets through.
    assert still.v() == pytest.approx(0, abs=2e-4 * 0.9 * friction / INERTIA * STEP)


@answers("direction_friction")
@both_ways
@pytest.mark.parametrize("kind", ["stops", "holds"])
def test_dry_friction_differs_between_directions(way, kind):
    forward, backward = 1.2, 0.4
    size = forward if way > 0 else backward
    if kind == "stops":
        free = rotor((0, way * 1.0))
        motion = free.moved(free.effect("direction_friction"), forward, backward)
        assert motion.v() == pytest.approx(way * np.maximum(1.0 - size / INERTIA * motion.t, 0), abs=0.03)
        return
    # At rest it holds 0.8 N m forward and not backward.
    pushed = rotor(actuator=MOTOR, commands=lambda t: [way * 0.8 + 0 * t])
    motion = pushed.moved(pushed.effect("direction_friction"), forward, backward)
    moving = 0.0 if way > 0 else -(0.8 - backward) / INERTIA
    assert motion.v() == pytest.approx(moving * motion.t, abs=1e-2)


@both_ways
def test_friction_that_differs_between_directions_is_coulomb_friction_beside_an_offset(way):
    """As its other name says: the same motion, with the offset given by the motor."""
    differs = rotor((0, way * 1.0), actuator=MOTOR, commands=lambda t: [0 * t])
    effect = differs.effect("direction_friction")
    other = rotor((0, way * 1.0), actuator=MOTOR, commands=lambda t: [-0.4 + 0 * t])
    assert effect.same_as(np.array([1.2, 0.4])) == (
        "Coulomb friction of 0.8 N m and a constant offset of -0.4 N m"
    )
    motion, same = differs.moved(effect, 1.2, 0.4), other.moved(other.effect("coulomb_friction"), 0.8)
    # A smooth sign has a width of the usual speed, which is that of the nominal motion.
    assert motion.v() == pytest.approx(same.v(), abs=5e-3)
    assert abs(motion.v()[-1]) < 0.05


@answers("torque_offset")
@both_ways
@pytest.mark.parametrize(("joint", "unit"), [("", "N m"), ('type="slide"', "N")])
def test_a_constant_torque_accelerates(way, joint, unit):
    free = rotor(joint=joint)
    effect = free.effect("torque_offset")
    assert effect.parameters[0].unit == unit
    motion = free.moved(effect, way * 0.3)
    assert motion.v() == pytest.approx(way * 0.3 / INERTIA * motion.t, abs=1e-9)


@answers("stribeck_friction")
@both_ways
def test_friction_falls_with_speed_as_stribeck_says(way):
    free = rotor((0, way * 1.5))
    effect = free.effect("stribeck_friction")
    dry, excess, speed = 0.5, 0.8, 0.4

    def slowing(t, v):
        return -(dry + excess * np.exp(-((v / speed) ** 2)) * np.tanh(v / width)) / INERTIA

    width = free.rig_motion.joints[0].step_speed
    motion = free.moved(effect, dry, excess, speed)
    fast = motion.t[way * motion.v() > 3 * width]
    known = solve_ivp(slowing, (0, fast[-1]), [1.5], t_eval=fast, rtol=1e-9, atol=1e-9).y[0]
    assert way * motion.v()[: len(fast)] == pytest.approx(known, abs=2e-2)
    # Without the excess it is dry friction.
    plain = free.moved(effect, dry, 0, speed)
    assert plain.x == pytest.approx(free.moved(free.effect("coulomb_friction"), dry).x, abs=1e-12)


@answers("load_friction")
@both_ways
@pytest.mark.parametrize("driving", [True, False])
def test_a_share_of_the_transmitted_torque_is_lost(way, driving):
    # 0.1 through a gear of 20 is 2 N m; the joint turns with it, or is braked by it.
    started = rotor(
        (0, (1 if driving else -1) * way * 8.0),
        actuator='<motor name="a" joint="j" gear="20"/>',
        commands=lambda t: [way * 0.1 + 0 * t],
    )
    motion = started.moved(started.effect("load_friction"), 0.15)
    share = 0.85 if driving else 1.15
    expected = motion.v()[0] + way * 2.0 * share / INERTIA * motion.t
    assert motion.torque[0, :, 0] == pytest.approx(way * 2.0, rel=1e-12)
    assert motion.v() == pytest.approx(expected, abs=1e-9)


@answers("friction_drift")
@both_ways
@pytest.mark.parametrize("kind", ["dry", "viscous"])
def test_friction_warms_away_over_the_session(way, kind):
    free = rotor((0, way * 3.0), joint='frictionloss=".2"', episodes=5, seconds=0.2)
    size, warm, warms_in = 0.4, 0.25, 0.3
    sizes = (size, 0) if kind == "dry" else (0, size)
    slides_at = 1e-3
    motion = free.moved(free.effect("friction_drift"), *sizes, warm, warms_in, slides_at)
    # Newton's law of cooling, from the first episode to the last.
    level = warm + (1 - warm) * np.exp(-np.array([0, 0.25, 0.5, 0.75, 1])[:, None] / warms_in)
    assert np.linspace(-0.5, 0.5, 5) == pytest.approx(free.segments.order)
    if kind == "dry":
        expected = 3.0 - (0.2 + level * size) / INERTIA * motion.t
    else:
        rate = level * size / INERTIA
        expected = 3.0 * np.exp(-rate * motion.t) + 0.2 / INERTIA * np.expm1(-rate * motion.t) / rate
    assert way * motion.x[:, :, 1] == pytest.approx(expected, abs=1e-2)


@answers("friction_drift")
def test_grease_creeps_before_it_slides():
    """Far below the speed at which it slides it is a film: speed falls exponentially."""
    free = rotor((0, 0.01), episodes=5, seconds=0.2)
    size, slides_at = 0.4, 1.0
    motion = free.moved(free.effect("friction_drift"), size, 0, 1, 0.3, slides_at)
    expected = 0.01 * np.exp(-size / slides_at / INERTIA * motion.t)
    assert motion.x[:, :, 1] == pytest.approx(np.tile(expected, (5, 1)), rel=1e-3)


# --- Inertia


@answers("armature")
@pytest.mark.parametrize("more", [0.06, -0.03])
def test_a_rotor_slows_a_pendulum_and_its_weight_does_not(more):
    hanging = pendulum(0.02, joint='armature=".05"')
    motion = hanging.moved(hanging.effect("armature"), more)
    inertia = MASS * ARM**2 + 0.05 + more
    swing = small_swing(motion.t, 0.02, inertia, MASS * GRAVITY * ARM)
    assert motion.q() == pytest.approx(swing, abs=0.02 * 5e-3)


@answers("payload")
def test_a_load_swings_and_tilts_with_a_pendulum():
    hanging = pendulum(0.02)
    effect = hanging.effect("payload")
    assert [p.start for p in effect.parameters] == pytest.approx([0, 0, 0, -2 * ARM], abs=1e-9)
    load, depth = 0.2, 0.7
    motion = hanging.moved(effect, load, 0, 0.5, -depth)  # along the hinge it does not matter where
    inertia = MASS * ARM**2 + load * depth**2
    swing = small_swing(motion.t, 0.02, inertia, GRAVITY * (MASS * ARM + load * depth))
    assert motion.q() == pytest.approx(swing, abs=0.02 * 5e-3)


@both_ways
def test_a_load_at_the_side_turns_a_pendulum_to_where_both_balance(way):
    load, side, depth = 0.2, way * 0.3, 0.1
    # A turn by q brings (x, z) to x cos q + z sin q, of which the sum over both masses is zero.
    tilt = np.arctan2(load * side, MASS * ARM + load * depth)
    balanced = pendulum(tilt)
    motion = balanced.moved(balanced.effect("payload"), load, side, 0, -depth)
    assert motion.q() == pytest.approx(tilt, abs=1e-9)
    assert np.abs(balanced.nominal.q() - tilt).max() > 0.1


@answers("link_mass")
@pytest.mark.parametrize("excess", [0.5, -0.3])
def test_mass_and_inertia_scale_as_one(excess):
    pushed = rotor(actuator=MOTOR, commands=lambda t: [0.7 + 0 * t])
    motion = pushed.moved(pushed.effect("link_mass"), excess)
    assert motion.v() == pytest.approx(0.7 / (INERTIA * (1 + excess)) * motion.t, rel=1e-9)
    # A pendulum of another mass swings as ever.
    hanging = pendulum(0.5)
    assert hanging.moved(hanging.effect("link_mass"), excess).q() == pytest.approx(
        hanging.nominal.q(), abs=1e-9
    )


# --- Torques that depend on the angle


@answers("spring")
@pytest.mark.parametrize(("stiffness", "torque"), [(8.0, 0.0), (8.0, 1.6), (8.0, -1.6), (0.0, 0.5)])
def test_a_spring_swings_a_joint_about_its_equilibrium(stiffness, torque):
    free = rotor((0.3, 0))
    effect = free.effect("spring")
    assert free.rig_motion.joints[0].middle == pytest.approx(0.3)
    motion = free.moved(effect, stiffness, torque)
    if stiffness:
        rest = 0.3 + torque / stiffness
        expected = rest + (0.3 - rest) * np.cos(np.sqrt(stiffness / INERTIA) * motion.t)
    else:
        expected = 0.3 + torque / INERTIA * motion.t**2 / 2
    assert motion.q() == pytest.approx(expected, abs=2e-3)


@answers("torque_ripple")
@both_ways
def test_ripple_gives_back_after_a_period_what_it_took(way):
    free = rotor((0.0, way * 3.0))
    middle, order, sine, cosine = free.rig_motion.joints[0].middle, 9.0, 0.3, 0.2
    motion = free.moved(free.effect("torque_ripple"), sine, cosine, order)
    angle, first = order * (motion.q() - middle), order * (0.0 - middle)
    work = (sine * (np.cos(first) - np.cos(angle)) + cosine * (np.sin(angle) - np.sin(first))) / order
    energy = INERTIA * 3.0**2 / 2 + work
    assert INERTIA * motion.v() ** 2 / 2 == pytest.approx(energy, abs=3e-3)
    assert np.ptp(energy) > 0.05


def test_the_orders_of_ripple_reach_from_the_travel_to_a_twelfth_of_it():
    """They lie less than a period over the travel apart, so that every order is near one of them."""
    turned = rotor((0.0, 3.0))
    orders = [e.parameters[2].start for e in turned.effects if e.name == "torque_ripple"]
    travel = np.ptp(turned.nominal.q())
    periods = 2 * np.pi / np.array(orders)
    assert periods.max() == pytest.approx(travel, rel=0.1)
    assert periods.min() < travel / 12
    assert np.diff(orders).max() * travel / (2 * np.pi) < 0.75


@answers("joint_offset")
@both_ways
def test_a_zero_that_is_off_turns_gravity_and_leaves_the_servo_and_springs(way):
    offset = way * 0.15
    hanging = pendulum(offset)
    effect = hanging.effect("joint_offset", variant="geometry")
    assert hanging.moved(effect, offset).q() == pytest.approx(offset, abs=1e-12)
    # A servo holds the reading against the weight of where the mass is.
    kp, told = 30.0, 0.4
    held = pendulum(
        told, 'damping="6"', f'<position name="a" joint="j" kp="{kp}"/>', lambda t: [told + 0 * t]
    )
    end = held.moved(held.effect("joint_offset", variant="geometry"), offset).q()[-1]
    assert kp * (told - end) == pytest.approx(MASS * GRAVITY * ARM * np.sin(end - offset), abs=1e-2)
    # A spring rests at the same reading.
    sprung = rotor((0.2, 0), joint='stiffness="5" ref="10" springref="20"')
    effect = sprung.effect("joint_offset", variant="geometry")
    assert sprung.moved(effect, offset).q() == pytest.approx(sprung.nominal.q(), abs=1e-12)
    # What is off in the recorded encoder only shows there.
    effect = held.effect("joint_offset", variant="recorded alone")
    motion = held.moved(effect, offset)
    assert np.array_equal(motion.x, held.nominal.x)
    assert motion.y == pytest.approx(held.nominal.y + offset, abs=1e-15)


@answers("gravity_tilt")
@both_ways
def test_a_pendulum_on_a_tilted_base_hangs_along_gravity(way):
    tilt = way * 0.2
    hanging = pendulum(-tilt)  # the base turned by tilt about y: as seen from it, the mass turned back
    effect = hanging.effect("gravity_tilt")
    assert [p.name for p in effect.parameters] == ["about_x", "about_y"]
    assert hanging.moved(effect, 0, tilt).q() == pytest.approx(-tilt, abs=1e-9)
    # A base that is turned about x lifts its y axis: what slides along it slides back.
    rail = bench(
        f"""<option gravity="0 0 {-GRAVITY}"/><worldbody><body name="b">
        <joint name="j" type="slide" axis="0 1 0"/><geom size=".1"/></body></worldbody>""",
        {"q": reads(joint="j", unit="m")}, episodes=1,
    )  # fmt: skip
    motion = rail.moved(rail.effect("gravity_tilt"), tilt, 0)
    assert motion.v() == pytest.approx(-GRAVITY * np.sin(tilt) * motion.t, abs=1e-9)


# --- Actuators

SERVO = '<position name="a" joint="j" kp="50" kv="3"/>'


@answers("actuator_gain")
@pytest.mark.parametrize("excess", [0.3, -0.4])
@pytest.mark.parametrize("variant", ["whole", "stiffness"])
def test_a_gain_scales_torque_or_the_stiffness_alone(excess, variant):
    pushed = rotor(actuator='<motor name="a" joint="j" gear="3"/>', commands=lambda t: [0.2 + 0 * t])
    motion = pushed.moved(pushed.effect("actuator_gain"), excess)
    assert motion.v() == pytest.approx(0.6 * (1 + excess) / INERTIA * motion.t, rel=1e-9)
    served = rotor(actuator=SERVO, commands=lambda t: [0.3 + 0 * t])
    motion = served.moved(served.effect("actuator_gain", variant=variant), excess)
    damping = 3 * (1 + excess) if variant == "whole" else 3
    system = np.array([[0, 1], [-50 * (1 + excess) / INERTIA, -damping / INERTIA]])
    expected = [0.3 - (expm(system * t) @ [0.3, 0])[0] for t in motion.t]
    assert motion.q() == pytest.approx(expected, abs=5e-3)


def test_a_velocity_servo_follows_its_command_whatever_its_gain():
    served = rotor(actuator='<velocity name="a" joint="j" kv="4"/>', commands=lambda t: [0.7 + 0 * t])
    motion = served.moved(served.effect("actuator_gain"), 0.5)
    assert motion.v() == pytest.approx(0.7 * -np.expm1(-4 * 1.5 / INERTIA * motion.t), abs=2e-2)
    assert motion.v()[-1] == pytest.approx(0.7, abs=1e-3)


def test_knees_of_a_limit():
    """By the formula as it is written, and nothing far below the limit."""
    link = '<body><joint name="j"/><geom size=".1"/></body>'
    model = mujoco.MjModel.from_xml_string(
        f"<mujoco><worldbody>{link}</worldbody>"
        "<actuator><motor name='m' joint='j' gear='3'/></actuator></mujoco>"
    )
    limit = Saturation("m", 0, 2.0, Parameter("cut", "1", 0.4, low=0.0, high=0.98, probe=0.2))
    force = np.array([0.01, -0.6, 0.99, 1.0, -1.5, 40.0])
    dof, found = limit.soft_limit(model, force[:, None], np.array([0.5]))
    assert dof == 0
    for sharpness, column in zip(SHARPNESS, found.T, strict=True):
        soft = force / (1 + np.abs(force) ** sharpness) ** (1 / sharpness)
        assert column == pytest.approx(3 * (soft - np.clip(force, -1, 1)), abs=1e-12)
    assert np.abs(found[0]).max() < 1e-12
    assert np.abs(found[3]).min() > 0.05
    # Where nothing is cut off, nothing gives in.
    assert np.all(limit.soft_limit(model, force[:, None], np.array([0.0]))[1] == 0)


@answers("saturation")
@both_ways
def test_torque_is_clipped_before_the_gear(way):
    """At 2.5 of 4, through a gear of 5; where the model allows 1.5 to one side, that stays."""
    limits = 'gear="5" forcerange="-1.5 10"'
    pushed = rotor(
        actuator=f'<motor name="a" joint="j" {limits}/>', commands=lambda t: [np.where(t < 0.4, 4, way * 4)]
    )
    assert pushed.rig_motion.joints[0].largest == pytest.approx((4.0,))
    motion = pushed.moved(pushed.effect("saturation"), 1 - 2.5 / 4)
    at = np.interp([0.4, 0.498], motion.t, motion.v())
    assert at[0] == pytest.approx(2.5 * 5 / INERTIA * 0.4, rel=1e-9)
    assert at[1] - at[0] == pytest.approx((2.5 if way > 0 else -1.5) * 5 / INERTIA * 0.098, rel=1e-9)


def stepped(t: Array, seed: int = 0) -> Array:
    """Commands that hold for 20 ms each."""
    return np.random.default_rng(seed).normal(size=200)[np.floor(t / 0.02 + 1e-9).astype(int)]


def impulse(t: Array, seed: int = 0) -> Array:
    """Integral of `stepped` from 0 to t; before 0 the first command held."""
    ends = np.arange(201) * 0.02
    told = stepped(ends[:-1] + 0.01, seed)
    return np.where(t < 0, t * told[0], np.interp(t, ends, np.concatenate([[0], np.cumsum(told * 0.02)])))


@answers("command_delay")
@pytest.mark.parametrize("delay", [0.0003, 0.004, 0.0107, 0.45])
def test_a_delay_shifts_the_response_by_itself(delay):
    """Exact for any share of a step: a mass that is pushed integrates the commands."""
    pushed = rotor(actuator=MOTOR, commands=lambda t: [stepped(t)])
    motion = pushed.moved(pushed.effect("command_delay"), delay)
    late = impulse(motion.t - delay) - impulse(np.array(-delay))
    assert motion.v() == pytest.approx(late / INERTIA, abs=1e-10)


@answers("actuator_lag")
@pytest.mark.parametrize("constant", [1e-4, 0.007, 0.3])
def test_a_lag_answers_a_step_with_an_exponential(constant):
    """From steady at 1, a step to 3 at 0.1 s."""
    pushed = rotor(actuator=MOTOR, commands=lambda t: [np.where(t < 0.1, 1.0, 3.0)])
    motion = pushed.moved(pushed.effect("actuator_lag"), constant)
    after = np.maximum(motion.t - 0.1, 0)
    given = motion.t + 2 * (after - constant * -np.expm1(-after / constant))
    assert motion.v() == pytest.approx(given / INERTIA, abs=1e-10)


def test_a_mocap_body_is_delayed_as_a_whole():
    """Two of them beside an actuator: its three coordinates and its quaternion, which stand apart."""
    bodies = "".join(f'<body name="m{i}" mocap="true"/>' for i in (1, 2))
    link = '<body><joint name="j"/><geom size=".1"/></body>'
    model = mujoco.MjModel.from_xml_string(
        f"<mujoco><worldbody>{bodies}{link}</worldbody>"
        "<actuator><motor name='m' joint='j'/></actuator></mujoco>"
    )
    delays = {d.part: d for d in CommandDelay.instances(SimpleNamespace(model=model))}
    assert set(delays) == {"m", "m1", "m2"}
    u = np.arange(20.0)[:, None] + 100 * np.arange(1 + 2 * 7)
    moved = delays["m2"].control(u, 0.1, np.array([0.2])) != u
    assert np.flatnonzero(moved.any(axis=0)).tolist() == [4, 5, 6, 11, 12, 13, 14]


@pytest.mark.parametrize("name", ["command_delay", "actuator_lag"])
def test_delay_and_lag_converge_with_the_square_of_the_step(name):
    """Of a smooth command, whose means over steps are told."""
    errors = []
    for step in (0.004, 0.002):
        edges = np.arange(round(0.4 / step) + 1) * step
        told = (np.diff(-np.cos(20 * edges)) / (20 * step))[:, None]
        pushed = rotor(actuator=MOTOR, commands=lambda t: [0 * t])
        effect = pushed.effect(name)
        got = np.cumsum(effect.control(told, step, np.array([0.0133]))[:, 0]) * step
        if name == "command_delay":
            late = edges[1:] - 0.0133
            first = told[0, 0]
            known = np.where(late < 0, late * first, (1 - np.cos(20 * late)) / 20) + 0.0133 * first
        else:
            known = solve_ivp(
                lambda t, c: [(np.sin(20 * t) - c[0]) / 0.0133, c[0]], (0, 0.4), [told[0, 0], 0],
                t_eval=edges[1:], rtol=1e-10, atol=1e-12,
            ).y[1]  # fmt: skip
        # The first command, of the first half step, held before: an error of the first order that passes.
        errors.append(np.abs(np.diff(got - known)[len(got) // 2 :]).max() / step)
    assert errors[1] < 0.3 * errors[0]


# --- Readings


@answers("encoder_delay")
@pytest.mark.parametrize("delay", [0.013, -0.006])
def test_a_reading_is_of_an_earlier_time(delay):
    pushed = rotor(actuator=MOTOR, commands=lambda t: [0.5 + 0 * t])
    motion = pushed.moved(pushed.effect("encoder_delay"), delay)
    assert np.array_equal(motion.x, pushed.nominal.x)
    # With constant acceleration the second order is all: Euler's steps lead by half of one.
    t = motion.t - delay
    assert motion.y[0, :, 0] == pytest.approx(0.5 / INERTIA * (t**2 + t * STEP) / 2, abs=1e-9)


@answers("encoder_scale")
@pytest.mark.parametrize("excess", [0.1, -0.05])
def test_an_encoder_that_is_off_by_a_factor(excess):
    served = rotor((0.1, 0), actuator=SERVO, commands=lambda t: [0.4 + 0 * t], seconds=1.5)
    alone = served.moved(served.effect("encoder_scale", variant="recorded encoder alone"), excess)
    assert np.array_equal(alone.x, served.nominal.x)
    assert alone.y == pytest.approx((1 + excess) * served.nominal.y, rel=1e-12)
    # The servo brings the reading where it is told; damping is of the reading's rate, too.
    read = served.moved(served.effect("encoder_scale", variant="servo reads too"), excess)
    assert read.q()[-1] == pytest.approx(0.4 / (1 + excess), abs=1e-5)
    assert read.y[0, -1, 0] == pytest.approx(0.4, abs=1e-5)
    factor = 1 + excess
    system = np.array([[0, 1], [-50 * factor / INERTIA, -3 * factor / INERTIA]])
    gone = 0.1 - 0.4 / factor
    expected = [0.4 / factor + (expm(system * t) @ [gone, 0])[0] for t in read.t]
    assert read.q() == pytest.approx(expected, abs=5e-3)


# --- Free bodies


@answers("linear_drag")
def test_linear_drag_stops_and_lets_fall_at_the_terminal_velocity():
    drag = 3.0
    level = flying((2, -1, 0))
    motion = level.moved(level.effect("linear_drag"), drag)
    left = np.exp(-drag / MASS * motion.t)
    for i, v in enumerate((2, -1)):
        assert motion.v(i) == pytest.approx(v * left, abs=1e-2)
    falling = flying((0, 0, 0), GRAVITY, seconds=2.0)
    motion = falling.moved(falling.effect("linear_drag"), drag)
    assert motion.v(2)[-1] == pytest.approx(-MASS * GRAVITY / drag, rel=1e-3)


@answers("quadratic_drag")
def test_quadratic_drag_stops_and_lets_fall_at_the_terminal_velocity():
    drag = 0.4
    level = flying((3, -4, 0))
    motion = level.moved(level.effect("quadratic_drag"), drag)
    left = 1 / (1 + drag * 5 / MASS * motion.t)
    for i, v in enumerate((3, -4)):
        assert motion.v(i) == pytest.approx(v * left, abs=2e-2)
    falling = flying((0, 0, 0), GRAVITY, seconds=2.0)
    motion = falling.moved(falling.effect("quadratic_drag"), drag)
    assert motion.v(2)[-1] == pytest.approx(-np.sqrt(MASS * GRAVITY / drag), rel=1e-3)


@answers("spin_lift")
@both_ways
def test_spin_turns_a_path_across_axis_and_velocity(way):
    """About +z it turns to the left: a circle of radius m v / S."""
    level = flying((2, 0, 0))
    motion = level.moved(level.effect("spin_lift"), 0, 0, way * 1.5)
    angle = way * 1.5 / MASS * motion.t
    assert motion.v(0) == pytest.approx(2 * np.cos(angle), abs=1e-2)
    assert motion.v(1) == pytest.approx(2 * np.sin(angle), abs=1e-2)
    # Backspin lifts: about -y, moving along +x.
    lifted = level.moved(level.effect("spin_lift"), 0, -way * 1.5, 0)
    assert lifted.v(2) == pytest.approx(2 * np.sin(angle), abs=1e-2)


@answers("wind")
@both_ways
def test_wind_accelerates_by_its_force_over_the_mass(way):
    level = flying((0, 1, 0), GRAVITY)
    motion = level.moved(level.effect("wind"), way * 0.3, -0.1)
    assert motion.v(0) == pytest.approx(way * 0.3 / MASS * motion.t, abs=1e-9)
    assert motion.v(1) == pytest.approx(1 - 0.1 / MASS * motion.t, abs=1e-9)
    assert motion.v(2) == pytest.approx(level.nominal.v(2), abs=1e-12)


@answers("buoyancy")
def test_buoyancy_slows_a_fall_by_the_weight_of_the_air():
    """A table tennis ball, whose air weighs 1.5 % of it, falls with so much less."""
    level = flying((2, 0, 0), GRAVITY)
    share = 1.2 * 4 / 3 * np.pi * 0.02**3 / 0.0027
    motion = level.moved(level.effect("buoyancy"), share * MASS * GRAVITY)
    assert motion.v(2) == pytest.approx((share - 1) * GRAVITY * motion.t, abs=1e-9)
    assert motion.v(0) == pytest.approx(level.nominal.v(0), abs=1e-12)
    assert f"gravcomp of {share:.4g}" in level.effect("buoyancy").note(np.array([share * MASS * GRAVITY]))


def test_effects_add_up():
    """Two at once: drag and wind give the speed at which both balance."""
    level = flying((0.2, 0, 0), seconds=2.0)
    pair = (level.effect("linear_drag"), level.effect("wind"))
    hypothesis = Hypothesis(level.rig, pair)
    assert hypothesis.slices == (slice(0, 1), slice(1, 3))
    state = level.nominal
    v = np.array([[0.2, 0, 0, 0, 0, 0]])
    at = State(state.x[0, :1, :7], v, np.zeros((1, 6)), np.zeros(1), np.zeros(1))
    assert hypothesis.force(at, np.array([3.0, 0.6, 0.0])) == pytest.approx(np.zeros((1, 6)), abs=1e-12)


def test_ripple_is_told_by_its_amplitude_and_its_phase_at_angle_zero():
    """The same torque as its sine and cosine about the middle of the travel."""
    effect = rotor((0.0, 3.0)).effect("torque_ripple")
    values = np.array([0.03, -0.02, 5.0])
    told = effect.same_as(values)
    amplitude, inside = float(told.split()[0]), told.split("sin(")[1].split(")")[0]
    order, phase = float(inside.split()[0]), float(inside.split()[2])
    angle = np.linspace(-1, 1, 9)
    about = values[2] * (angle - effect._joint.middle)
    expected = values[0] * np.sin(about) + values[1] * np.cos(about)
    np.testing.assert_allclose(amplitude * np.sin(order * angle + phase), expected, atol=1e-4)
