"""The linear system against closed forms, MuJoCo's own derivatives and differences of whole simulations."""

from collections.abc import Callable
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from mujoco import MjSpec
from scipy.optimize import brentq
from slapshot.diagnosis.fit.linear import STEP_ERROR, Linearised, linearise, perturbations_of
from slapshot.diagnosis.model.hypothesis import Hypothesis, Simulator
from slapshot.diagnosis.model.rig import Rig, bind
from slapshot.diagnosis.model.rig_motion import rig_motion
from slapshot.diagnosis.model.segments import Segments, segment_recording
from slapshot.diagnosis.selection.free_forms import FreeForce, free_forms
from slapshot.effects.joints.actuator_gain import ActuatorGain
from slapshot.effects.joints.actuator_lag import ActuatorLag
from slapshot.effects.joints.armature import Armature
from slapshot.effects.joints.command_delay import CommandDelay
from slapshot.effects.joints.coulomb_friction import CoulombFriction
from slapshot.effects.joints.direction_friction import DirectionFriction
from slapshot.effects.joints.effect import JointEffect, RigMotion, State
from slapshot.effects.joints.encoder_delay import EncoderDelay
from slapshot.effects.joints.joint_offset import JointOffset
from slapshot.effects.joints.link_mass import LinkMass
from slapshot.effects.joints.spring import Spring
from slapshot.effects.joints.stribeck_friction import StribeckFriction
from slapshot.effects.joints.viscous_friction import ViscousFriction
from slapshot.recordings.channels import QUATERNION, Channel

from .mechanisms import ARM, BRICK, CART, HANGER, PENDULUM, control_channel, joint, place, recording

NONE = np.zeros(0)
INERTIA = 1 / 12 + 0.25


def made(
    text: str,
    channels: dict[str, Channel],
    nodes: int,
    interval: float,
    *,
    jitter: float = 0.0,
    seed: int = 0,
) -> tuple[Rig, Segments]:
    """A rig and segments of the right shapes, with random controls; what was recorded does not matter."""
    rng = np.random.default_rng(seed)
    t = np.arange(nodes) * interval
    t[1:-1] += rng.uniform(-jitter, jitter, nodes - 2)
    data = {
        # Parts of a quaternion whose length is 1.
        name: (channel, np.full(nodes, 0.5) if channel.component in QUATERNION else rng.normal(size=nodes))
        for name, channel in channels.items()
    }
    taken = recording(t, data)
    rig = bind(MjSpec.from_string(text), taken.channels)
    segments = segment_recording(taken, rig, segment_s=nodes * interval)
    # Jitter moves the median a little; nothing here shall depend on that.
    return rig, replace(segments, interval=interval) if not jitter else segments


def random_path(rig: Rig, segments: Segments, seed: int, size: float = 0.5) -> np.ndarray:
    """States that have nothing to do with each other; quaternions are random rotations."""
    simulator, rng = Simulator(rig), np.random.default_rng(seed)
    x = np.zeros((*segments.shape, simulator.tangent.size))
    x[..., : rig.model.nq] = rig.model.qpos0
    return simulator.tangent.add(x, size * rng.normal(size=(*segments.shape, simulator.tangent.dim)))


def own_path(
    rig: Rig, hypothesis: Hypothesis, segments: Segments, theta: np.ndarray, start: np.ndarray
) -> np.ndarray:
    """The trajectory that a hypothesis goes itself, by MuJoCo's plain step."""
    model = hypothesis.compiled(theta, segments.step)
    data = mujoco.MjData(model)
    nq, nv = model.nq, model.nv
    data.qpos[:], data.qvel[:], data.act[:] = start[:nq], start[nq : nq + nv], start[nq + nv :]
    control = hypothesis.control(segments, theta)[0]
    trajectory = []
    for t in range(segments.shape[1]):
        trajectory.append(np.concatenate([data.qpos, data.qvel, data.act]))
        for u in control[t]:
            data.ctrl[:] = u
            if hypothesis.has_force:
                mujoco.mj_forward(model, data)
                data.qfrc_applied[:] = hypothesis.force(_state(data, segments, t), theta)[0]
            mujoco.mj_step(model, data)
    return np.array(trajectory)[None]


def _state(data: mujoco.MjData, segments: Segments, t: int) -> State:
    time = np.array([segments.time[0, t]])
    return State(data.qpos[None], data.qvel[None], data.qfrc_actuator[None], time, np.zeros(1))


def accumulated(found: Linearised, column: int) -> np.ndarray:
    """(L, ny) change of the observations by a parameter, along a trajectory that starts where it starts."""
    system = found.system
    X, out = np.zeros(system.d.shape[2]), []
    for t in range(system.d.shape[1]):
        out.append(system.C[0, t] @ X + system.psi[0, t, :, column])
        X = system.A[0, t] @ X + system.W[0, t, :, column]
    return np.array(out)


@pytest.mark.parametrize(("interval", "substeps"), [(0.01, 1), (0.04, 4)])
def test_the_double_integrator_in_closed_form(interval, substeps):
    """MuJoCo's Euler step moves the position by the new velocity."""
    channels = {"place": joint("rail", unit="m"), "rate": joint("rail", "velocity", "m/s")}
    rig, segments = made(CART, channels | {"push": control_channel("N", actuator="push")}, 30, interval)
    assert segments.substeps == substeps
    trajectory = random_path(rig, segments, 1)
    system = linearise(Simulator(rig), Hypothesis(rig), NONE, segments, trajectory).system
    h, k, mass = 0.01, substeps, 2.0
    np.testing.assert_allclose(system.A, np.broadcast_to([[1, interval], [0, 1]], system.A.shape), atol=1e-7)
    B = np.array([[h**2 * k * (k + 1) / 2 / mass], [interval / mass]])
    np.testing.assert_allclose(system.B, np.broadcast_to(B, system.B.shape), rtol=1e-6)
    np.testing.assert_allclose(system.C, np.broadcast_to(np.eye(2), system.C.shape), atol=1e-7)
    # The defect is where the model goes, less the next state of the trajectory.
    u = segments.control()[..., 0]
    place_, speed = trajectory[..., 0].copy(), trajectory[..., 1].copy()
    for step in range(k):
        speed += h * u[..., step] / mass
        place_ += h * speed
    np.testing.assert_allclose(system.d[:, :-1, 0], place_[:, :-1] - trajectory[:, 1:, 0], atol=1e-12)
    np.testing.assert_allclose(system.d[:, :-1, 1], speed[:, :-1] - trajectory[:, 1:, 1], atol=1e-12)
    np.testing.assert_allclose(system.r, segments.y - trajectory, atol=1e-12)


def test_friction_holds_a_joint_against_known_forces_but_not_against_errors_of_its_law():
    """A cart at rest, and one that slides: Coulomb friction of 3 N, a controller that pushes with 1 N."""
    text = CART.replace(
        "<joint ", '<joint frictionloss="3" solreffriction="-1 -100" solimpfriction="0.9999 0.9999 0.001" '
    )
    channels = {"place": joint("rail", unit="m"), "push": control_channel("N", actuator="push")}
    rig, segments = made(text, channels, 30, 0.01)
    segments = replace(segments, controls=(np.ones_like(segments.controls[0]),))
    force = np.array([[0.01**2 / 2.0], [0.01 / 2.0]])  # by MuJoCo's Euler step, 2 kg
    for speed, held in ((0.0, True), (0.7, False)):
        trajectory = np.zeros((*segments.shape, 2))
        trajectory[..., 1] = speed
        system = linearise(Simulator(rig), Hypothesis(rig), NONE, segments, trajectory).system
        known = 0 * force if held else force
        np.testing.assert_allclose(system.B, np.broadcast_to(known, system.B.shape), atol=1e-3 * force[1, 0])
        assert system.process is not None
        np.testing.assert_allclose(system.process, np.broadcast_to(force, system.B.shape), rtol=1e-6)
    rig, segments = made(CART, channels, 30, 0.01)
    free = linearise(Simulator(rig), Hypothesis(rig), NONE, segments, trajectory).system
    assert free.process is None


def test_the_process_force_acts_on_the_inertia_of_the_nominal_model():
    """A cart twice as heavy: what is known moves it half as much, the process force as before."""
    channels = {"place": joint("rail", unit="m"), "push": control_channel("N", actuator="push")}
    rig, segments = made(CART, channels, 30, 0.01)
    trajectory = random_path(rig, segments, 5)
    (mass,) = LinkMass.instances(rig_motion(rig, segments, trajectory))
    heavier = Hypothesis(rig, (mass,))
    force = np.array([[0.01**2 / 2.0], [0.01 / 2.0]])
    system = linearise(Simulator(rig), heavier, np.array([1.0]), segments, trajectory).system
    np.testing.assert_allclose(system.B, np.broadcast_to(force / 2, system.B.shape), rtol=1e-6)
    assert system.process is not None
    np.testing.assert_allclose(system.process, np.broadcast_to(force, system.B.shape), rtol=1e-6)
    assert linearise(Simulator(rig), heavier, np.array([0.0]), segments, trajectory).system.process is None


def test_the_pendulum_in_closed_form():
    """With damping taken implicitly, (I + h d) v' = I v + h (u - m g l sin q)."""
    rig, segments = made(
        PENDULUM, {"angle": joint("swing"), "drive": control_channel(actuator="drive")}, 40, 0.01
    )
    trajectory = random_path(rig, segments, 2)
    found = linearise(Simulator(rig), Hypothesis(rig), NONE, segments, trajectory)
    q = trajectory[..., 0]
    h, d, mgl = 0.01, 0.05, 9.81 * 0.5
    to_v = np.stack([-h * mgl * np.cos(q), np.full_like(q, INERTIA)], -1) / (INERTIA + h * d)
    to_q = np.array([1.0, 0.0]) + h * to_v
    # One-sided differences of 1e-6: the second derivative, h m g l / I < 1, leaves 1e-6.
    np.testing.assert_allclose(found.system.A, np.stack([to_q, to_v], -2), atol=1e-6)
    force = h / (INERTIA + h * d)
    np.testing.assert_allclose(found.system.B[..., 1, 0], force, rtol=1e-6)
    np.testing.assert_allclose(found.system.B[..., 0, 0], h * force, rtol=1e-6)
    np.testing.assert_allclose(found.torque[..., 0], segments.control()[..., 0, 0], atol=1e-12)


LAGGED = PENDULUM.replace(
    '<motor name="drive" joint="swing"/>',
    '<general name="drive" joint="swing" dyntype="filter" dynprm="0.05" gainprm="2"/>',
)
MODELS = {
    "pendulum": (PENDULUM, {"a": joint("swing"), "r": joint("swing", "velocity", "rad/s")}),
    "arm": (
        ARM,
        {"e": joint("elbow"), "z": place("site", "hand", "z"), "v": place("site", "hand", "x", "velocity")},
    ),
    "brick": (BRICK, {c: place("body", "brick", c) for c in ("x", "z", *QUATERNION)}),
    "hanger": (HANGER, {c: joint("hook", unit="1", component=c) for c in QUATERNION}),
    "lagged": (LAGGED, {"a": joint("swing"), "m": joint("swing", "torque", "N m")}),
}


@pytest.mark.parametrize("name", MODELS)
def test_derivatives_of_one_step_are_mujocos(name):
    text, channels = MODELS[name]
    timestep = MjSpec.from_string(text).compile().opt.timestep
    rig, segments = made(text, channels, 20, timestep, seed=3)
    trajectory = random_path(rig, segments, 4)
    system = linearise(Simulator(rig), Hypothesis(rig), NONE, segments, trajectory).system
    model, dim = rig.model, Simulator(rig).tangent.dim
    data = mujoco.MjData(model)
    A, C = np.zeros((dim, dim)), np.zeros((model.nsensordata, dim))
    rows = [o.address for o in rig.observations]
    for t in range(20):
        x = trajectory[0, t]
        data.qpos[:], data.qvel[:] = x[: model.nq], x[model.nq : model.nq + model.nv]
        data.act[:] = x[model.nq + model.nv :]
        data.ctrl[:] = segments.control()[0, t, 0]
        mujoco.mjd_transitionFD(model, data, 1e-6, True, A, None, C, None)
        # One-sided against centred differences: second derivatives of order 10 times 1e-5 at most.
        np.testing.assert_allclose(system.A[0, t], A, atol=1e-4)
        np.testing.assert_allclose(system.C[0, t], C[rows], atol=1e-4)


@pytest.mark.parametrize("integrator", ["RK4", "implicitfast"])
def test_derivatives_of_several_steps_are_those_of_the_whole_interval(integrator):
    """They are taken in the middle of an interval: of second order in it, for every integrator."""
    errors = []
    for interval in (0.02, 0.01):
        text = ARM.replace("implicitfast", integrator)
        assert integrator in text
        rig, segments = made(text, {"e": joint("elbow")}, 10, interval, seed=11)
        segments = segments.finer(4)
        simulator, hypothesis = Simulator(rig), Hypothesis(rig)
        trajectory = random_path(rig, segments, 12)
        system = linearise(simulator, hypothesis, NONE, segments, trajectory).system
        n, nv = 10, rig.model.nv
        x, u = trajectory.reshape(n, -1), segments.control().reshape(n, segments.substeps, -1)
        model = hypothesis.compiled(NONE, segments.step)
        A = np.empty((n, 2 * nv, 2 * nv))
        for i, delta in enumerate(1e-6 * np.eye(2 * nv)):
            ends = [simulator.run(model, x + sign * delta, u)[0] for sign in (1, -1)]
            A[:, :, i] = (ends[0] - ends[1]) / 2e-6
        B = np.empty((n, 2 * nv, nv))
        for i, force in enumerate(1e-3 * np.eye(nv)):
            ends = [simulator.run(model, x, u, sign * np.tile(force, (n, 1)))[0] for sign in (1, -1)]
            B[:, :, i] = (ends[0] - ends[1]) / 2e-3
        there = (system.A.reshape(A.shape) - np.eye(2 * nv), system.B.reshape(B.shape))
        pairs = zip(there, (A - np.eye(2 * nv), B), strict=True)
        errors.append([np.linalg.norm(own - true) / np.linalg.norm(true) for own, true in pairs])
    assert np.all(np.array(errors[1]) < 0.02)
    assert np.all(np.array(errors[1]) < 0.35 * np.array(errors[0]))


@pytest.mark.parametrize("integrator", ["RK4", "implicitfast"])
def test_where_a_stop_is_just_hit_derivatives_are_wide_differences_over_the_interval(integrator):
    """A mass whose state in the middle of an interval lies less than a difference's step before its stop."""
    text = f"""<option timestep="0.0025" gravity="0 0 0" integrator="{integrator}"/><worldbody><body>
    <joint name="rail" type="slide" axis="1 0 0" limited="true" range="-1 0" solreflimit="0.02 1"/>
    <geom size=".05" mass="1"/></body></worldbody>"""
    rig, segments = made(f"<mujoco>{text}</mujoco>", {"x": joint("rail", unit="m")}, 3, 0.01)
    segments = segments.finer(4)
    simulator, hypothesis = Simulator(rig), Hypothesis(rig)
    model, nothing = hypothesis.compiled(NONE, segments.step), np.zeros((1, segments.substeps, 0))

    def goes(place: float) -> np.ndarray:
        return simulator.run(model, np.array([[place, 1.0]]), nothing)[0][0]

    middle = 0.5 if integrator == "RK4" else 0.5 - 0.5 / segments.substeps
    near = brentq(lambda at: at + middle * (goes(at)[0] - at) + 5e-7, -0.02, -1e-4, xtol=1e-9)
    trajectory = np.tile(goes(near), (1, segments.shape[1], 1))
    trajectory[0, :2] = [-0.5, 1.0], [near, 1.0]
    found = linearise(simulator, hypothesis, NONE, segments, trajectory).system
    assert found.A[0, 0] == pytest.approx(np.array([[1, 0.01], [0, 1]]), abs=1e-8)
    wide = (goes(near + 1e-4) - goes(near)) / 1e-4
    assert found.A[0, 1, :, 0] == pytest.approx(wide, rel=1e-6)
    # Of a force: at most what it does without the stop, within what the stop's damping changes.
    assert found.B[0, 1, 1] == pytest.approx(0.01, rel=0.5)


def test_a_path_that_the_model_goes_has_no_defect():
    for name, (text, channels) in MODELS.items():
        rig, segments = made(text, channels, 20, 0.02, seed=5)
        start = random_path(rig, segments, 6)[0, 0]
        trajectory = own_path(rig, Hypothesis(rig), segments, NONE, start)
        system = linearise(Simulator(rig), Hypothesis(rig), NONE, segments, trajectory).system
        np.testing.assert_allclose(system.d[:, :-1], 0, atol=1e-10, err_msg=name)


def arm_situation(
    nodes: int = 60, interval: float = 0.01, finer: int = 1, text: str = ARM
) -> tuple[Rig, Segments, RigMotion, np.ndarray]:
    """The arm along a trajectory of its own, its servo told a slow sine."""
    t = np.arange(nodes) * interval
    channels = {
        "s": (joint("shoulder"), np.sin(t)),
        "e": (joint("elbow"), np.sin(t)),
        "servo": (control_channel("rad", actuator="servo"), 0.6 * np.sin(5 * t)),
    }
    taken = recording(t, channels)
    rig = bind(MjSpec.from_string(text), taken.channels)
    segments = segment_recording(taken, rig, segment_s=nodes * interval, finer=finer)
    start = np.array([0.4, -0.7, 0.5, 1.0])
    trajectory = own_path(rig, Hypothesis(rig), segments, NONE, start)
    return rig, segments, rig_motion(rig, segments, trajectory), start


def first(kind: type[JointEffect], part: str = "") -> Callable[[RigMotion], JointEffect]:
    return lambda of: next(effect for effect in kind.instances(of) if effect.part == part or not part)


def force_over_load(of: RigMotion) -> JointEffect:
    """On the servo's joint, whose load changes within each interval, as its command is held."""
    return next(
        form
        for form in free_forms(of, arm_situation()[1])
        if isinstance(form, FreeForce) and form.variable == "load"
    )


EFFECTS: dict[str, tuple[Callable[[RigMotion], JointEffect], list[float]]] = {
    "viscous friction": (first(ViscousFriction, "elbow"), [0.05]),
    "armature": (first(Armature, "shoulder"), [0.01]),
    "mass": (first(LinkMass, "lower"), [0.1]),
    "gain": (first(ActuatorGain), [0.1]),
    "spring": (first(Spring, "elbow"), [0.3, 0.1]),
    "command delay": (first(CommandDelay), [0.003]),
    "lag": (first(ActuatorLag), [0.01]),
    "encoder": (first(EncoderDelay), [0.004]),
    "offset": (first(JointOffset, "elbow"), [0.02]),
}
LOOKED_AT = {name: build for name, (build, _) in EFFECTS.items()} | {"force over load": force_over_load}


@pytest.mark.parametrize("name", EFFECTS)
def test_columns_of_present_effects_are_differences_of_simulations(name):
    """Whole trajectories by MuJoCo's plain step, with every value a little larger and a little smaller."""
    build, at = EFFECTS[name]
    rig, segments, of, start = arm_situation()
    effect, theta = build(of), np.array(at)
    hypothesis, simulator = Hypothesis(rig, (effect,)), Simulator(rig)
    trajectory = own_path(rig, hypothesis, segments, theta, start)
    found = linearise(simulator, hypothesis, theta, segments, trajectory)
    for k, parameter in enumerate(effect.parameters):
        step = 1e-4 * parameter.scale
        ends = []
        for sign in (1, -1):
            values = theta + sign * step * np.eye(len(theta))[k]
            gone = own_path(rig, hypothesis, segments, values, start)
            ends.append(linearise(simulator, hypothesis, values, segments, gone).predicted[0])
        expected = (ends[0] - ends[1]) / (2 * step)
        size = np.abs(expected).max()
        assert size > 0
        # One-sided differences of a thousandth of the prior's scale.
        np.testing.assert_allclose(accumulated(found, k), expected, atol=3e-3 * size)


@pytest.mark.parametrize("name", LOOKED_AT)
def test_first_looks_are_differences_of_simulations(name):
    build = LOOKED_AT[name]
    errors = []
    for interval in (0.02, 0.01):
        # With short steps, since in each a force law holds from its beginning.
        rig, segments, of, start = arm_situation(round(0.6 / interval), interval, finer=16)
        effect, simulator = build(of), Simulator(rig)
        plain, present = Hypothesis(rig), Hypothesis(rig, (effect,))
        trajectory = own_path(rig, plain, segments, NONE, start)
        perturbations = perturbations_of([effect])
        found = linearise(simulator, plain, NONE, segments, trajectory, perturbations)
        worst = 0.0
        for k, perturbation in enumerate(perturbations):
            values = np.array(perturbation.values)
            gone = own_path(rig, present, segments, values, start)
            there = linearise(simulator, present, values, segments, gone).predicted[0]
            expected = (there - found.predicted[0]) / perturbation.probe
            worst = max(worst, np.abs(accumulated(found, k) - expected).max() / np.abs(expected).max())
        errors.append(worst)
    # A force law is taken as its mean over the interval: of second order in it. Others are exact but for the
    # curvature over a probe of a hundredth of the prior.
    assert errors[1] < 0.02
    assert errors[1] < max(0.35 * errors[0], 0.005)


def test_columns_of_frictions_agree_where_a_joint_stops():
    """Friction of both directions is dry friction, be it fitted or looked at, also within an interval."""
    channels = {"place": joint("rail", unit="m"), "push": control_channel("N", actuator="push")}
    rig, segments = made(CART, channels, 60, 0.04)
    # Friction of 10 N slows the cart by 0.2 m/s within an interval of four steps.
    trajectory, theta = random_path(rig, segments, 1, size=0.4), np.array([10.0])
    of = rig_motion(rig, segments, trajectory)
    coulomb, direction = (next(iter(k.instances(of))) for k in (CoulombFriction, DirectionFriction))
    found = linearise(
        Simulator(rig), Hypothesis(rig, (coulomb,)), theta, segments, trajectory,
        perturbations_of([direction]),
    )  # fmt: skip
    own, forward, backward = np.moveaxis(found.system.W[0, :-1], -1, 0)
    stops = np.abs(own).max(1) < 0.9 * np.abs(own).max()
    assert 0.2 < stops.mean() < 0.8
    assert forward + backward == pytest.approx(own, abs=1e-6 * np.abs(own).max())


@pytest.mark.parametrize("friction", ['frictionloss=".4"', 'frictionloss=".4" solreffriction=".2 1"', ""])
def test_columns_of_frictions_are_differences_over_intervals(friction):
    """Also where a joint stops within one, and where the model has friction that holds it softly."""
    text = ARM.replace('<joint name="elbow"', f'<joint name="elbow" {friction}')
    rig, segments, _, start = arm_situation(400, 0.005, 4, text)
    simulator, trajectory = Simulator(rig), own_path(rig, Hypothesis(rig), segments, NONE, start)
    of = rig_motion(rig, segments, trajectory)
    kinds = CoulombFriction, DirectionFriction, ViscousFriction, StribeckFriction
    for effect in (first(kind, part)(of) for kind in kinds for part in ("shoulder", "elbow")):
        hypothesis, slow = Hypothesis(rig, (effect,)), [p.start for p in effect.parameters[2:]]
        theta = np.array([*[0.3] * len(effect.parameters[:2]), *slow])
        found = linearise(simulator, hypothesis, theta, segments, trajectory)

        def following(values: np.ndarray, of: Hypothesis = hypothesis) -> np.ndarray:
            n, model = segments.time.size, of.compiled(values, segments.step)
            u, order = segments.control().reshape(n, segments.substeps, -1), np.zeros(n)
            x = trajectory.reshape(n, -1)
            return simulator.advance(of, values, model, x, u, segments.time.reshape(n), order)[0]

        for k, parameter in enumerate(effect.parameters):
            step = 1e-3 * parameter.scale * np.eye(len(theta))[k]
            expected = (following(theta + step) - following(theta))[None, :-1] / step.sum()
            error = np.abs(found.system.W[:, :-1, :, k] - expected).max(-1)
            size = np.abs(expected).max()
            assert size > 0
            # Of second order in the interval, but for those in which the joint may stop.
            assert error.max() < 0.05 * size, (effect.key, parameter.name)


def test_two_looks_have_the_columns_of_each():
    rig, segments, of, start = arm_situation(30)
    trajectory = own_path(rig, Hypothesis(rig), segments, NONE, start)
    effects = [EFFECTS[name][0](of) for name in ("spring", "gain", "encoder")]
    perturbations = perturbations_of(effects)
    assert [perturbation.effect.key for perturbation in perturbations] == [effects[0].key] * 2 + [
        effects[1].key,
        effects[2].key,
    ]
    together = linearise(Simulator(rig), Hypothesis(rig), NONE, segments, trajectory, perturbations).system
    for k, perturbation in enumerate(perturbations):
        alone = linearise(Simulator(rig), Hypothesis(rig), NONE, segments, trajectory, [perturbation]).system
        np.testing.assert_array_equal(alone.W[..., 0], together.W[..., k])
        np.testing.assert_array_equal(alone.psi[..., 0], together.psi[..., k])


def test_a_force_of_nothing_changes_nothing():
    """With a force law an interval is simulated step by step; at value 0 that is the same interval."""
    rig, segments, of, start = arm_situation(30)
    trajectory = own_path(rig, Hypothesis(rig), segments, NONE, start)
    spring = EFFECTS["spring"][0](of)
    plain = linearise(Simulator(rig), Hypothesis(rig), NONE, segments, trajectory)
    none = linearise(Simulator(rig), Hypothesis(rig, (spring,)), np.zeros(2), segments, trajectory)
    for name in ("A", "B", "C", "d", "r"):
        np.testing.assert_allclose(getattr(none.system, name), getattr(plain.system, name), atol=1e-7)
    np.testing.assert_allclose(none.torque, plain.torque, atol=1e-12)


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast"])
def test_twice_the_step_error_removes_the_error_of_integration(integrator):
    """Along the true trajectory a step errs by O(h²); less twice the difference of half steps, by O(h³)."""
    text = PENDULUM.replace("implicitfast", integrator).replace('damping="0.05"', 'damping="0.5"')
    left = []
    for h in (0.02, 0.01):
        rig, segments = made(
            text.replace('timestep="0.01"', f'timestep="{h}"'), {"a": joint("swing")}, 40, 0.02
        )
        assert segments.substeps == round(0.02 / h)
        fine = replace(segments, substeps=1000)
        true = own_path(rig, Hypothesis(rig), fine, NONE, np.array([1.0, 3.0]))
        found = linearise(Simulator(rig), Hypothesis(rig), NONE, segments, true, [STEP_ERROR]).system
        before = found.d[0, :-1]
        after = before + 2 * found.W[0, :-1, :, 0]
        left.append(np.linalg.norm(after) / np.linalg.norm(before))
    assert left[0] < 0.1
    # The share that is left is of first order in the step.
    assert left[1] == pytest.approx(left[0] / 2, rel=0.3)


def test_samples_between_nodes_are_predicted_where_they_were_taken():
    """A constant push: position is a parabola in time also for Euler steps, and second order is exact."""
    channels = {"place": joint("rail", unit="m"), "push": control_channel("N", actuator="push")}
    rig, segments = made(CART, channels, 80, 0.01, jitter=0.003, seed=7)
    segments = replace(segments, controls=(np.full_like(segments.controls[0], 3.0),))
    trajectory = own_path(rig, Hypothesis(rig), segments, NONE, np.array([0.2, -0.4]))
    found = linearise(Simulator(rig), Hypothesis(rig), NONE, segments, trajectory)
    taken, h = segments.time + segments.shift[..., 0], segments.step
    # Of two samples at one node the mean: its square is not the mean of the squares.
    square = taken**2 - segments.shift[..., 0] ** 2 + segments.shift_square[..., 0]
    parabola = 0.2 - 0.4 * taken + 3.0 / 2.0 * (square + taken * h) / 2
    np.testing.assert_allclose(found.predicted[..., 0], parabola, atol=1e-10)
    assert np.abs(found.predicted[..., 0] - trajectory[..., 0]).max() > 1e-3


def test_beyond_the_end_of_an_episode_nothing_grows():
    rig, segments, of, start = arm_situation(45)
    segments = cut_short(segments, 30)
    trajectory = own_path(rig, Hypothesis(rig), segments, NONE, start)
    trajectory[:, 30:] = trajectory[:, 29:30]
    perturbations = [*perturbations_of([EFFECTS[n][0](of) for n in ("spring", "mass", "lag")]), STEP_ERROR]
    system = linearise(Simulator(rig), Hypothesis(rig), NONE, segments, trajectory, perturbations).system
    assert np.all(system.d[0, 29:-1] == 0)
    assert np.all(system.W[0, 29:-1] == 0)
    assert np.abs(system.W[0, :29]).max() > 0


def cut_short(segments: Segments, length: int) -> Segments:
    inside = segments.inside.copy()
    inside[:, length:] = False
    y = segments.y.copy()
    y[:, length:] = np.nan
    return replace(segments, inside=inside, y=y)


def test_a_force_sensor_reads_at_once_what_a_law_does():
    """A spring in the elbow loads the wrist's sensor in the same instant, not only by the motion it makes."""
    text = ARM.replace("</mujoco>", '<sensor><torque name="load" site="hand"/></sensor></mujoco>')
    sensed = Channel(
        clock="encoder", role="observation", quantity="torque", unit="N m", sensor="load", component="y"
    )
    rig, segments = made(text, {"elbow": joint("elbow"), "load": sensed}, 30, 0.004)
    path = random_path(rig, segments, 1)
    of = rig_motion(rig, segments, path)
    spring = next(effect for effect in Spring.instances(of) if effect.part == "elbow")
    hypothesis = Hypothesis(rig, (spring,))
    theta = np.array([0.7, 0.1])[: len(spring.parameters)]
    simulator, found = Simulator(rig), linearise(Simulator(rig), hypothesis, theta, segments, path)
    for k in range(len(theta)):
        more = theta + 1e-3 * np.eye(len(theta))[k]
        other = linearise(simulator, hypothesis, more, segments, path)
        change = (other.predicted - found.predicted)[0] / 1e-3
        assert np.abs(change[:, 1]).max() > 0.01
        assert found.system.psi[0, ..., k] == pytest.approx(change, rel=1e-3, abs=1e-5)
