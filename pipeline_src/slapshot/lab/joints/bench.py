"""A session on a rig: all of its episodes are simulated side by side.

MuJoCo says how everything accelerates; integration is the lab's own, by Heun's method of second order with
steps ten times finer than those of the nominal model, which MuJoCo's Runge-Kutta method integrates. What
actuators and joints do according to the nominal model is MuJoCo's; what is concealed differs from it by laws,
which say once a step what they add.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from mujoco.batch import Batch, SimulationError
from numpy.typing import NDArray

from slapshot.lab.joints.kind import Concealed, Law, Now, Plant
from slapshot.lab.joints.rig import CONTROL_PERIOD, Rig

Array = NDArray[np.float64]

TIMESTEP = 2.5e-4  # s
KEPT = 1e-3  # s, between positions that are kept
TIP = "lab_tip"
FLEX = "lab_flex_"  # before a joint's name: what lies between its actuator and its link
_WAVES = 6  # sines that the commands of a joint are made of
_RAMP = 0.3  # s, in which they set in
_BRAKE = 4.0  # damping of a torque motor's controller before an episode, over that in it
_FASTEST = 200.0  # rad/s or m/s: a rig that moves faster has fallen apart

MakeLaw = Callable[[Plant], Law | None]


@dataclass(frozen=True, eq=False)
class Excitation:
    """How a session is to move, whatever the rig conceals.

    Attributes:
        centre: (episodes, joints) rad, about which an episode moves.
        wave: (episodes, samples, joints), N m or rad, what is added; 0 in the beginning.
    """

    centre: Array
    wave: Array


@dataclass(frozen=True, eq=False)
class Motion:
    """What happened in a session.

    Attributes:
        times: (kept,) s from the episodes' start; the first ones are negative.
        positions: (episodes, kept, joints) rad, of links.
        speeds: (episodes, samples, joints) rad/s, on the actuators' side, at the commands' times.
        forces: the same, N m, of the actuators just before.
        peak: (joints,) N m, largest size of these forces at any time.
        tip: (episodes, samples, 3) m.
        told: (episodes, samples, joints) commands, in the unit of the rig.
    """

    times: Array
    positions: Array
    speeds: Array
    forces: Array
    peak: Array
    tip: Array
    told: Array


def draw_excitation(rig: Rig, episodes: int, seconds: float, rng: np.random.Generator) -> Excitation:
    """Sums of sines with random phases and frequencies, which set in smoothly from rest."""
    samples = round(seconds / CONTROL_PERIOD)
    size = (episodes, len(rig.joints), _WAVES)
    low, high = np.array(rig.centre).T
    centre = rng.uniform(low, high, size[:2])
    frequency = np.exp(rng.uniform(np.log(rig.band[0]), np.log(rig.band[1]), size))
    phase, share = rng.uniform(0, 2 * np.pi, size), rng.uniform(0.5, 1.0, size)
    share *= np.array(rig.swing)[:, None] * np.sqrt(2 / (share**2).sum(-1, keepdims=True))
    times = np.arange(samples) * CONTROL_PERIOD
    angle = 2 * np.pi * frequency[..., None] * times + phase[..., None]
    rise = np.clip(times / _RAMP, 0, 1)
    rise = rise**3 * (10 - 15 * rise + 6 * rise**2)
    wave = (share[..., None] * np.sin(angle)).sum(2) * rise
    return Excitation(centre, wave.transpose(0, 2, 1).copy())


class Bench:
    """A rig that conceals something, or nothing, on which a session can be executed."""

    def __init__(self, rig: Rig, concealed: Sequence[Concealed] = (), laws: Sequence[MakeLaw] = ()) -> None:
        self._rig = rig
        self._acting = [c for c in concealed if c.amplitude != 0]
        self._make = [*laws, *(_maker(c) for c in self._acting if c.kind.has("law"))]

    def execute(self, excitation: Excitation) -> Motion | None:
        """Simulate all episodes; None where one of them is beyond what can be simulated."""
        try:
            return _Execution(self._rig, self.compile(), self._make, excitation).run()
        except (SimulationError, FloatingPointError):
            return None

    def compile(self) -> mujoco.MjModel:
        """The rig's true model."""
        spec = mujoco.MjSpec.from_string(self._rig.xml)
        assert not spec.compiler.degree, "angles of a rig's MJCF are in radians"
        body, place = self._rig.tip
        spec.body(body).add_site(name=TIP, pos=place)
        spec.option.timestep = TIMESTEP
        for c in self._acting:
            c.kind.build(c.amplitude, c.shape, spec, self._rig)
        model = spec.compile()
        for c in self._acting:
            c.kind.tune(c.amplitude, c.shape, model, self._rig)
        mujoco.mj_setConst(model, mujoco.MjData(model))
        return model


def _maker(concealed: Concealed) -> MakeLaw:
    return lambda plant: concealed.kind.law(concealed.amplitude, concealed.shape, plant)


class _Execution:
    """Of one session."""

    def __init__(
        self, rig: Rig, model: mujoco.MjModel, make: Sequence[MakeLaw], excitation: Excitation
    ) -> None:
        count, self._samples, _ = excitation.wave.shape
        self._rig, self._model, self._excitation = rig, model, excitation
        self._batch = batch = Batch(model, nsim=count, nthread=1)
        batch.reset(stage=mujoco.mjtStage.mjSTAGE_NONE)
        self._qpos, self._qvel, self._ctrl = batch.bind("qpos"), batch.bind("qvel"), batch.bind("ctrl")
        self._applied, self._wrench = batch.bind("qfrc_applied"), batch.bind("xfrc_applied")
        self._qacc, self._site = batch.bind("qacc"), batch.bind("site_xpos")
        self._dofs = np.array([model.joint(name).dofadr[0] for name in rig.joints])
        # Hinges and slides alone: a joint's place in positions is that in velocities.
        names = [model.joint(i).name for i in range(model.njnt)]
        self._flex = [
            (i, names.index(FLEX + name)) for i, name in enumerate(rig.joints) if FLEX + name in names
        ]
        self._gain = model.actuator_gainprm[:, 0].copy()
        self._bias = model.actuator_biasprm[:, :3].copy()
        self._limits = np.where(
            model.actuator_forcelimited[:, None], model.actuator_forcerange, [-np.inf, np.inf]
        )
        place = np.linspace(0, 1, count) if count > 1 else np.zeros(1)
        plant = Plant(rig, batch, model, place, TIMESTEP, rig.settle)
        self._laws = [law for law in (make_one(plant) for make_one in make) if law is not None]
        self._tip = model.site(TIP).id
        swing = np.array(rig.swing) / rig.swing[0]
        self._hold = swing[:, None] * np.array(rig.hold)

    def run(self) -> Motion:
        every, substeps = round(KEPT / TIMESTEP), round(CONTROL_PERIOD / TIMESTEP)
        settling = round(self._rig.settle / CONTROL_PERIOD)
        shape = self._excitation.wave.shape
        kept = np.empty((shape[0], (settling + shape[1]) * substeps // every + 1, shape[2]))
        speeds, forces, told = np.empty(shape), np.empty(shape), np.empty(shape)
        tip = np.empty((*shape[:2], 3))
        self._qpos[:, self._dofs] = self._excitation.centre
        self._batch.forward()
        kept[:, 0] = last = self._links()
        force, peak = np.zeros((shape[0], shape[2])), np.zeros((shape[0], shape[2]))
        row = 1
        for tick in range(-settling, shape[1]):
            links = self._links()
            command = self._told(tick, links, (links - last) / CONTROL_PERIOD)
            last = links
            if tick >= 0:
                told[:, tick], speeds[:, tick], forces[:, tick] = command, self._qvel[:, self._dofs], force
                tip[:, tick] = self._site[:, self._tip]
            self._ctrl[:] = command
            for substep in range(substeps):
                force = self._act(command, tick * CONTROL_PERIOD + substep * TIMESTEP, force)
                np.maximum(peak, np.abs(force), out=peak)
                self._step()
                if (substep + 1) % every == 0:
                    kept[:, row] = self._links()
                    row += 1
            if not np.abs(self._qvel).max() < _FASTEST:
                raise FloatingPointError("the rig has fallen apart")
        times = np.arange(kept.shape[1]) * KEPT - settling * CONTROL_PERIOD
        return Motion(times, kept, speeds, forces, peak.max(0), tip, told)

    def _links(self) -> Array:
        """(episodes, joints) rad, as encoders on the links would have them."""
        found = self._qpos[:, self._dofs]
        for joint, column in self._flex:
            found[:, joint] += self._qpos[:, column]
        return found

    def _told(self, tick: int, links: Array, speeds: Array) -> Array:
        """Commands (episodes, joints) of the rig's controller."""
        wave = self._excitation.wave[:, max(tick, 0)]
        if self._rig.drive == "servo":
            return self._excitation.centre + wave
        stiffness, damping = self._hold.T
        if tick < 0:  # sooner at rest, at the same place
            damping = _BRAKE * damping
        return wave + stiffness * (self._excitation.centre - links) - damping * speeds

    def _act(self, command: Array, time: float, load: Array) -> Array:
        """Let laws act in the coming step; return what actuators do in it (episodes, joints)."""
        # As it will be in the middle of the step: what a law says there is right to second order.
        half = TIMESTEP / 2
        position = self._qpos[:, self._dofs] + half * self._qvel[:, self._dofs]
        speeds = self._qvel + half * self._qacc
        velocity = speeds[:, self._dofs]
        now = Now(time + half, position, velocity, speeds, load)
        if self._laws:
            command = command.copy()
            for law in self._laws:
                law.command(command, now)
            self._ctrl[:] = command
        force = self._gain * command + self._bias[:, 0] + self._bias[:, 1] * position
        force += self._bias[:, 2] * velocity
        force = now.load = np.clip(force, *self._limits.T)
        if self._laws:
            nominal = force.copy()
            for law in self._laws:
                law.drive(force, now)
            self._applied[:] = 0
            self._wrench[:] = 0
            for law in self._laws:
                law.act(self._applied, now)
                law.push(self._wrench, now)
            self._applied[:, self._dofs] += force - nominal
        return force

    def _step(self) -> None:
        """Heun's method; positions to third order where acceleration is smooth."""
        h, batch, qpos, qvel, qacc = TIMESTEP, self._batch, self._qpos, self._qvel, self._qacc
        position, velocity = qpos.copy(), qvel.copy()
        batch.forward()
        first = qacc.copy()
        qvel[:] = velocity + h * first
        qpos[:] = position + h * velocity + h * h / 2 * first
        batch.forward()
        qvel[:] = velocity + h / 2 * (first + qacc)
        qpos[:] = position + h * velocity + h * h / 6 * (2 * first + qacc)
