"""The rigs for joints: what everybody believes of them, and how they are made to move."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Literal

import mujoco
import numpy as np
from numpy.typing import NDArray

from slapshot.errors import InputError

Array = NDArray[np.float64]

CONTROL_PERIOD = 0.005  # s, between commands and between readings of the encoders
NOMINAL_TIMESTEP = 0.0025  # s, with MuJoCo's Runge-Kutta method of fourth order
_HOCKEY = {"puck": "inline", "timestep_s": NOMINAL_TIMESTEP, "start_m": [0.55, 0.0], "board_m": [2.4, 1.2]}


@dataclass(frozen=True, eq=False)
class Rig:
    """A rig as a diagnosis is given it, and what the lab needs besides to move it.

    Attributes:
        name: of the rig.
        xml: nominal MJCF without files of its own; each joint is a hinge and has the actuator of its name.
        drive: "torque" for motors that are told a torque, "servo" for servos that are told an angle.
        base: body that stands on the ground and carries the rest.
        tip: body of the last link, and where its tip is in the body's frame (m).
        loaded: joints that gravity loads, in most poses.
        centre: (joints, 2) rad, lowest and highest angle about which an episode moves.
        swing: (joints,) rms of the multi-sine that is added: N m for motors, rad for servos.
        band: lowest and highest frequency in it, Hz.
        hold: (2,) stiffness in N m/rad and damping in N m s/rad by which a torque motor's controller keeps
            joint 1 near the centre; the others scale with `swing`.
        settle: s before an episode in which the rig comes to rest at its first command.
        turns: how its base can turn: "slide" along x, or "yaw" about the upright.
    """

    name: str
    xml: str
    drive: Literal["torque", "servo"]
    base: str
    tip: tuple[str, tuple[float, float, float]]
    loaded: tuple[str, ...]
    centre: tuple[tuple[float, float], ...]
    swing: tuple[float, ...]
    band: tuple[float, float]
    hold: tuple[float, float] = (0.0, 0.0)
    settle: float = 1.0
    turns: Literal["slide", "yaw"] = "yaw"

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints, in the model's order."""
        return _joints_of(self.xml)[0]

    @property
    def links(self) -> tuple[str, ...]:
        """Names of the bodies that the joints move, in the same order."""
        return _joints_of(self.xml)[1]

    @property
    def damping(self) -> tuple[float, ...]:
        """Of the joints, N m s/rad, that the nominal model has besides its actuators'."""
        return _joints_of(self.xml)[2]

    @property
    def armature(self) -> tuple[float, ...]:
        """Of the joints, kg m^2."""
        return _joints_of(self.xml)[3]

    @property
    def command_unit(self) -> str:
        """What an actuator is told."""
        return "N m" if self.drive == "torque" else "rad"


@cache
def _joints_of(xml: str) -> tuple[tuple[str, ...], tuple[str, ...], tuple[float, ...], tuple[float, ...]]:
    model = mujoco.MjModel.from_xml_string(xml)
    joints = tuple(model.joint(i).name for i in range(model.njnt))
    bodies = tuple(model.body(model.jnt_bodyid[i]).name for i in range(model.njnt))
    return joints, bodies, tuple(model.dof_damping.tolist()), tuple(model.dof_armature.tolist())


def _pendulum() -> Rig:
    return Rig(
        name="pendulum",
        xml=Path(__file__).with_name("pendulum.xml").read_text(),
        drive="torque",
        base="base",
        tip=("lower", (0.0, 0.0, -0.3)),
        loaded=("joint1", "joint2"),
        centre=((-0.5, 0.5), (-0.5, 0.5)),
        swing=(1.0, 0.3),
        band=(0.3, 2.5),
        hold=(2.0, 0.25),
        settle=2.0,
        turns="slide",
    )


def _arm() -> Rig:
    return Rig(
        name="arm",
        xml=Path(__file__).with_name("arm.xml").read_text(),
        drive="servo",
        base="base",
        tip=("fore", (0.28, 0.0, 0.0)),
        loaded=("joint2", "joint3"),
        centre=((-0.8, 0.8), (-0.9, 0.1), (0.2, 1.2)),
        swing=(0.35, 0.25, 0.35),
        band=(0.3, 2.5),
    )


def _kuka() -> Rig:
    from slapshot.scenes.hockey import build_scene  # takes a second to import

    spec = mujoco.MjSpec.from_string(build_scene(_HOCKEY).xml)
    for part in (*spec.pairs, *spec.cameras, *spec.lights, *spec.textures):
        spec.delete(part)
    spec.delete(spec.body("puck"))
    for name in ("board", "whiteboard"):
        spec.delete(spec.geom(name))
    spec.modelname = "kuka"
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    spec.compile()
    return Rig(
        name="kuka",
        xml=spec.to_xml(),
        drive="servo",
        base="base",
        tip=("blade", (0.0, 0.0, 0.03)),
        loaded=(),  # the controller compensates gravity
        centre=((-0.6, 0.6), (0.2, 0.7), (-0.6, 0.6), (0.6, 1.2), (-0.6, 0.6), (0.3, 0.9), (-0.6, 0.6)),
        swing=(0.2, 0.12, 0.2, 0.15, 0.25, 0.2, 0.25),
        band=(0.3, 1.5),
    )


_RIGS: Mapping[str, Callable[[], Rig]] = {"pendulum": _pendulum, "arm": _arm, "kuka": _kuka}
RIGS = tuple(_RIGS)


@cache
def rig_named(name: str) -> Rig:
    """A rig.

    Raises:
        InputError: there is none of that name.
    """
    if name not in _RIGS:
        raise InputError(f"lab: no rig {name!r}; use one of: {', '.join(RIGS)}")
    return _RIGS[name]()


def nominal_model(name: str) -> str:
    """MJCF of a rig as everybody believes it to be.

    Raises:
        InputError: there is no rig of that name.
    """
    return rig_named(name).xml
