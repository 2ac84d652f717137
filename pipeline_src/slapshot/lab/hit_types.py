"""Data of a hit at three stages: its specification, the launch of the object, and the outcome."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from slapshot.arrays import Array
from slapshot.lab.rig import Scatter
from slapshot.trajectories.motion import Motion


@dataclass(frozen=True, eq=False)
class HitNoise:
    """Random variation of one hit.

    Attributes:
        start_error: (2,) m.
        pace: factor on the speed of execution.
        joint_offset: (joints,) rad, reached smoothly at the motion's end.
        friction: factor on the object's friction.
        quirk: hidden effect -> a standard normal number that it uses; 0 where there is none.
    """

    start_error: Array
    pace: float
    joint_offset: Array
    friction: float
    quirk: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class HitSpec:
    """Specification of one hit.

    Attributes:
        motion: as commanded.
        object_id: the object to hit.
        chance: random variation of the hit.
        place: position within the session, from 0 for its first hit to 1 for its last.
    """

    motion: Motion
    object_id: str
    chance: HitNoise
    place: float = 0.0


@dataclass(frozen=True, eq=False)
class Launch:
    """A hit up to the moment from which the object slides freely; times from the start of the motion.

    Attributes:
        track: (n, 3) x, y (m), yaw (rad) of the object every control period, the last row at the launch.
        joints: (m, joints) rad, joint positions without encoder noise, every control period.
        time: s, of the launch.
        state: (6,) x, y (m), yaw (rad), vx, vy (m/s), spin (rad/s) at that time.
    """

    track: Array
    joints: Array
    time: float
    state: Array


@dataclass(frozen=True, eq=False)
class Hit:
    """The true outcome of a hit; times from the start of the motion.

    Attributes:
        track: (n, 4) t (s), x, y (m), yaw (rad) of the object every control period until it rests.
        joints: (m, 1 + joints) t (s) and positions (rad) of the arm every control period.
        launch_time: s.
        launch: (6,) x, y (m), yaw (rad), vx, vy (m/s), spin (rad/s) at that time.
        rest: (3,) x, y (m), yaw (rad).
        end: s, time at which the object comes to rest.
    """

    track: Array
    joints: Array
    launch_time: float
    launch: Array
    rest: Array
    end: float


def draw_hit_noise(scatter: Scatter, rng: np.random.Generator) -> HitNoise:
    """Draw the random variation of one hit."""
    return HitNoise(
        start_error=rng.normal(0, scatter.start_error_sd, 2),
        pace=float(np.exp(rng.normal(0, scatter.speed_sd))),
        joint_offset=rng.normal(0, scatter.joint_offset_sd),
        friction=float(np.exp(rng.normal(0, scatter.friction_sd))),
    )
