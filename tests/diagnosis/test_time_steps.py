"""Which time steps a diagnosis takes: accurate ones of a robot, a simulation's own of what it made."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from mujoco import MjSpec
from slapshot.diagnosis import diagnose as diagnosis
from slapshot.diagnosis.diagnose import diagnose
from slapshot.diagnosis.fit.operating_point import OperatingPoint
from slapshot.diagnosis.fit.time_steps import _MOST_LONGER, step_error, with_accurate_steps
from slapshot.diagnosis.model.hypothesis import Hypothesis, Simulator
from slapshot.diagnosis.model.rig import bind
from slapshot.diagnosis.model.segments import in_steps_of, segment_recording
from slapshot.diagnosis.selection.problem import Problem
from slapshot.effects.joints.parts import add_friction

from .mechanisms import ARM, CART, control_channel, joint, recording, simulate

NOISE = 2e-4  # rad
COARSE = ARM.replace('timestep="0.004" integrator="implicitfast"', 'timestep="0.004"')


def swings(finer: int, integrator: str, episodes: int = 10):
    """Ten times two seconds of the arm with a servo, by steps of 4 ms or finer ones."""
    rng = np.random.default_rng(0)
    model = mujoco.MjModel.from_xml_string(
        ARM.replace('integrator="implicitfast"', f'integrator="{integrator}"')
    )
    clocks, angles, commands = [], [], []
    for _ in range(episodes):
        t = np.arange(500) * 0.004
        u = 0.8 * np.sin(2 * np.pi * rng.uniform(0.4, 1.2) * t + rng.uniform(0, 6))[:, None]
        first = rng.normal(size=2)
        q, *_ = simulate(model, t, u, first, [0, 0], finer=finer)
        clocks.append(t)
        angles.append(q + NOISE * rng.standard_normal(q.shape))
        commands.append(u[:, 0])
    return recording(
        clocks,
        {
            "servo": (control_channel("rad", actuator="servo"), commands),
            "shoulder": (joint("shoulder"), [a[:, 0] for a in angles]),
            "elbow": (joint("elbow"), [a[:, 1] for a in angles]),
        },
    )  # fmt: skip


@pytest.mark.parametrize(
    ("finer", "integrator", "step", "told"),
    [(40, "RK4", 0.004, True), (40, "RK4", 0.001, True), (1, "Euler", 0.004, False)],
)
def test_nothing_is_found_on_a_robot_or_a_simulation_whose_physics_the_model_has(
    finer, integrator, step, told
):
    made = swings(finer, integrator)
    rig = bind(MjSpec.from_string(COARSE.replace("0.004", str(step))), made.channels)
    found = diagnose(made, rig)
    assert found.verdict.headline == "nothing_found"
    assert any("integrator (Euler)" in finding for finding in found.verdict.findings) == told
    runge_kutta = int(mujoco.mjtIntegrator.mjINT_RK4)
    assert (found.rig.model.opt.integrator == runge_kutta) == told
    # The model that is written has its own steps.
    assert found.rig.spec.option.timestep == step
    assert (found.rig.longest_step is not None) == (step == 0.001)


@pytest.mark.parametrize(("stiffness", "substeps"), [(30, 2), (300, 4)])
def test_runge_kutta_steps_are_longer_where_these_are_exact(stiffness, substeps):
    """Four of the model's steps are an interval of 4 ms; with a stiff servo two err by .4 times the noise."""
    made = swings(40, "RK4", 6)
    stiff = COARSE.replace("0.004", "0.001").replace('kp="30" kv="2"', f'kp="{stiffness}" kv="2"')
    rig = bind(MjSpec.from_string(stiff), made.channels)
    segments = segment_recording(made, rig)
    assert segments.substeps == 4
    trajectory = Problem.of(rig, made.channels, segments).trajectory
    found = with_accurate_steps(rig, made.channels, made, segments, trajectory, np.full(2, NOISE))
    assert found is not None
    better, told = found
    assert segments.interval / (better.longest_step or segments.step) == pytest.approx(substeps)
    assert f"steps (RK4) of {4 / substeps:.3g} ms" in told
    longest = in_steps_of(replace(better, longest_step=0.002), made, segments)
    error = step_error(Simulator(better), longest, trajectory, segments.finer(8))
    assert (np.max(error) < 0.1 * NOISE) == (substeps == 2)


@pytest.mark.parametrize(("ripple", "substeps"), [(0.0, 3), (2.0, 5)])
def test_steps_are_no_longer_where_controls_change_within_them(ripple, substeps):
    """Pushes of 2 N to and fro for 1 ms each move 2 kg by 1 um in every 5 ms, of which means know nothing."""
    t = np.arange(2000) * 0.001
    push = 0.2 + ripple * np.tile([1.0, -1.0, 0.0, 0.0, 0.0], 400)
    made = recording(t, {
        "push": (control_channel("N", actuator="push"), push),
        "rail": (joint("rail", unit="m"), 0.05 * t**2),
    })  # fmt: skip
    rig = bind(MjSpec.from_string(CART.replace("0.01", "0.001")), made.channels)
    segments = segment_recording(made, rig)
    assert segments.substeps == 5
    still = np.zeros((*segments.shape, 2))
    # Euler's steps err by 25 um after half a second.
    found = with_accurate_steps(rig, made.channels, made, segments, still, np.array([1e-5]))
    assert found is not None
    better, _ = found
    assert in_steps_of(better, made, segments).substeps == substeps


@pytest.mark.parametrize(("longer", "rests"), [(_MOST_LONGER, True), (5.0, False)])
def test_friction_still_stops_a_joint_in_the_longest_steps(longer, rests):
    """Friction of 1 N on 1 kg that 0.5 N push: its constraint decays within a step of the model."""
    slide = MjSpec.from_string(CART.replace('mass="2"', 'mass="1"')).compile()
    slide.opt.timestep, slide.opt.integrator = 5e-4, int(mujoco.mjtIntegrator.mjINT_RK4)
    add_friction(slide, 0, 1.0)
    slide.opt.timestep *= longer
    data = mujoco.MjData(slide)
    data.qvel[:], data.ctrl[:] = 0.02, 0.5
    mujoco.mj_step(slide, data, round(0.2 / slide.opt.timestep))
    assert (abs(data.qvel[0]) < 1e-5) == rests


def test_what_is_not_used_of_a_recording_is_not_used_in_other_steps():
    """As velocities that were differentiated from positions."""
    made = swings(40, "RK4", 6)
    table = made.signals["encoder"]
    speeds = [np.gradient(own["elbow"], 0.004) for _, own in table.groupby("episode")]
    signals = {"encoder": table.assign(speed=np.concatenate(speeds))}
    channels = {**made.channels, "speed": joint("elbow", "velocity", "rad/s")}
    more = replace(made, channels=channels, signals=signals)
    rig = bind(MjSpec.from_string(COARSE.replace("0.004", "0.001")), channels).without(["speed"])
    problem = Problem.of(rig, made.channels, segment_recording(more, rig))
    found = diagnosis._accurate_problem(problem, more)
    assert found is not None
    accurate, _ = found
    assert [o.channel for o in accurate.rig.observations] == ["shoulder", "elbow"]
    assert accurate.segments.substeps == 2


def test_errors_that_steps_may_have_are_those_of_the_model_however_long_the_others_are():
    """In each interval about as many times more as the steps are longer, which is made up for."""
    made = swings(40, "RK4", 6)
    rig = bind(MjSpec.from_string(COARSE.replace("0.004", "0.0005")), made.channels)
    segments = segment_recording(made, rig)
    trajectory = Problem.of(rig, made.channels, segments).trajectory
    found = with_accurate_steps(rig, made.channels, made, segments, trajectory, np.full(2, NOISE))
    assert found is not None
    longer, _ = found
    assert longer.longest_step == pytest.approx(0.001)
    errors = []
    for one, own in (
        (replace(longer, longest_step=None), segments),
        (longer, in_steps_of(longer, made, segments)),
    ):
        scale, simulator = np.ones(2), Simulator(one)
        point = OperatingPoint(simulator, Hypothesis(one), np.zeros(0), own, trajectory, scale)
        errors.append(point.halved[own.inside.reshape(-1)])
    short, other = errors
    assert np.abs(other - short).max() < 0.1 * np.abs(short).max()


def test_the_error_of_euler_steps_is_that_of_a_parabola():
    """Under a constant force MuJoCo's new velocity moves the place: h a t / 2 too far after t."""
    t = np.arange(100) * 0.01
    made = recording(t, {
        "push": (control_channel("N", actuator="push"), np.full(100, 4.0)),
        "rail": (joint("rail", unit="m"), t**2),
    })  # fmt: skip
    rig = bind(MjSpec.from_string(CART), made.channels)
    segments = segment_recording(made, rig)
    trajectory = np.zeros((*segments.shape, 2))
    error = step_error(Simulator(rig), segments, trajectory)
    # Against steps an eighth as long, over the nodes of half a second: 4 N on 2 kg.
    nodes = min(segments.shape[1], round(0.5 / segments.interval))
    late = np.arange(nodes) * segments.interval
    inside = segments.inside[:, :nodes]
    expected = np.where(inside, 7 / 8 * segments.step * 2.0 * late / 2, 0.0)
    assert error == pytest.approx([np.sqrt(np.mean(expected**2))], rel=1e-6)


def test_an_integrator_that_is_none_of_a_robot_is_left_as_it_is():
    """MuJoCo's discrete one, of which nothing is known here."""
    made = swings(40, "RK4", 6)
    rig = bind(MjSpec.from_string(COARSE.replace("<option", '<option integrator="discrete"')), made.channels)
    assert rig.model.opt.integrator == int(mujoco.mjtIntegrator.mjINT_DISCRETE)
    problem = Problem.of(rig, made.channels, segment_recording(made, rig))
    assert diagnosis._accurate_problem(problem, made) is None


def test_a_model_that_diverges_is_left_to_the_search(monkeypatch):
    made = swings(40, "RK4", 6)
    rig = bind(MjSpec.from_string(COARSE), made.channels)
    problem = Problem.of(rig, made.channels, segment_recording(made, rig))
    assert diagnosis._accurate_problem(problem, made) is not None

    def diverges(*_: object) -> None:
        raise np.linalg.LinAlgError

    monkeypatch.setattr(diagnosis, "initial_fit", diverges)
    assert diagnosis._accurate_problem(problem, made) is None
