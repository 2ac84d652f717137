"""What the simulator makes of a recording's commands: arm and object until the object is released.

All hits are simulated at once, each with its own command, object and start. The step is that at which
contact converges: coarser ones scatter launches by more than the effects that are looked for.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from mujoco.batch import Batch
from scipy.interpolate import CubicSpline

from slapshot.arrays import GRAVITY, Array
from slapshot.diagnosis.pucks.launch.approach import (
    Approaches,
    CommandedArms,
    digest_of_arm,
    resting_height,
)
from slapshot.diagnosis.pucks.slide.tracks import HitTracks
from slapshot.effects.effect import Effect
from slapshot.recordings.format import Recording, joint_columns
from slapshot.scenes.scene import Scene

TIMESTEP = 2e-4  # s
_ROLLING = 1e-4  # placeholder: contacts of dimension 4 do not use it


@dataclass(frozen=True)
class Commands:
    """What n hits were told to do.

    Attributes:
        positions: (n, ticks, joints) rad, one every control period; the first and the last are held.
        targets: (n, ticks, joints) rad, what servos are sent.
        period: s.
    """

    positions: Array
    targets: Array
    period: float


@dataclass(frozen=True)
class Strikes:
    """n hits as simulated.

    Attributes:
        released: (n, 5) x, y (m), vx, vy (m/s), spin (rad/s) of the object at the release.
        joints: (n, readings, joints) rad, of the arm at the times asked for.
        contact: (n,) s at which the object began to move.
        turned: (n,) rad by which the object had turned at the release.
    """

    released: Array
    joints: Array
    contact: Array
    turned: Array


def commands_of(recording: Recording, tracks: HitTracks, scene: Scene, until: float) -> Commands:
    """Commands of the hits of `tracks`, on the control period's grid up to `until` (s)."""
    assert recording.commands is not None
    groups = dict(tuple(recording.commands.groupby("hit")))
    columns = ["t", *joint_columns(recording.commands)]
    return commands_through([groups[int(hit)][columns].to_numpy() for hit in tracks.hit], scene, until)


def commands_through(rows: Sequence[Array], scene: Scene, until: float) -> Commands:
    """The same of commands (samples, 1 + joints), t in s and joint positions in rad."""
    info = scene.info
    times = np.arange(int(np.ceil(until / info.control_period)) + 1) * info.control_period
    positions = np.empty((len(rows), len(times), rows[0].shape[1] - 1))
    speeds = np.empty_like(positions)
    for i, command in enumerate(rows):
        spline = CubicSpline(command[:, 0], command[:, 1:], bc_type="clamped")
        begin, end = command[[0, -1], 0]
        at, moves = np.clip(times, begin, end), (begin < times) & (times < end)
        positions[i] = spline(at)
        speeds[i] = np.where(moves[:, None], spline(at, 1), 0.0)
    return Commands(positions, positions + info.servo_time * speeds, info.control_period)


def _told_at(launches: Array, later: Array, slowing: Array) -> Array:
    """Launches (n, 5) as they would have been `later` (n,) s, slowed by (n,) m/s^2 along their way."""
    told = launches.copy()
    speed = np.maximum(np.linalg.norm(launches[:, 2:4], axis=1), 1e-9)
    # Only while it moves: an object that was not struck stays where it is.
    moving = speed > slowing * np.maximum(later, 0.0)
    change = np.where(moving, -slowing * later / speed, 0.0)[:, None] * launches[:, 2:4]
    told[:, :2] += np.where(moving, later, 0.0)[:, None] * (launches[:, 2:4] + change / 2)
    told[:, 2:4] += change
    return told


def _as_if_sliding(launches: Array, height: Array, rising: Array, friction: Array) -> Array:
    """Launches (n, 5) of objects that hop, as those of objects that slide and are the same after the landing.

    In the air nothing slows an object down; its landing does at once, since over a time t the board's normal
    impulse is m (g t - w) from a vertical speed w on.

    Args:
        launches: (n, 5) x, y (m), vx, vy (m/s), spin (rad/s).
        height: (n,) m above where the object rests.
        rising: (n,) m/s.
        friction: (n, 2) coefficients along x and y.
    """
    speed = np.linalg.norm(launches[:, 2:4], axis=1, keepdims=True)
    against = friction * launches[:, 2:4] / np.maximum(speed, 1e-9)
    w = rising[:, None]
    flight = (w + np.sqrt(w**2 + 2 * GRAVITY * np.maximum(height, 0.0)[:, None])) / GRAVITY
    told = launches.copy()
    told[:, :2] += against * (GRAVITY * flight / 2 - w) * flight
    told[:, 2:4] += against * w
    return told


class Striker:
    """Simulates the hits of a recording on a scene, as it is or with effects."""

    def __init__(
        self,
        scene: Scene,
        commands: Commands,
        releases: Array,
        mass: Array,
        friction: Array,
        readings: Array,
        threads: int,
        approaches: Approaches | None = None,
    ) -> None:
        """Of n hits.

        Args:
            scene: nominal.
            commands: of the hits.
            releases: (n,) s, when the object is looked at.
            mass: (n,) kg.
            friction: (n, 3) mu_x, mu_y, torsional in m.
            readings: (readings,) s, when joints are looked at, on the control period's grid.
            threads: for MuJoCo.
            approaches: that may serve; None for none that were made before.
        """
        self._approaches = approaches or Approaches()
        self._scene, self._commands, self._releases = scene, commands, releases
        self._mass, self._friction, self._readings, self._threads = mass, friction, readings, threads

    def strike(
        self,
        starts: Array,
        effects: Sequence[tuple[Effect, Mapping[str, float]]] = (),
        struck_at: Array | None = None,
    ) -> Strikes:
        """Simulate with the object at `starts` (n, 2) in m.

        Args:
            starts: where objects lie.
            effects: with their values.
            struck_at: (n,) s at which objects are struck without effects. An object that is struck at another
                moment is looked at as much later or earlier, and the launch is told as it would have been at
                the release if nothing but friction had acted in between; None to look at the release.
        """
        spec = self._scene.spec()
        targets = self._commands.targets
        for effect, values in effects:
            effect.edit(values, spec, self._scene.info)
            changed = [effect.command(values, target, self._commands.period) for target in targets]
            targets = np.stack(changed)
        return self._run(spec, targets, starts, self._commands.positions[:, 0], struck_at)

    def strike_displaced(self, starts: Array, offset: Array, slope: Array, contact: Array) -> Strikes:
        """Simulate with all joints moved by offset + slope (t - contact), offset (joints,) in rad."""
        ticks = np.arange(self._commands.targets.shape[1]) * self._commands.period
        since = ticks - contact[:, None]
        moved = offset + slope * since[..., None]
        targets = self._commands.targets + moved + self._scene.info.servo_time * slope
        spec = self._scene.spec()
        return self._run(spec, targets, starts, self._commands.positions[:, 0] + moved[:, 0])

    def _run(
        self,
        spec: mujoco.MjSpec,
        targets: Array,
        starts: Array,
        poses: Array,
        struck_at: Array | None = None,
    ) -> Strikes:
        info, count, period = self._scene.info, len(targets), self._commands.period
        model = spec.compile()
        arm = digest_of_arm(spec, info)
        model.opt.timestep = TIMESTEP
        rows = np.round(self._readings / period).astype(int)
        arms = CommandedArms(model, info, targets, poses, starts, self._threads)
        came = self._approaches.get(arm, arms)
        arm_q = np.array([model.joint(j).qposadr[0] for j in info.joints])
        object_q = np.array([model.joint(j).qposadr[0] for j in info.object_joints])
        object_v = np.array([model.joint(j).dofadr[0] for j in info.object_joints])
        batch = Batch(model, nsim=count, nthread=self._threads)
        self._dress(batch, model)
        ids = np.arange(count)
        batch.set_const(ids=ids)
        batch.reset(ids=ids, stage=mujoco.mjtStage.mjSTAGE_NONE)
        batch.state[:] = came.states
        qpos, qvel, ctrl = batch.bind("qpos"), batch.bind("qvel"), batch.bind("ctrl")
        start, resting = np.array(info.start), resting_height(model, info)
        qpos[:, object_q] = 0.0
        qpos[:, object_q[:2]] = starts - start
        qpos[:, object_q[2]] = resting
        qvel[:, object_v] = 0.0
        substeps = round(info.control_period / model.opt.timestep)
        releases = self._releases.copy()
        ticks = np.ceil(releases / info.control_period).astype(int)
        waits = None if struck_at is None else releases - struck_at
        end = (targets.shape[1] - 1) * info.control_period
        if waits is not None:  # an object that was not struck yet may be struck until commands end
            ticks = np.full(count, targets.shape[1] - 1)
        joints = came.joints[:, np.minimum(rows, targets.shape[1] - 1)]
        released, contact = np.zeros((count, 5)), np.full(count, np.nan)
        released[:, :2] = starts
        turned = np.zeros(count)
        planar, upwards = [0, 1, 3], 2
        column = {int(row): k for k, row in enumerate(rows)}
        before: Array | None = None
        tick = int(came.ticks.min())
        while tick <= ticks.max():
            here = (came.ticks <= tick) & (tick <= ticks)
            if tick in column:
                joints[here, column[tick]] = qpos[here][:, arm_q]
            columns = qpos[:, object_q[planar]], qvel[:, object_v[planar]]
            hop = qpos[:, object_q[upwards]] - resting, qvel[:, object_v[upwards]]
            state = np.column_stack([*columns, *hop])
            moving = np.hypot(state[:, 3], state[:, 4]) > 0.05
            fresh = np.isnan(contact) & moving
            contact = np.where(fresh, tick * info.control_period, contact)
            if waits is not None and fresh.any():
                releases = np.where(fresh, np.minimum(contact + waits, end), releases)
                ticks = np.where(fresh, np.ceil(releases / info.control_period).astype(int), ticks)
            now = np.flatnonzero(here & (ticks == tick))
            if len(now):
                earlier = state if before is None else before
                share = (releases[now] / info.control_period - (tick - 1))[:, None]
                at = (1 - share) * earlier[now] + share * state[now]
                released[now] = _as_if_sliding(
                    at[:, [0, 1, 3, 4, 5]] + [*start, 0, 0, 0], at[:, 6], at[:, 7], self._friction[now, :2]
                )
                turned[now] = at[:, 2]
            before = state
            running = ids[here & (ticks > tick)]
            if len(running):
                ctrl[:, : len(arm_q)] = targets[:, min(tick, targets.shape[1] - 1)]
                batch.step(ids=running, nstep=substeps)
            tick += 1
        passed = np.maximum(ticks, came.ticks)
        arms.withdraw(batch.state, passed, rows, joints)
        if waits is not None:
            mu = self._friction[:, :2].mean(1)
            released = _told_at(released, self._releases - releases, GRAVITY * mu)
        return Strikes(released, joints, contact, turned)

    def _dress(self, batch: Batch, model: mujoco.MjModel) -> None:
        """Each hit's object and friction."""
        info = self._scene.info
        body, pair = model.body(info.object_body).id, model.pair(info.object_pair).id
        mass, inertia, friction = (batch.expand(n) for n in ("body_mass", "body_inertia", "pair_friction"))
        inertia[:, body] = model.body_inertia[body] * (self._mass / model.body_mass[body])[:, None]
        mass[:, body] = self._mass
        rolling = np.full(len(self._mass), _ROLLING)
        mu_x, mu_y, torsional = self._friction.T
        # Tangent 1 of a horizontal contact is world y.
        friction[:, pair] = np.stack([mu_y, mu_x, torsional, rolling, rolling], axis=1)
