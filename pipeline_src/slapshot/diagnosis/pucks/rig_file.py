"""A rig file: the nominal scene that a recording is held against, in YAML.

scene: {domain: hockey, ...}       # as in the block `scene` of a domain's configuration
friction: [0.55, 0.55, 0.0255]     # nominal mu_x, mu_y and torsional friction in m
camera_m: [1.65, 0.0]              # point of the plane that the camera looks at
effects: [my_package.my_effect]    # modules with effects of one's own (optional)
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import mujoco
import numpy as np
from pydantic import ConfigDict, Field, create_model

from slapshot.config.scene import Coordinate, SceneSettings
from slapshot.diagnosis.pucks.result import Setting
from slapshot.errors import InputError
from slapshot.own_code import MODULE
from slapshot.scenes.domain import build_scene, load_domain, scene_settings
from slapshot.scenes.randomisation import middle_condition
from slapshot.scenes.scene import Scene
from slapshot.text import reason_of
from slapshot.validation import Model, key_of, validated
from slapshot.yaml_file import read_document

if TYPE_CHECKING:  # a verdict does not depend on what else a domain may say
    from slapshot.config.domain import Domain

# Of dry solids: from sliding on ice or an air cushion to clean metal on itself.
Friction = Annotated[float, Field(ge=1e-3, le=10, description="coefficient of friction")]
# In m; less than that is none, and more no rig has.
Torsional = Annotated[float, Field(ge=1e-6, le=10)]
# Torsional friction over the coefficient is the lever at which friction holds a turn: two thirds of a disc's
# radius under even pressure. Much more than the object's size is a slip of the unit.
LONGEST_LEVER = 5  # radii of the object


class SceneBlock(SceneSettings):
    """Block `scene` of any domain, whose other keys are the domain's."""

    model_config = ConfigDict(extra="allow")


class RigSettings(Model):
    """What a rig file may say."""

    scene: SceneBlock = Field(description="block `scene` of a domain")
    friction: tuple[Friction, Friction, Torsional] = Field(
        description="nominal mu_x, mu_y, and torsional friction in m"
    )
    camera_m: tuple[Coordinate, Coordinate] = Field(
        description="x, y in m of the point that the camera looks at"
    )
    effects: tuple[Annotated[str, Field(pattern=MODULE, max_length=200)], ...] = Field(
        default=(), description="dotted names of modules that define effects of one's own"
    )


@dataclass(frozen=True)
class RigFile:
    """A nominal scene and what a diagnosis needs beside it.

    Attributes:
        scene: nominal.
        setting: for `diagnose`.
        effects: module with effects of one's own -> file and key that name it.
    """

    scene: Scene
    setting: Setting
    effects: Mapping[str, str] = field(default_factory=dict)


def read_rig(file: Path) -> RigFile:
    """Read and check a rig file.

    Raises:
        InputError: it is missing, or something in it is not allowed; one line for a person.
    """
    document = read_document(file)
    settings = validated(RigSettings, document.values, document.where)

    def where(*loc: str | int) -> str:
        return f"{document.where(loc)}: {key_of(loc)}"

    domain = load_domain(settings.scene.domain, where("scene", "domain"))
    # Of the whole file, so that what is wrong in the block has its place in it.
    of_domain = create_model("RigOfDomain", __base__=RigSettings, scene=(scene_settings(domain), ...))
    checked: RigSettings = validated(of_domain, document.values, document.where)
    try:
        scene = domain.build_scene(checked.scene)
        setting = setting_of(scene, settings.friction, settings.camera_m)
        scene.compile()
    except (Exception, SystemExit) as error:  # a domain may be anybody's code, and MuJoCo refuses much
        problem = f"cannot be built ({reason_of(error)}); correct it"
        raise InputError(f"{where('scene')}: {problem}") from None
    torsional, mu = settings.friction[2], max(settings.friction[:2])
    largest = LONGEST_LEVER * setting.radius * mu
    if torsional > largest:
        raise InputError(
            f"{where('friction', 2)}: {torsional:g} m is out of range; it must be <= {largest:.3g} m for "
            f"this object of radius {setting.radius:.3g} m"
        )
    effects = {module: where("effects", i) for i, module in enumerate(settings.effects)}
    return RigFile(scene, setting, effects)


def rig_of_domain(domain: "Domain") -> RigFile:
    """The rig that a domain of a checked configuration describes."""
    condition = middle_condition(domain.randomisation)
    scene = build_scene(domain.scene)
    friction = [condition[f"friction_{axis}"] for axis in ("x", "y", "torsional")]
    return RigFile(scene, setting_of(scene, friction))


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


def setting_of(scene: Scene, friction: Sequence[float], camera: Sequence[float] | None = None) -> Setting:
    """What `diagnose` needs to know; without a point for the camera, that below the scene's own."""
    # Without an arm there is nothing that commands could move.
    armed = scene if scene.info.joints else None
    mu = (float(friction[0]), float(friction[1]), float(friction[2]))
    foot = np.array(camera if camera is not None else camera_foot(scene), float)
    return Setting(scene.info.object_radius, foot, mu, armed)
