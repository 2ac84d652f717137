"""Rigs for calibration, simulated independently of the engine.

The law of an effect is its own; integration is plain MuJoCo stepping, finer than in a fit.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache

import mujoco
import numpy as np

from slapshot.arrays import Array
from slapshot.diagnosis.model.hypothesis import Hypothesis, actuator_torque
from slapshot.diagnosis.model.rig import Rig, bind
from slapshot.diagnosis.model.structure import restructured
from slapshot.effects.joints.effect import JointEffect, Observed, State, overrides
from slapshot.lab.joints.rig import draw_excitation
from slapshot.lab.joints.rigs import rig_named
from slapshot.recordings.channels import Channel, Component
from slapshot.recordings.signals import SignalRecording

WHITE_NOISE = 1e-3  # rad or m
INTERVAL = 5e-3  # s between samples
_SUBSTEPS = 5  # steps in one of a fit
_BALL = """
<mujoco model="ball">
  <option timestep="0.0025" integrator="RK4"/>
  <worldbody>
    <body name="ball"><freejoint name="flight"/><geom size="0.03" mass="0.05"/></body>
  </worldbody>
</mujoco>
"""
_SPEED, _RISE = 4.0, 3.0  # m/s of a throw, about level and up
_AXES: tuple[Component, ...] = ("x", "y", "z")


@dataclass(frozen=True)
class Motion:
    """Initial states and commands of the episodes.

    Attributes:
        start: (episodes, nq + nv) initial states of the nominal model.
        commands: (episodes, samples, nu) commands, zero-order hold.
    """

    start: Array
    commands: Array


@dataclass(frozen=True)
class CalibrationRig:
    """A rig and its distribution of motions.

    Attributes:
        name: of the rig.
        rig: nominal, with its channels bound.
        channels: of a recording.
        draw: motion of some episodes of some seconds.
    """

    name: str
    rig: Rig
    channels: dict[str, Channel]
    draw: Callable[[int, float, np.random.Generator], Motion]


@cache
def calibration_rig(name: str) -> CalibrationRig:
    """The two-joint pendulum or the three-joint arm of the lab, or a ball that is thrown."""
    if name == "ball":
        return _ball()
    own = rig_named(name)
    channels = own.controls() | own.observations()
    rig = bind(mujoco.MjSpec.from_string(own.xml), channels, name)

    def draw(episodes: int, seconds: float, rng: np.random.Generator) -> Motion:
        excitation = draw_excitation(own, episodes, seconds, rng)
        about = excitation.centre[:, None] if own.drive == "servo" else 0.0
        still = np.zeros((episodes, rig.model.nv))
        return Motion(np.concatenate([excitation.centre, still], axis=1), about + excitation.wave)

    return CalibrationRig(name, rig, channels, draw)


def _ball() -> CalibrationRig:
    channels: dict[str, Channel] = {
        axis: Channel(
            clock="camera", role="observation", quantity="position", body="ball", component=axis, unit="m"
        )
        for axis in _AXES
    }

    def draw(episodes: int, seconds: float, rng: np.random.Generator) -> Motion:
        start = np.zeros((episodes, 13))
        start[:, 2], start[:, 3] = 1.0, 1.0
        start[:, 7:9] = _SPEED * rng.standard_normal((episodes, 2))
        start[:, 9] = rng.uniform(0, 2 * _RISE, episodes)
        return Motion(start, np.zeros((episodes, round(seconds / INTERVAL), 0)))

    return CalibrationRig("ball", bind(mujoco.MjSpec.from_string(_BALL), channels, "ball"), channels, draw)


def simulate_recording(
    simulated: CalibrationRig,
    motion: Motion,
    effect: JointEffect | None,
    values: Array,
    noise: Array | float = 0.0,
) -> SignalRecording:
    """Simulate a recording of the rig with an effect.

    Args:
        simulated: the rig.
        motion: initial states and commands.
        effect: missing in the nominal model; None for none.
        values: of the effect.
        noise: (episodes, samples, channels) that is added.
    """
    y = _simulated(simulated, motion, effect, values) + noise
    episodes, samples, _ = y.shape
    signals: dict[str, tuple[Channel, Sequence[Array]]] = {}
    controls = [name for name, channel in simulated.channels.items() if channel.role == "control"]
    for i, name in enumerate(controls):
        signals[name] = simulated.channels[name], list(motion.commands[..., i])
    for i, observation in enumerate(simulated.rig.observations):
        signals[observation.channel] = simulated.channels[observation.channel], list(y[..., i])
    t = np.asarray(np.arange(samples) * INTERVAL, np.float64)
    return SignalRecording.from_arrays([t] * episodes, signals, simulated.name, stand_in=True)


def _simulated(simulated: CalibrationRig, motion: Motion, effect: JointEffect | None, values: Array) -> Array:
    """(episodes, samples, channels) without noise."""
    rig, effects = simulated.rig, () if effect is None else (effect,)
    if effect is not None and overrides(effect, "restructure"):
        rig = restructured(rig, effect, simulated.channels)
    substeps = _SUBSTEPS * round(INTERVAL / simulated.rig.model.opt.timestep)
    step = INTERVAL / substeps
    model = Hypothesis(rig, effects).compiled(values, step)
    episodes = len(motion.commands)
    orders = np.linspace(-0.5, 0.5, episodes) if episodes > 1 else np.zeros(1)
    seen = []
    for start, commands, order in zip(motion.start, motion.commands, orders, strict=True):
        control = np.repeat(commands, substeps, axis=0)
        if effect is not None:
            control = effect.control(control, step, values)
        y = _episode(replace(rig, model=model), simulated.rig.model, start, control, effect, values, order)
        if effect is not None:
            rate = np.gradient(y, step, axis=0, edge_order=2)
            second_rate = np.gradient(rate, step, axis=0, edge_order=2)
            third_rate = np.gradient(second_rate, step, axis=0, edge_order=2)
            observed = Observed(y, rate, second_rate, np.full(len(y), order), third_rate)
            added = effect.observe(observed, values)
            y = y if added is None else y + added
        seen.append(y[::substeps])
    return np.array(seen)


def _episode(
    rig: Rig,
    nominal: mujoco.MjModel,
    start: Array,
    control: Array,
    effect: JointEffect | None,
    values: Array,
    order: float,
) -> Array:
    """(steps, channels): what is observed at the beginning of every step."""
    model, data = rig.model, mujoco.MjData(rig.model)
    for j in range(nominal.njnt):
        own = data.joint(nominal.joint(j).name)
        q, v = int(nominal.jnt_qposadr[j]), nominal.nq + int(nominal.jnt_dofadr[j])
        own.qpos[:], own.qvel[:] = start[q : q + len(own.qpos)], start[v : v + len(own.qvel)]
    pushes = effect is not None and overrides(effect, "force")
    seen = np.empty((len(control), len(rig.observations)))
    for k, commands in enumerate(control):
        data.ctrl[:] = commands
        if pushes:
            assert effect is not None
            x = np.concatenate([data.qpos, data.qvel, data.act])[None]
            load = actuator_torque(model, x, commands[None], rig.load)
            time = np.array([k * model.opt.timestep])
            state = State(data.qpos[None], data.qvel[None], load, time, np.array([order]))
            force = effect.force(state, values)
            data.qfrc_applied[:] = 0.0 if force is None else force[0]
        mujoco.mj_step(model, data)
        seen[k] = rig.reading @ data.sensordata  # of the state before the step
    return seen
