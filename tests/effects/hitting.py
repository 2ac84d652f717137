"""Hits in MuJoCo and slides by the slide law, with effects; scenes in which they have closed forms."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from slapshot.arrays import Array
from slapshot.effects.effect import Effect
from slapshot.effects.slide_law import ActiveEffect, Tracks, slide
from slapshot.scenes.domain import load_domain
from slapshot.scenes.scene import Scene, SceneInfo
from slapshot.trajectories.motion import Motion
from told import scripted_hits

RADIUS = 0.04  # m, of the paddle's disc
FRICTION = 0.05  # of paddle and disc
SOLREF = (0.01, 0.4)  # of paddle and disc
SPEED = 1.2  # m/s, of the paddle

# A heavy cart on rails; the paddle that it carries is a part of the cart, as the disc's board is smooth.
_PADDLE_XML = f"""
<mujoco>
  <compiler angle="radian"/>
  <option timestep="0.0005" cone="elliptic" integrator="implicitfast"/>
  <worldbody>
    <geom name="floor" type="plane" size="3 3 .1" contype="0" conaffinity="0"/>
    <body name="cart" pos="-0.07 0 0.3" gravcomp="1">
      <joint name="drive" type="slide" axis="1 0 0" armature="10000" range="-10 10"/>
      <geom name="cart" type="box" size=".1 .1 .05" mass="1" contype="0" conaffinity="0"/>
      <geom name="paddle" type="box" pos="0 0 -.265" size=".005 .2 .03" mass=".1"
        contype="0" conaffinity="0"/>
      <site name="face" pos="0 0 -.265"/>
    </body>
    <body name="disc" pos="0 0 .012">
      <joint name="dx" type="slide" axis="1 0 0"/>
      <joint name="dy" type="slide" axis="0 1 0"/>
      <joint name="dz" type="slide" axis="0 0 1"/>
      <joint name="turn" type="hinge" axis="0 0 1"/>
      <geom name="disc" type="cylinder" size="{RADIUS} .012" mass=".1" contype="0" conaffinity="0"/>
    </body>
  </worldbody>
  <actuator><position name="motor" joint="drive" kp="1e6" kv="5e4"/></actuator>
  <contact>
    <pair name="ground" geom1="floor" geom2="disc" condim="4" friction="1e-5 1e-5 1e-5 1e-5 1e-5"
      solref=".005 1"/>
    <pair name="impact" geom1="paddle" geom2="disc" condim="3"
      friction="{FRICTION} {FRICTION} .01 .01 .01" solref="{SOLREF[0]} {SOLREF[1]}"/>
  </contact>
</mujoco>
"""
PADDLE = Scene(
    _PADDLE_XML,
    SceneInfo(
        joints=("drive",),
        commands=1,
        object_body="disc",
        object_joints=("dx", "dy", "dz", "turn"),
        object_radius=RADIUS,
        object_height=0.024,
        object_pair="ground",
        striker_pair="impact",
        striker_site="face",
        striker_half_thickness=0.005,
        clearance_geoms=("paddle",),
        start=(0.0, 0.0),
        servo_time=0.05,
        torque_limits=(1e4,),
        speed_limits=(10.0,),
        control_period=0.001,
    ),
)


@dataclass(frozen=True, eq=False)
class Swing:
    """What the servos of a scene's arm are sent, and how the arm begins.

    Attributes:
        targets: (ticks, joints) rad or m.
        begin: (joints,) rad or m.
        speed: m/s or rad/s of all joints at the beginning.
    """

    scene: Scene
    targets: Array
    begin: Array
    speed: float = 0.0


@dataclass(frozen=True, eq=False)
class Course:
    """What happened, one row a tick.

    Attributes:
        model: that was simulated.
        arm: (ticks, joints) positions.
        object: (ticks, 4) x, y, z (m, from the start) and yaw (rad).
        velocity: (ticks, 4) its time derivative.
    """

    model: mujoco.MjModel
    arm: Array
    object: Array
    velocity: Array

    @property
    def speed(self) -> float:
        """m/s of the object at the end."""
        return float(np.hypot(*self.velocity[-1, :2]))

    @property
    def heading(self) -> float:
        """rad, of the object's velocity at the end."""
        return float(np.arctan2(self.velocity[-1, 1], self.velocity[-1, 0]))

    @property
    def spin(self) -> float:
        """rad/s at the end."""
        return float(self.velocity[-1, 3])


def push(scene: Scene = PADDLE) -> Swing:
    """The cart goes ahead at SPEED for a tenth of a second."""
    info = scene.info
    times = np.arange(100) * info.control_period
    return Swing(scene, SPEED * (times[:, None] + info.servo_time), np.zeros(1), SPEED)


def arm_swing(scene: Scene) -> Swing:
    """A scripted hit of the arm, up to when the puck has left the blade."""
    settings = scripted_hits()
    task = {"heading": 0.2, "speed": 1.3, "contact_offset": 0.02}
    (waypoints,) = load_domain("hockey").demonstrate(scene, settings, [task])
    motion = Motion.through(waypoints, settings.duration_s)
    times = np.arange(700) * scene.info.control_period
    return Swing(scene, motion.servo_targets(times, scene.info.servo_time), waypoints[0])


def edited(
    scene: Scene, effect: Effect | None = None, values: Mapping[str, float] | None = None
) -> mujoco.MjModel:
    """The scene's model with one effect."""
    spec = mujoco.MjSpec.from_string(scene.xml)
    if effect is not None:
        effect.edit(effect.neutral() | dict(values or {}), spec, scene.info)
    return spec.compile()


def execute(swing: Swing, effect: Effect | None = None, timestep: float = 5e-4, **values: float) -> Course:
    """Simulate a swing, and the hit if it makes one, with one effect; other values are neutral."""
    info = swing.scene.info
    model = edited(swing.scene, effect, values)
    model.opt.timestep = timestep
    data = mujoco.MjData(model)
    targets = swing.targets
    if effect is not None:
        targets = effect.command(effect.neutral() | values, targets, info.control_period)
    arm, arm_v = addresses(model, info.joints)
    puck, puck_v = addresses(model, info.object_joints)
    data.qpos[arm], data.qvel[arm_v] = swing.begin, swing.speed
    rows = []
    for target in targets:
        data.ctrl[:] = target
        mujoco.mj_step(model, data, round(info.control_period / timestep))
        rows.append((data.qpos[arm].copy(), data.qpos[puck].copy(), data.qvel[puck_v].copy()))
    return Course(model, *(np.array(column) for column in zip(*rows, strict=True)))


def addresses(model: mujoco.MjModel, joints: Sequence[str]) -> tuple[Array, Array]:
    """Of joints in qpos and in qvel."""
    found = [model.joint(name) for name in joints]
    return np.array([j.qposadr[0] for j in found]), np.array([j.dofadr[0] for j in found])


def slid(
    effect: Effect | None,
    launches: Sequence[Sequence[float]],
    friction: float = 0.3,
    order: Sequence[float] | None = None,
    duration: float = 1.0,
    **values: float,
) -> Tracks:
    """Slides of discs without torsional friction under one effect; values not named are neutral.

    Args:
        launches: rows of x, y, yaw, vx, vy, spin.
        friction: along x and y.
        order: of the hits, -1/2 to 1/2.
        duration: s that the tracks last.
    """
    count = len(launches)
    acting = []
    if effect is not None:
        full = {name: np.full(count, value) for name, value in (effect.neutral() | values).items()}
        acting = [ActiveEffect(effect, np.arange(count), full)]
    return slide(
        np.array(launches, float),
        np.tile((friction, friction, 1e-6), (count, 1)),
        RADIUS,
        duration,
        acting,
        None if order is None else np.array(order, float),
    )
