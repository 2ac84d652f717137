"""Simulation of a session on a rig: all episodes in parallel.

MuJoCo computes accelerations; integration is the lab's own, by Heun's second-order method with steps ten
times finer than those of the nominal model, which MuJoCo's Runge-Kutta method integrates. Nominal actuators
and joints are MuJoCo's; hidden effects are laws that add to them once in every step.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from mujoco.batch import Batch

from slapshot.arrays import Array
from slapshot.lab.joints.hidden_effect import Law, Plant, StepState
from slapshot.lab.joints.rig import Excitation, Rig

TIP = "lab_tip"
FLEX = "lab_flex_"  # prefix of the joint between an actuator and its link
_BRAKE = 4.0  # damping of a torque motor's controller before an episode, over that in it
_FASTEST = 200.0  # rad/s or m/s: faster motion counts as unstable

LawFactory = Callable[[Plant], Law | None]


@dataclass(frozen=True, eq=False)
class SimulatedMotion:
    """Result of simulating a session.

    Attributes:
        times: (kept,) s from the episodes' start; the first ones are negative.
        positions: (episodes, kept, observed) rad, of links, then m, of the site.
        speeds: (episodes, samples, joints) rad/s, on the actuators' side.
        forces: the same, N m, of the actuators just before.
        peak: (joints,) N m, largest size of these forces at any time.
        tip: (episodes, samples, 3) m.
        start: (episodes, 2, dofs) positions and velocities of all that moves where episodes begin.
        commands: (episodes, ticks, controls), in the order of `Rig.controls`.
    """

    times: Array
    positions: Array
    speeds: Array
    forces: Array
    peak: Array
    tip: Array
    start: Array
    commands: Array


class Execution:
    """Execution of one session on a rig with commanded actuators.

    Args:
        rig: nominal rig.
        model: true model.
        make: factories of further laws.
        excitation: of the session.
    """

    def __init__(
        self, rig: Rig, model: mujoco.MjModel, make: Sequence[LawFactory], excitation: Excitation
    ) -> None:
        self.rig, self.model, self.excitation = rig, model, excitation
        count = len(excitation.wave)
        self.batch = batch = Batch(model, nsim=count, nthread=1)
        batch.reset(stage=mujoco.mjtStage.mjSTAGE_NONE)
        self.qpos, self.qvel, self.ctrl = batch.bind("qpos"), batch.bind("qvel"), batch.bind("ctrl")
        self._applied, self._wrench = batch.bind("qfrc_applied"), batch.bind("xfrc_applied")
        self._qacc, self.site = batch.bind("qacc"), batch.bind("site_xpos")
        self.dofs = np.array([model.joint(name).dofadr[0] for name in rig.joints])
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
        session = np.linspace(0, 1, count) if count > 1 else np.zeros(1)
        plant = Plant(rig, batch, model, session)
        self._laws = [law for law in (make_one(plant) for make_one in make) if law is not None]
        self._tip = model.site(TIP).id
        swing = np.array(rig.swing) / rig.swing[0]
        self._hold = np.array(rig.hold)[:, None] * swing
        self._last: Array = np.empty(0)

    def run(self) -> SimulatedMotion:
        """Simulate.

        Raises:
            FloatingPointError: the simulation is unstable.
        """
        clock = self.rig.clock
        substeps, every = round(clock.period / clock.step), round(clock.kept / clock.step)
        sampled = round(clock.sample / clock.step)
        settling, ticks = round(self.rig.settle / clock.period), self.excitation.wave.shape[1]
        self.begin()
        self.batch.forward()
        kept, commands = [self.observed()], []
        speeds, forces, tip = [], [], []
        force = np.zeros((len(self.qpos), len(self.dofs)))
        peak = force.copy()
        for tick in range(-settling, ticks):
            if tick == 0:
                start = np.stack([self.qpos, self.qvel], axis=1)
            command = self.command(tick)
            commands.append(command)
            for substep in range(substeps):
                if substep % sampled == 0 and tick >= 0:
                    speeds.append(self.qvel[:, self.dofs])
                    forces.append(force)
                    tip.append(self.site[:, self._tip].copy())
                force = self._act(command, tick * clock.period + substep * clock.step, force)
                np.maximum(peak, np.abs(force), out=peak)
                self.step()
                if substep == substeps - 1:
                    self.end_period()
                if (substep + 1) % every == 0:
                    kept.append(self.observed())
            if not np.abs(self.qvel).max() < _FASTEST:
                raise FloatingPointError("the simulation is unstable")
        return SimulatedMotion(
            times=np.arange(len(kept), dtype=np.float64) * clock.kept - settling * clock.period,
            positions=np.stack(kept, axis=1),
            speeds=np.stack(speeds, axis=1),
            forces=np.stack(forces, axis=1),
            peak=peak.max(0),
            tip=np.stack(tip, axis=1),
            start=start,
            commands=np.stack(commands[settling:], axis=1),
        )

    def begin(self) -> None:
        """Set the initial state."""
        self.qpos[:, self.dofs] = self.excitation.centre

    def observed(self) -> Array:
        """(episodes, observed) positions of the links."""
        found = self.qpos[:, self.dofs]
        for joint, column in self._flex:
            found[:, joint] += self.qpos[:, column]
        return found

    def command(self, tick: int) -> Array:
        """Apply and return the commands (episodes, controls)."""
        commands = self.excitation.wave[:, max(tick, 0)].copy()
        if self.rig.drive == "servo":
            commands += self.excitation.centre
        else:
            links = self.observed()
            last = links if len(self._last) == 0 else self._last
            self._last = links
            stiffness, damping = self._hold
            if tick < 0:  # sooner at rest, at the same place
                damping = _BRAKE * damping
            commands += stiffness * (self.excitation.centre - links)
            commands -= damping * (links - last) / self.rig.clock.period
        self.ctrl[:] = commands
        return commands

    def actuate(self, command: Array, position: Array, velocity: Array) -> Array:
        """Nominal actuator torques (episodes, joints), N m."""
        force = self._gain * command + self._bias[:, 0] + self._bias[:, 1] * position
        return np.clip(force + self._bias[:, 2] * velocity, *self._limits.T)

    def step(self) -> None:
        """Heun's method; positions to third order where acceleration is smooth."""
        h, batch, qpos, qvel, qacc = self.rig.clock.step, self.batch, self.qpos, self.qvel, self._qacc
        position, velocity = qpos.copy(), qvel.copy()
        batch.forward()
        first = qacc.copy()
        qvel[:] = velocity + h * first
        qpos[:] = position + h * velocity + h * h / 2 * first
        batch.forward()
        qvel[:] = velocity + h / 2 * (first + qacc)
        qpos[:] = position + h * velocity + h * h / 6 * (2 * first + qacc)

    def end_period(self) -> None:
        """Hook before the next command."""

    def _act(self, command: Array, time: float, load: Array) -> Array:
        """Apply the laws in the coming step; return the actuator torques (episodes, joints)."""
        # At the midpoint of the step, where a law is evaluated to second order.
        half = self.rig.clock.step / 2
        position = self.qpos[:, self.dofs] + half * self.qvel[:, self.dofs]
        speeds = self.qvel + half * self._qacc
        velocity = speeds[:, self.dofs]
        state = StepState(time + half, position, velocity, speeds, load)
        if self._laws and self.ctrl.size:
            command = command.copy()
            for law in self._laws:
                law.command(command, state)
            self.ctrl[:] = command
        force = state.load = self.actuate(command, position, velocity)
        if self._laws:
            nominal = force.copy()
            for law in self._laws:
                law.drive(force, state)
            self._applied[:] = 0
            self._wrench[:] = 0
            for law in self._laws:
                law.act(self._applied, state)
                law.push(self._wrench, state)
            self._applied[:, self.dofs] += force - nominal
        return force
