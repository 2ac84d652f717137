"""A hit in three stages: what is to be done, how the object is launched, and what became of it."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from slapshot.arrays import Array
from slapshot.lab.rig import Scatter
from slapshot.trajectories.motion import Motion


@dataclass(frozen=True, eq=False)
class HitNoise:
    """What chance does to one hit.

    Attributes:
        start_error: (2,) m.
        pace: factor on the speed of execution.
        joint_offset: (joints,) rad, reached smoothly at the motion's end.
        friction: factor on the object's friction.
        quirk: concealed kind -> a standard normal number for it; 0 where there is none.
    """

    start_error: Array
    pace: float
    joint_offset: Array
    friction: float
    quirk: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class HitSpec:
    """What is to be done in one hit.

    Attributes:
        motion: as commanded.
        object_id: what is hit.
        chance: what chance does to it.
        place: in the session; 0 for its first hit, 1 for its last.
    """

    motion: Motion
    object_id: str
    chance: HitNoise
    place: float = 0.0


@dataclass(frozen=True, eq=False)
class Launch:
    """A hit up to where the object slides freely; times from the start of the motion.

    Attributes:
        track: (n, 3) x, y (m), yaw (rad) of the object every control period, the last row at the launch.
        joints: (m, joints) rad, as the encoders have them, every control period.
        time: s.
        state: (6,) x, y (m), yaw (rad), vx, vy (m/s), spin (rad/s) at that time.
    """

    track: Array
    joints: Array
    time: float
    state: Array


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


def draw_hit_noise(scatter: Scatter, rng: np.random.Generator) -> HitNoise:
    """Draw what differs from hit to hit."""
    return HitNoise(
        start_error=rng.normal(0, scatter.start_error_sd, 2),
        pace=float(np.exp(rng.normal(0, scatter.speed_sd))),
        joint_offset=rng.normal(0, scatter.joint_offset_sd),
        friction=float(np.exp(rng.normal(0, scatter.friction_sd))),
    )
