"""A rig file: the nominal scene that a recording is held against, in YAML.

scene: {domain: hockey, ...}       # as in the block `scene` of a domain's configuration
friction: [0.55, 0.55, 0.0255]     # nominal mu_x, mu_y and torsional friction in m
camera_m: [1.65, 0.0]              # point of the plane that the camera looks at
effects: [my_package.my_effect]    # modules with effects of one's own (optional)
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jsonschema
import mujoco
import numpy as np

from slapshot.diagnosis.result import Setting
from slapshot.errors import InputError
from slapshot.scenes.domain import load_domain
from slapshot.scenes.randomisation import middle_condition
from slapshot.scenes.scene import Scene
from slapshot.yaml_file import read_yaml

_POSITIVE = {"type": "number", "exclusiveMinimum": 0, "maximum": 10}
SCHEMA: dict[str, Any] = {
    "type": "object",
    "additionalProperties": False,
    "required": ["scene", "friction", "camera_m"],
    "properties": {
        "scene": {"type": "object", "required": ["domain"], "description": "block `scene` of a domain"},
        "friction": {
            "type": "array",
            "minItems": 3,
            "maxItems": 3,
            "items": _POSITIVE,
            "description": "nominal mu_x, mu_y, and torsional friction in m",
        },
        "camera_m": {
            "type": "array",
            "minItems": 2,
            "maxItems": 2,
            "items": {"type": "number", "minimum": -100, "maximum": 100},
            "description": "x, y in m of the point that the camera looks at",
        },
        "effects": {
            "type": "array",
            "items": {"type": "string", "minLength": 1},
            "description": "modules that define effects of one's own",
        },
    },
}


@dataclass(frozen=True)
class RigFile:
    """A nominal scene and what a diagnosis needs beside it.

    Attributes:
        scene: nominal.
        setting: for `diagnose`.
        effects: modules with effects of one's own.
    """

    scene: Scene
    setting: Setting
    effects: tuple[str, ...]


def read_rig(file: Path) -> RigFile:
    """Read and check a rig file.

    Raises:
        InputError: it is missing, or something in it is not allowed; one line for a person.
    """
    raw = read_yaml(file)
    error = jsonschema.exceptions.best_match(jsonschema.Draft202012Validator(SCHEMA).iter_errors(raw))
    if error is not None:
        key = ".".join(str(part) for part in error.absolute_path) or "top level"
        hint = error.schema.get("description", f"keys are {', '.join(SCHEMA['properties'])}")
        raise InputError(f"{file}: {key}: {error.message}; write {hint}")
    return _rig(raw["scene"], raw["friction"], raw["camera_m"], tuple(raw.get("effects", ())))


def rig_of_domain(domain: Mapping[str, Any]) -> RigFile:
    """The rig that a domain of a checked configuration describes."""
    condition = middle_condition(domain["randomisation"])
    scene = load_domain(domain["scene"]["domain"]).build_scene(domain["scene"])
    friction = [condition[f"friction_{axis}"] for axis in ("x", "y", "torsional")]
    return RigFile(scene, setting_of(scene, friction), ())


def camera_foot(scene: Scene) -> tuple[float, float]:
    """Point of the plane below the camera that looks down most steeply; the start if there is none."""
    model = scene.compile()
    best, foot = 0.8, scene.info.start
    for i in range(model.ncam):
        rotation = np.empty(9)
        mujoco.mju_quat2Mat(rotation, model.cam_quat[i])
        down = rotation.reshape(3, 3)[2, 2]  # a camera looks along its own -z
        if down > best:
            place = model.cam_pos[i]
            best, foot = down, (float(place[0]), float(place[1]))
    return foot


def _rig(settings: Mapping[str, Any], friction: Any, camera: Any, effects: tuple[str, ...]) -> RigFile:
    scene = load_domain(settings["domain"]).build_scene(settings)
    return RigFile(scene, setting_of(scene, friction, camera), effects)


def setting_of(scene: Scene, friction: Sequence[float], camera: Sequence[float] | None = None) -> Setting:
    """What `diagnose` needs to know; without a point for the camera, that below the scene's own."""
    # Without an arm there is nothing that commands could move.
    armed = scene if scene.info.joints else None
    mu = (float(friction[0]), float(friction[1]), float(friction[2]))
    foot = np.array(camera if camera is not None else camera_foot(scene), float)
    return Setting(scene.info.object_radius, foot, mu, armed)
