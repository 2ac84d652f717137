"""Nominal description of a rig with joints, its excitation and its channels."""

from dataclasses import dataclass
from functools import cache
from typing import Literal, NamedTuple

import mujoco
import numpy as np

from slapshot.arrays import Array
from slapshot.recordings.channels import PLACE, QUATERNION, Channel

_ENCODERS, _COMMANDS = "encoders", "commands"  # clocks


class Clock(NamedTuple):
    """Times in s, each a whole multiple of the one before.

    Attributes:
        step: of the lab's integration.
        kept: between positions that are kept.
        sample: between readings of the encoders.
        period: between commands.
    """

    step: float = 2.5e-4
    kept: float = 1e-3
    sample: float = 5e-3
    period: float = 5e-3


CLOCK = Clock()


@dataclass(frozen=True, eq=False)
class Rig:
    """A rig as given to a diagnosis, with further data for the lab.

    Attributes:
        name: of the rig.
        xml: nominal MJCF, angles in radians, without files of its own and with hinges and slides alone. Each
            joint that moves has the actuator of its name, but for a gripper that is dragged.
        drive: "torque" for torque motors, "servo" for position servos, "mocap" for a gripper that is dragged
            by a velocity-controlled body.
        base: body that stands on the ground and carries the rest.
        tip: body of the last link, and where its tip is in the body's frame (m).
        loaded: joints that gravity loads, in most poses.
        centre: lowest and highest angle (rad) of each joint about which an episode moves; of a gripper, the
            velocity (shares of the largest) along each axis with which it leaves its start.
        swing: rms of the multi-sine that is added to each: N m, rad, or shares of the largest velocity.
        band: lowest and highest frequency in it, Hz.
        hold: stiffness in N m/rad and damping in N m s/rad by which a torque motor's controller keeps joint 1
            near the centre; the others' scale with `swing`.
        settle: s before an episode, in which the rig comes to rest.
        turns: how its base can turn: "slide" along x, or "yaw" about the upright.
        clock: when things happen.
        moving: joints that are observed; all if empty.
        site: whose position is also observed, if any.
    """

    name: str
    xml: str
    drive: Literal["torque", "servo", "mocap"]
    base: str
    tip: tuple[str, tuple[float, float, float]]
    loaded: tuple[str, ...]
    centre: tuple[tuple[float, float], ...]
    swing: tuple[float, ...]
    band: tuple[float, float]
    hold: tuple[float, float] = (0.0, 0.0)
    settle: float = 1.0
    turns: Literal["slide", "yaw"] = "yaw"
    clock: Clock = CLOCK
    moving: tuple[str, ...] = ()
    site: str | None = None

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints that are observed, in the model's order."""
        return self.moving or tuple(_joints_of(self.xml))

    @property
    def links(self) -> tuple[str, ...]:
        """Names of the bodies that these joints move."""
        return tuple(_joints_of(self.xml)[name].link for name in self.joints)

    @property
    def damping(self) -> Array:
        """Of these joints, N m s/rad, that the nominal model has besides its actuators'."""
        return np.array([_joints_of(self.xml)[name].damping for name in self.joints])

    @property
    def armature(self) -> Array:
        """Of these joints, kg m^2."""
        return np.array([_joints_of(self.xml)[name].armature for name in self.joints])

    def controls(self) -> dict[str, Channel]:
        """Control channels, in the order of `SimulatedMotion.commands`."""
        if self.drive != "mocap":
            unit = "N m" if self.drive == "torque" else "rad"
            return {
                f"{name}_command": Channel(
                    clock=_ENCODERS, role="control", quantity="command", actuator=name, unit=unit
                )
                for name in self.joints
            }
        body = _mocap_of(self.xml)
        return {
            f"target_{component}": Channel(
                clock=_COMMANDS,
                role="control",
                quantity="position",
                body=body,
                component=component,
                unit="m" if component in PLACE else "1",
            )
            for component in (*PLACE, *QUATERNION)
        }

    def observations(self) -> dict[str, Channel]:
        """Observation channels: joints, then the site's position."""
        found = {
            f"{_plain(name)}_position": Channel(
                clock=_ENCODERS, role="observation", quantity="position", joint=name, unit="rad"
            )
            for name in self.joints
        }
        for component in PLACE if self.site else ():
            found[f"{_plain(str(self.site))}_{component}"] = Channel(
                clock=_ENCODERS,
                role="observation",
                quantity="position",
                site=self.site,
                component=component,
                unit="m",
            )
        return found


def _plain(name: str) -> str:
    """A name in a model as a column may have it."""
    return name.rpartition(":")[2]


class _Joint(NamedTuple):
    link: str
    damping: float
    armature: float


@cache
def _joints_of(xml: str) -> dict[str, _Joint]:
    model = mujoco.MjModel.from_xml_string(xml)
    return {
        model.joint(i).name: _Joint(
            model.body(model.jnt_bodyid[i]).name,
            float(model.dof_damping[model.jnt_dofadr[i]]),
            float(model.dof_armature[model.jnt_dofadr[i]]),
        )
        for i in range(model.njnt)
    }


@cache
def _mocap_of(xml: str) -> str:
    model = mujoco.MjModel.from_xml_string(xml)
    return next(model.body(i).name for i in range(model.nbody) if model.body_mocapid[i] >= 0)


_WAVES = 6  # sines that are added up
_RAMP = 0.3  # s, in which they set in


@dataclass(frozen=True, eq=False)
class Excitation:
    """Of a session; joints and units as in `Rig.centre` and `Rig.swing`.

    Attributes:
        centre: (episodes, joints).
        wave: (episodes, commands, joints), 0 in the beginning.
    """

    centre: Array
    wave: Array


def draw_excitation(rig: Rig, episodes: int, seconds: float, rng: np.random.Generator) -> Excitation:
    """Sums of sines with random phases and frequencies, which set in smoothly from rest."""
    size = (episodes, len(rig.swing), _WAVES)
    low, high = np.array(rig.centre).T
    centre = rng.uniform(low, high, size[:2])
    frequency = np.exp(rng.uniform(np.log(rig.band[0]), np.log(rig.band[1]), size))
    phase, share = rng.uniform(0, 2 * np.pi, size), rng.uniform(0.5, 1.0, size)
    share *= np.array(rig.swing)[:, None] * np.sqrt(2 / (share**2).sum(-1, keepdims=True))
    times = np.arange(round(seconds / rig.clock.period)) * rig.clock.period
    angle = 2 * np.pi * frequency[..., None] * times + phase[..., None]
    rise = np.clip(times / _RAMP, 0, 1)
    rise = rise**3 * (10 - 15 * rise + 6 * rise**2)
    wave = (share[..., None] * np.sin(angle)).sum(2) * rise
    return Excitation(centre, wave.transpose(0, 2, 1).copy())
