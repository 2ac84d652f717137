"""One hit on the rig: the arm executes a motion, the blade strikes the object, the object slides to rest.

Arm, blade and object are simulated in MuJoCo from rest until blade and object have parted for good, then
`slide` takes over, which knows the slope and the friction under every part of the object. On an even board
with like friction along x and y MuJoCo would bring it to the same place, within 2 mm, more slowly.
"""

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from slapshot.lab.blade import compile_rig
from slapshot.lab.board import gradient, value
from slapshot.lab.rig import ObjectTruth, Rig, Scatter
from slapshot.lab.slide import GRAVITY, slide
from slapshot.scenes.scene import Scene
from slapshot.trajectories.motion import Motion

Array = NDArray[np.float64]

TIMESTEP = 2e-4  # s
SETTLE = 0.05  # s simulated after the motion's end
LONGEST_CONTACT = 0.5  # s after the motion's end at which blade and object have parted at the latest
LOOK_AHEAD = 0.005  # s, between the future places of the blade that are looked at
PARTED = 0.01  # m by which the blade will miss the object; it swings by less
FLAT = 1e-3  # m above the board: what hops no higher slides
# m/s. An object still hops when it is launched, and friction slows it only where it lands. What the board
# pushes up in all from then on is m (g t - w), w being the speed at which it rises: to let it lie flat at
# once, which takes m g t, is right where w is 0, but for w = 5 cm/s wrong by mu w, 1 % of its speed.
LEVEL = 0.01
MOVING = 0.01  # m/s: slower objects have not been hit yet
_ROLLING = 1e-4  # placeholder: contacts of dimension 4 do not use it


@dataclass(frozen=True, eq=False)
class Chance:
    """What chance does to one hit.

    Attributes:
        start_error: (2,) m.
        pace: factor on the speed of execution.
        joint_offset: (joints,) rad, reached smoothly at the motion's end.
        friction: factor on the object's friction.
    """

    start_error: Array
    pace: float
    joint_offset: Array
    friction: float


@dataclass(frozen=True, eq=False)
class Hit:
    """What really happened; times from the start of the motion.

    Attributes:
        track: (n, 4) t (s), x, y (m), yaw (rad) of the object every control period until it rests.
        joints: (m, 1 + joints) t (s) and positions (rad) of the arm every control period.
        launch_time: s.
        launch: (6,) x, y (m), yaw (rad), vx, vy (m/s), spin (rad/s) at that time.
        rest: (3,) x, y, yaw.
        end: s, when the object comes to rest.
    """

    track: Array
    joints: Array
    launch_time: float
    launch: Array
    rest: Array
    end: float


def draw_chance(scatter: Scatter, rng: np.random.Generator) -> Chance:
    """Draw what differs from hit to hit."""
    return Chance(
        start_error=rng.normal(0, scatter.start_error_sd, 2),
        pace=float(np.exp(rng.normal(0, scatter.speed_sd))),
        joint_offset=rng.normal(0, scatter.joint_offset_sd),
        friction=float(np.exp(rng.normal(0, scatter.friction_sd))),
    )


class Bench:
    """The rig, on which hits can be executed one after another."""

    def __init__(self, scene: Scene, rig: Rig, timestep: float = TIMESTEP) -> None:
        info = scene.info
        self._scene, self._rig = scene, rig
        self._model = model = compile_rig(scene, rig.blade, timestep)
        self._data = mujoco.MjData(model)
        self._substeps = round(info.control_period / model.opt.timestep)
        self._arm = np.array([model.joint(name).qposadr[0] for name in info.joints])
        self._object_q = np.array([model.joint(name).qposadr[0] for name in info.object_joints])
        self._object_v = np.array([model.joint(name).dofadr[0] for name in info.object_joints])
        self._body = model.body(info.object_body).id
        self._pair = model.pair(info.object_pair).id
        self._site = model.site(info.striker_site).id
        self._start = np.array(info.start)

    def hit(self, motion: Motion, object_id: str, chance: Chance) -> Hit:
        """Execute `motion` on an object that was put at the scene's start, but for the start error."""
        truth = self._rig.objects[object_id]
        friction = chance.friction * np.array((truth.friction_x, truth.friction_y, truth.friction_torsional))
        period = self._scene.info.control_period
        track, joints, launch_time, launch = self._strike(motion, truth, friction, chance)
        slid = slide(
            launch,
            (friction[0], friction[1], friction[2]),
            self._scene.info.object_radius,
            period,
            self._rig.height,
            self._rig.log_friction,
        )
        # The launch is the last row of the first part and the first row of the second one.
        poses = np.concatenate([track, slid.track[1:], slid.rest[None]])
        times = np.arange(len(poses)) * period
        times[-1] = end = launch_time + slid.duration
        return Hit(
            track=np.column_stack([times, poses]),
            joints=np.column_stack([np.arange(len(joints)) * period, joints]),
            launch_time=launch_time,
            launch=launch,
            rest=slid.rest,
            end=end,
        )

    def _strike(
        self, motion: Motion, truth: ObjectTruth, friction: Array, chance: Chance
    ) -> tuple[Array, Array, float, Array]:
        """Simulate in MuJoCo; object (rows, 3) up to the launch, joints, launch time and state."""
        model, data, period = self._model, self._data, self._scene.info.control_period
        path = _ExecutedPath(motion, chance)
        ticks = round((path.duration + SETTLE) / period)
        latest = round((path.duration + LONGEST_CONTACT) / period)
        times = period * np.arange(latest + 1.0)
        targets = path.position(times) + self._scene.info.servo_time * path.velocity(times)
        hardest = GRAVITY * float(friction[:2].max())
        blade_times = np.arange(0.0, path.duration + LOOK_AHEAD, LOOK_AHEAD)
        blade = self._blade_path(path.position(blade_times))
        self._place(truth, path.position(times[:1])[0], chance)

        poses, joints = [self._state()[:3]], [data.qpos[self._arm].copy()]
        launch: tuple[float, Array] | None = None
        for tick in range(latest):
            if launch is not None and tick >= ticks:
                break
            data.ctrl[: len(self._arm)] = targets[tick]
            self._feel_board(truth, friction)
            mujoco.mj_step(model, data, self._substeps)
            joints.append(data.qpos[self._arm].copy())
            if launch is None:
                state, now = self._state(), (tick + 1) * period
                poses.append(state[:3])
                if self._has_parted(state, now, blade_times, blade, hardest):
                    launch = (now, state)
        launch_time, state = launch if launch is not None else (latest * period, self._state())
        return np.array(poses), np.array(joints[: ticks + 1]), launch_time, state

    def _place(self, truth: ObjectTruth, pose: Array, chance: Chance) -> None:
        """Everything at rest: the arm at `pose` (rad), the object where it was put by mistake."""
        model, data = self._model, self._data
        scale = truth.mass / model.body_mass[self._body]
        model.body_mass[self._body] *= scale
        model.body_inertia[self._body] *= scale
        mujoco.mj_setConst(model, mujoco.MjData(model))  # gravity acts on masses summed there
        mujoco.mj_resetData(model, data)
        data.qpos[self._arm] = pose
        data.qpos[self._object_q[:2]] = chance.start_error

    def _state(self) -> Array:
        """(6,) x, y (m, in the world), yaw (rad), vx, vy (m/s), spin (rad/s) of the object."""
        planar = [0, 1, 3]
        state = np.concatenate(
            [self._data.qpos[self._object_q[planar]], self._data.qvel[self._object_v[planar]]]
        )
        state[:2] += self._start
        return state

    def _feel_board(self, truth: ObjectTruth, friction: Array) -> None:
        """Slope and friction of the place where the object is."""
        x, y = self._state()[:2]
        slope = np.array(gradient(self._rig.height, x, y))
        self._data.qfrc_applied[self._object_v[:2]] = -truth.mass * GRAVITY * slope
        along_x, along_y, torsional = friction * np.exp(value(self._rig.log_friction, x, y))
        # Tangent 1 of a horizontal contact is world y.
        self._model.pair_friction[self._pair] = (along_y, along_x, torsional, _ROLLING, _ROLLING)

    def _blade_path(self, positions: Array) -> Array:
        """(n, 2, 2): place in m and level unit normal of the striker, for joint positions (n, joints)."""
        data = mujoco.MjData(self._model)
        path = np.empty((len(positions), 2, 2))
        for i, q in enumerate(positions):
            data.qpos[self._arm] = q
            mujoco.mj_kinematics(self._model, data)
            path[i, 0] = data.site_xpos[self._site, :2]
            normal = data.site_xmat[self._site].reshape(3, 3)[:2, 0]
            path[i, 1] = normal / np.linalg.norm(normal)
        return path

    def _has_parted(self, state: Array, now: float, blade_times: Array, blade: Array, hardest: float) -> bool:
        """Whether the object lies flat and the blade will miss it, however hard friction slows it.

        With the deceleration `hardest` (m/s^2) and speed v the object has moved by
        v t - hardest t^2 / 2 after t <= v / hardest.
        """
        height, rising = self._data.qpos[self._object_q[2]], self._data.qvel[self._object_v[2]]
        speed = float(np.hypot(state[3], state[4]))
        if abs(height) > FLAT or abs(rising) > LEVEL or speed < MOVING:
            return False
        coming = np.append(blade_times[blade_times > now], max(now, blade_times[-1]))
        t = np.minimum(coming - now, speed / hardest)
        moved = np.outer(t - hardest * t**2 / (2 * speed), state[3:5])
        rows = np.minimum(np.searchsorted(blade_times, coming), len(blade) - 1)
        ahead = ((state[:2] + moved - blade[rows, 0]) * blade[rows, 1]).sum(1)
        info = self._scene.info
        return bool((ahead - info.striker_half_thickness - info.object_radius).min() > PARTED)


class _ExecutedPath:
    """The commanded motion at another pace, drifting off by the joint offset."""

    def __init__(self, motion: Motion, chance: Chance) -> None:
        self._motion, self._pace, self._offset = motion, chance.pace, chance.joint_offset
        self.duration = motion.duration / chance.pace

    def position(self, times: Array) -> Array:
        """(times, joints) in rad."""
        share = np.minimum(times / self.duration, 1.0)[:, None]
        return self._motion.position(self._pace * times) + share**2 * (3 - 2 * share) * self._offset

    def velocity(self, times: Array) -> Array:
        """(times, joints) in rad/s."""
        share = np.minimum(times / self.duration, 1.0)[:, None]
        drift = 6 * share * (1 - share) / self.duration * self._offset
        return self._pace * self._motion.velocity(self._pace * times) + drift
