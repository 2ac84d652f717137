"""The rigs for joints by name."""

from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path

import mujoco
import numpy as np

from slapshot.config.scene import HockeySettings, SceneSettings
from slapshot.errors import InputError
from slapshot.lab.joints.rig import Clock, Rig

# MuJoCo's Runge-Kutta method of fourth order is exact to 0.01 mrad with it, and implicitfast is not.
_TIMESTEP = 0.0025  # s, of nominal models
_HOCKEY = HockeySettings(
    domain="hockey", puck="inline", timestep_s=0.001, start_m=(0.55, 0.0), board_m=(2.4, 1.2)
)


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
    """The hockey scene without what the arm does not need to move."""
    from slapshot.domains.hockey import build_scene  # takes a second to import

    spec = mujoco.MjSpec.from_string(build_scene(_HOCKEY).xml)
    for part in (*spec.pairs, *spec.cameras, *spec.lights, *spec.textures):
        spec.delete(part)
    spec.delete(spec.body("puck"))
    for name in ("board", "whiteboard"):
        spec.delete(spec.geom(name))
    spec.modelname = "kuka"
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    spec.option.timestep = _TIMESTEP  # longer than any that resolves a contact with the puck
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


def _fetchslide_arm() -> Rig:
    """FetchSlide's robot, which the environment drags by its gripper; nothing is there to touch.

    Inertias are the bodies' own, so that meshes can go. The pose of unobserved joints (base, torso,
    head) is in the model's keyframe. The weld of gripper and mocap body is set as at the environment's start;
    the integrator is Euler's with 2 ms, here and in the environment.
    """
    from slapshot.domains.fetchslide import build_scene
    from slapshot.domains.fetchslide.model import GRIPPER
    from slapshot.lab.joints.gripper import reset_state

    scene = build_scene(SceneSettings(domain="fetchslide"))
    spec = scene.spec()
    for body in list(spec.worldbody.bodies):
        if not body.name.startswith("robot0:"):
            spec.delete(body)
    parts = (spec.geoms, spec.cameras, spec.lights, spec.excludes, spec.textures, spec.materials, spec.meshes)
    for part in [part for effect in parts for part in effect]:
        spec.delete(part)
    for weld in spec.equalities:
        data = np.array(weld.data)
        data[:7] = [0, 0, 0, 0, 0, 0, 1]
        weld.data = data
    spec.modelname = "fetchslide_arm"
    spec.meshdir = spec.texturedir = ""
    model, start = spec.compile(), reset_state()
    spec.add_key(name="start", qpos=[start[model.joint(i).name][0] for i in range(model.njnt)])
    spec.compile()
    return Rig(
        name="fetchslide_arm",
        xml=spec.to_xml(),
        drive="mocap",
        base="robot0:base_link",
        tip=(GRIPPER, (0.02, 0.0, 0.0)),
        loaded=("robot0:shoulder_lift_joint", "robot0:elbow_flex_joint", "robot0:wrist_flex_joint"),
        centre=((-0.2, 0.3), (-0.3, 0.3), (0.1, 0.4)),
        swing=(0.35, 0.35, 0.25),
        band=(0.5, 1.5),
        clock=Clock(step=0.002, kept=0.002, sample=0.004, period=0.04),
        moving=(
            "robot0:shoulder_pan_joint",
            "robot0:shoulder_lift_joint",
            "robot0:upperarm_roll_joint",
            "robot0:elbow_flex_joint",
            "robot0:forearm_roll_joint",
            "robot0:wrist_flex_joint",
            "robot0:wrist_roll_joint",
        ),
        site="robot0:grip",
    )


_RIGS: Mapping[str, Callable[[], Rig]] = {
    "pendulum": _pendulum,
    "arm": _arm,
    "kuka": _kuka,
    "fetchslide_arm": _fetchslide_arm,
}
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
