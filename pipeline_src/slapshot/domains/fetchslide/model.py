"""The environment's own MJCF, meshes and constants (gymnasium-robotics, FetchSlide-v4).

World frame: right-handed, z up, the table's surface at z = 0.4 m. The puck has a free joint and may tip.
Contacts are defined by the geoms, with pyramidal cones and a step of 2 ms. Contacts of puck and table have
dimension 3, so that of the parameters that table I of the paper randomises only linear friction acts.
"""

import importlib.util
from pathlib import Path

from slapshot.config.scene import SceneSettings
from slapshot.errors import InputError
from slapshot.scenes.scene import Scene, SceneInfo

OBJECT, TABLE = "object0", "table0"
OBJECT_JOINT = "object0:joint"
GRIPPER, MOCAP = "robot0:gripper_link", "robot0:mocap"
FINGER_JOINTS = ("robot0:r_gripper_finger_joint", "robot0:l_gripper_finger_joint")
JOINTS = (
    *(f"robot0:slide{i}" for i in range(3)),
    "robot0:torso_lift_joint",
    "robot0:head_pan_joint",
    "robot0:head_tilt_joint",
    "robot0:shoulder_pan_joint",
    "robot0:shoulder_lift_joint",
    "robot0:upperarm_roll_joint",
    "robot0:elbow_flex_joint",
    "robot0:forearm_roll_joint",
    "robot0:wrist_flex_joint",
    "robot0:wrist_roll_joint",
    *FINGER_JOINTS,
)

SUBSTEPS = 20  # of 2 ms, from one command to the next
CONTROL_PERIOD = 0.04  # s
STEP = 0.05  # m, displacement that a command of 1 demands in a control period
TABLE_HEIGHT = 0.4  # m
TABLE_MIDDLE = (1.32441906, 0.75018422)  # m
TABLE_HALF = (0.625, 0.45)  # m
PUCK_RADIUS, PUCK_HEIGHT = 0.025, 0.04  # m
FINGER_HALF_THICKNESS = 0.0135  # m, along x
# Position of the gripper (site robot0:grip) after the environment's reset, in m.
GRIP_START = (1.0130, 0.7492, 0.4155)


def build_scene(settings: SceneSettings) -> Scene:
    """Build FetchSlide's scene; the block `scene` holds nothing but the domain's name.

    Raises:
        InputError: gymnasium-robotics is not installed, or is not the version whose scene this is.
    """
    info = SceneInfo(
        joints=JOINTS,
        commands=3,
        object_body=OBJECT,
        object_joints=(),
        object_radius=PUCK_RADIUS,
        object_height=PUCK_HEIGHT,
        object_pair="",
        striker_pair="",
        striker_site="robot0:grip",
        striker_half_thickness=FINGER_HALF_THICKNESS,
        clearance_geoms=(),
        start=TABLE_MIDDLE,
        servo_time=0.0,
        torque_limits=(),
        speed_limits=(),
        control_period=CONTROL_PERIOD,
        plane_height=TABLE_HEIGHT,
    )
    folder = _asset_folder()
    files = [
        folder / "fetch" / "shared.xml",
        folder / "fetch" / "robot.xml",
        folder / "textures" / "block.png",
        *sorted((folder / "stls" / "fetch").glob("*.stl")),
    ]
    scene = folder / "fetch" / "slide.xml"
    for file in (scene, *files):
        if not file.is_file():
            raise InputError(
                f"scene.domain: gymnasium-robotics has no {file.relative_to(folder)}; run `make setup`, "
                "which installs the right version"
            )
    return Scene(scene.read_text(), info, {file.name: file.read_bytes() for file in files})


def _asset_folder() -> Path:
    # The package is located but not imported, because an import registers environments and emits warnings.
    spec = importlib.util.find_spec("gymnasium_robotics")
    if spec is None or spec.origin is None:
        raise InputError(
            "scene.domain: 'fetchslide' needs the scene of gymnasium-robotics, which is not installed; "
            "run: make setup"
        )
    return Path(spec.origin).parent / "envs" / "assets"
