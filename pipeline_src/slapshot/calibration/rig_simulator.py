"""Rigs on which effects are calibrated, simulated apart from the engine.

The law of an effect is the effect's own; integration is MuJoCo's plain step, finer than that of a fit.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache

import mujoco
import numpy as np

from slapshot.arrays import Array
from slapshot.diagnosis.hypothesis import Hypothesis, actuator_torque
from slapshot.diagnosis.rig import Rig, bind
from slapshot.diagnosis.structure import restructured
from slapshot.effects.joints.effect import JointEffect, Observed, State, overrides
from slapshot.lab.joints.rig import draw_excitation
from slapshot.lab.joints.rigs import rig_named
from slapshot.recordings.channels import Channel, Component
from slapshot.recordings.signals import SignalRecording

WHITE_NOISE = 1e-3  # rad or m
INTERVAL = 5e-3  # s between samples
_FINER = 5  # steps in one of a fit
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
class Drive:
    """How a rig is moved.

    Attributes:
        start: (episodes, nq + nv) first states of the nominal model.
        told: (episodes, samples, nu) controls, each of which holds until the next.
    """

    start: Array
    told: Array


@dataclass(frozen=True)
class RigSimulator:
    """A rig, and how motions of it are drawn.

    Attributes:
        name: of the rig.
        rig: nominal, with its channels bound.
        channels: of a recording.
        draw: motion of some episodes of some seconds.
    """

    name: str
    rig: Rig
    channels: dict[str, Channel]
    draw: Callable[[int, float, np.random.Generator], Drive]


@cache
def rig_simulator_named(name: str) -> RigSimulator:
    """The two-joint pendulum or the three-joint arm of the lab, or a ball that is thrown."""
    if name == "ball":
        return _ball()
    own = rig_named(name)
    channels = own.controls() | own.observations()
    rig = bind(mujoco.MjSpec.from_string(own.xml), channels, name)

    def draw(episodes: int, seconds: float, rng: np.random.Generator) -> Drive:
        excitation = draw_excitation(own, episodes, seconds, rng)
        about = excitation.centre[:, None] if own.drive == "servo" else 0.0
        still = np.zeros((episodes, rig.model.nv))
        return Drive(np.concatenate([excitation.centre, still], axis=1), about + excitation.wave)

    return RigSimulator(name, rig, channels, draw)


def _ball() -> RigSimulator:
    channels: dict[str, Channel] = {
        axis: Channel(
            clock="camera", role="observation", quantity="position", body="ball", component=axis, unit="m"
        )
        for axis in _AXES
    }

    def draw(episodes: int, seconds: float, rng: np.random.Generator) -> Drive:
        start = np.zeros((episodes, 13))
        start[:, 2], start[:, 3] = 1.0, 1.0
        start[:, 7:9] = _SPEED * rng.standard_normal((episodes, 2))
        start[:, 9] = rng.uniform(0, 2 * _RISE, episodes)
        return Drive(start, np.zeros((episodes, round(seconds / INTERVAL), 0)))

    return RigSimulator("ball", bind(mujoco.MjSpec.from_string(_BALL), channels, "ball"), channels, draw)


def recorded(
    bench: RigSimulator, drive: Drive, effect: JointEffect | None, values: Array, noise: Array | float = 0.0
) -> SignalRecording:
    """A recording of the rig with an effect.

    Args:
        bench: the rig.
        drive: how it is moved.
        effect: what the nominal model lacks; None for nothing.
        values: of the effect.
        noise: (episodes, samples, channels) that is added.
    """
    y = _simulated(bench, drive, effect, values) + noise
    episodes, samples, _ = y.shape
    signals: dict[str, tuple[Channel, Sequence[Array]]] = {}
    controls = [name for name, channel in bench.channels.items() if channel.role == "control"]
    for i, name in enumerate(controls):
        signals[name] = bench.channels[name], list(drive.told[..., i])
    for i, observation in enumerate(bench.rig.observations):
        signals[observation.channel] = bench.channels[observation.channel], list(y[..., i])
    t = np.asarray(np.arange(samples) * INTERVAL, np.float64)
    return SignalRecording.from_arrays([t] * episodes, signals, bench.name, stand_in=True)


def _simulated(bench: RigSimulator, drive: Drive, effect: JointEffect | None, values: Array) -> Array:
    """(episodes, samples, channels) without noise."""
    rig, effects = bench.rig, () if effect is None else (effect,)
    if effect is not None and overrides(effect, "restructure"):
        rig = restructured(rig, effect, bench.channels)
    substeps = _FINER * round(INTERVAL / bench.rig.model.opt.timestep)
    step = INTERVAL / substeps
    model = Hypothesis(rig, effects).compiled(values, step)
    episodes = len(drive.told)
    orders = np.linspace(-0.5, 0.5, episodes) if episodes > 1 else np.zeros(1)
    seen = []
    for start, told, order in zip(drive.start, drive.told, orders, strict=True):
        control = np.repeat(told, substeps, axis=0)
        if effect is not None:
            control = effect.control(control, step, values)
        y = _episode(replace(rig, model=model), bench.rig.model, start, control, effect, values, order)
        if effect is not None:
            rate = np.gradient(y, step, axis=0, edge_order=2)
            bend = np.gradient(rate, step, axis=0, edge_order=2)
            added = effect.observe(Observed(y, rate, bend, np.full(len(y), order)), values)
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
    for k, told in enumerate(control):
        data.ctrl[:] = told
        if pushes:
            assert effect is not None
            x = np.concatenate([data.qpos, data.qvel, data.act])[None]
            load = actuator_torque(model, x, told[None], rig.load)
            time = np.array([k * model.opt.timestep])
            state = State(data.qpos[None], data.qvel[None], load, time, np.array([order]))
            force = effect.force(state, values)
            data.qfrc_applied[:] = 0.0 if force is None else force[0]
        mujoco.mj_step(model, data)
        seen[k] = rig.reading @ data.sensordata  # of the state before the step
    return seen
