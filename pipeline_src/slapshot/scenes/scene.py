"""A scene for the later stages: a MuJoCo model and the names of its elements, independent of the domain."""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

import mujoco
import numpy as np
from numpy.typing import NDArray

from slapshot.arrays import Array

T = TypeVar("T", float, NDArray[np.float64])

_ASSETS = "assets"  # folder of a saved scene


@dataclass(frozen=True)
class SceneInfo:
    """Names and sizes in a scene where a robot strikes an object that slides on a plane.

    An attribute that does not apply is empty or 0: the joints of an object with a free joint, the contact
    pairs of a scene whose contacts are defined by its geoms, the servos of a robot that is not commanded by
    joint.

    Attributes:
        joints: the robot's joints.
        commands: dimension of a command; for an arm with servos, one target for each of `joints`.
        object_body: body that is struck; its joints are object_joints: x, y, z (m) and yaw (rad).
        object_joints: names of those joints.
        object_radius: m, of the flat cylinder.
        object_height: m.
        object_pair: contact pair of plane and object, with friction (y, x, torsional, rolling, rolling).
        striker_pair: contact pair of striker and object.
        striker_site: site at the centre of the striker, x axis normal to its striking face.
        striker_half_thickness: m, from the site to the face.
        clearance_geoms: geoms that must stay above the plane.
        start: nominal x and y in m of the object before a hit; the centre of all starts if swings differ in
        it.
        servo_time: s; servo targets are q + servo_time * dq/dt, so that joints track without lag.
        torque_limits: N m.
        speed_limits: rad/s.
        control_period: s, between commands.
        plane_height: m, z of the plane.
    """

    joints: tuple[str, ...]
    commands: int
    object_body: str
    object_joints: tuple[str, ...]
    object_radius: float
    object_height: float
    object_pair: str
    striker_pair: str
    striker_site: str
    striker_half_thickness: float
    clearance_geoms: tuple[str, ...]
    start: tuple[float, float]
    servo_time: float
    torque_limits: tuple[float, ...]
    speed_limits: tuple[float, ...]
    control_period: float
    plane_height: float = 0.0


@dataclass(frozen=True)
class Scene:
    """MJCF text, the names of its elements, and the files that it refers to (meshes, included MJCF)."""

    xml: str
    info: SceneInfo
    assets: Mapping[str, bytes] = field(default_factory=dict, hash=False, repr=False)

    def compile(self, timestep: float | None = None) -> mujoco.MjModel:
        """Compile a new model, with the integration step `timestep` (s) if it is given."""
        model = mujoco.MjModel.from_xml_string(self.xml, dict(self.assets))
        if timestep is not None:
            model.opt.timestep = timestep
        return model

    def spec(self) -> mujoco.MjSpec:
        """A new specification to edit."""
        included = {name: text for name, text in self.assets.items() if name.endswith(".xml")}
        return mujoco.MjSpec.from_string(self.xml, include=included, assets=dict(self.assets))

    @cached_property
    def layout(self) -> "Layout":
        """Addresses in qpos, qvel and the model's arrays."""
        model = self.compile()
        info = self.info
        return Layout(
            arm_q=np.array([model.joint(j).qposadr[0] for j in info.joints], np.int64),
            arm_v=np.array([model.joint(j).dofadr[0] for j in info.joints], np.int64),
            object_q=np.array([model.joint(j).qposadr[0] for j in info.object_joints], np.int64),
            object_v=np.array([model.joint(j).dofadr[0] for j in info.object_joints], np.int64),
            object_body=model.body(info.object_body).id,
            object_pair=model.pair(info.object_pair).id if info.object_pair else -1,
            striker_site=model.site(info.striker_site).id,
            joint_low=np.array([model.joint(j).range[0] for j in info.joints]),
            joint_high=np.array([model.joint(j).range[1] for j in info.joints]),
        )

    def save(self, folder: Path) -> None:
        """Write scene.xml, scene.json and, if there are assets, their folder."""
        (folder / "scene.xml").write_text(self.xml)
        for name, content in self.assets.items():
            (folder / _ASSETS).mkdir(exist_ok=True)
            (folder / _ASSETS / name).write_bytes(content)
        (folder / "scene.json").write_text(json.dumps(asdict(self.info), indent=2) + "\n")

    @classmethod
    def load(cls, folder: Path) -> "Scene":
        """Read what `save` wrote."""
        raw = json.loads((folder / "scene.json").read_text())
        fields: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in raw.items()}
        assets = {path.name: path.read_bytes() for path in sorted((folder / _ASSETS).glob("*"))}
        return cls((folder / "scene.xml").read_text(), SceneInfo(**fields), assets)


@dataclass(frozen=True)
class Layout:
    """Addresses of robot and object in MuJoCo's arrays, -1 for missing elements; joint ranges in rad."""

    arm_q: NDArray[np.int64]
    arm_v: NDArray[np.int64]
    object_q: NDArray[np.int64]
    object_v: NDArray[np.int64]
    object_body: int
    object_pair: int
    striker_site: int
    joint_low: Array
    joint_high: Array


def set_condition(model: mujoco.MjModel, layout: Layout, condition: Mapping[str, float]) -> None:
    """Set the mass (kg) and friction of a condition in a model.

    Calls mj_setConst, because gravity acts on the subtree masses that it precomputes.
    """
    body = layout.object_body
    scale = condition["mass"] / model.body_mass[body]
    model.body_mass[body] *= scale
    model.body_inertia[body] *= scale
    model.pair_friction[layout.object_pair] = pair_friction(condition)
    mujoco.mj_setConst(model, mujoco.MjData(model))


def pair_friction(condition: Mapping[str, T]) -> list[T]:
    """MuJoCo's five friction coefficients, or arrays of them; tangent 1 on a horizontal plane is world y."""
    rolling = condition["friction_rolling"]
    return [
        condition["friction_y"],
        condition["friction_x"],
        condition["friction_torsional"],
        rolling,
        rolling,
    ]
