"""The hockey scene as MJCF: arm, floorball stick, whiteboard, puck, ceiling camera (paper, section IV-C).

World frame: right-handed, z up, origin where the robot's axis 1 meets the board's plane, x towards the
board. Lengths in metres, masses in kilograms, angles in radians unless a name says otherwise.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from dm_control import mjcf

from slapshot.arrays import GRAVITY
from slapshot.config.scene import HockeySettings, PuckName
from slapshot.scenes.scene import Scene, SceneInfo

ARM_XML = Path(__file__).with_name("kuka_lbr4plus.xml")

# Torque limits (N m) and speed limits (rad/s) of the LBR 4+: see the sources in kuka_lbr4plus.xml.
TORQUE_LIMITS = (176.0, 176.0, 100.0, 100.0, 100.0, 38.0, 38.0)
SPEED_LIMITS = (1.920, 1.920, 2.234, 2.234, 3.560, 3.211, 3.211)

# Position servo: stiffness in N m/rad (ESTIMATED, about 40 rad/s of bandwidth with the armatures above)
# and the ratio of damping to stiffness, kv = SERVO_TIME * kp (critical damping at that bandwidth).
SERVO_STIFFNESS = (8000.0, 8000.0, 5000.0, 5000.0, 1500.0, 800.0, 800.0)
SERVO_TIME = 0.05
CONTROL_PERIOD = 0.001  # s; the manufacturer's fast research interface runs at 1 to 100 ms

# Floorball stick: carbon shaft of 30 mm diameter, cut to STICK_LENGTH below the flange, with a plastic
# blade. Blade 230 mm x 60 mm is a common senior blade; thickness and masses are ESTIMATED.
WRIST_TO_FLANGE = 0.078  # published, see kuka_lbr4plus.xml
STICK_LENGTH = 0.50
STICK_RADIUS = 0.015
STICK_MASS = 0.15
BLADE_HALF_SIZE = (0.006, 0.115, 0.030)
BLADE_MASS = 0.09


@dataclass(frozen=True)
class Puck:
    """A puck: a flat cylinder.

    Attributes:
        radius: m.
        height: m.
        mass: kg, of the commercial puck (each condition draws its own mass).
        rgba: colour in visualisations.
        source: source of size and mass.
    """

    radius: float
    height: float
    mass: float
    rgba: tuple[float, float, float, float]
    source: str


PUCKS: dict[PuckName, Puck] = {
    "inline": Puck(
        0.0381,
        0.0254,
        0.100,
        (0.80, 0.12, 0.12, 1.0),
        "USA Hockey inline rules: 3 in x 1 in; mass ESTIMATED (makers sell 90 to 120 g)",
    ),
    "ice": Puck(
        0.0381,
        0.0254,
        0.163,
        (0.10, 0.12, 0.35, 1.0),
        "NHL rule 13: 3 in x 1 in, 5.5 to 6 oz (156 to 170 g)",
    ),
}


def build_scene(settings: HockeySettings) -> Scene:
    """Build the hockey scene for the block `scene` of a configuration.

    Args:
        settings: `board_m` is the visible board; the contact plane is infinite.
    """
    puck = PUCKS[settings.puck]
    info = SceneInfo(
        joints=tuple(f"q{i}" for i in range(7)),
        commands=7,
        object_body="puck",
        object_joints=("puck_x", "puck_y", "puck_z", "puck_yaw"),
        object_radius=puck.radius,
        object_height=puck.height,
        object_pair="puck_board",
        striker_pair="puck_blade",
        striker_site="blade",
        striker_half_thickness=BLADE_HALF_SIZE[0],
        clearance_geoms=("blade", "shaft", "link5", "link6", "link7"),
        start=(settings.start_m[0], settings.start_m[1]),
        servo_time=SERVO_TIME,
        torque_limits=TORQUE_LIMITS,
        speed_limits=SPEED_LIMITS,
        control_period=CONTROL_PERIOD,
    )
    return Scene(xml=build_mjcf(puck, settings).to_xml_string(), info=info)


def build_mjcf(puck: Puck, settings: HockeySettings) -> mjcf.RootElement:
    """The whole scene as an editable MJCF tree.

    There are only two contact pairs, puck and board, and puck and blade. All other collisions are excluded by
    a geometric check before a trajectory is executed (trajectories.safety).
    """
    root = mjcf.from_path(str(ARM_XML))
    root.model = "hockey"
    root.option.timestep = settings.timestep_s
    root.option.cone = "elliptic"
    root.option.integrator = "implicitfast"
    root.option.gravity = (0.0, 0.0, -GRAVITY)
    _add_servos(root)
    _add_stick(root)
    _add_board(root, settings)
    _add_puck(root, puck, settings.start_m)
    _add_contacts(root)
    _add_pictures(root, settings)
    return root


def _add_servos(root: mjcf.RootElement) -> None:
    for i, (kp, torque) in enumerate(zip(SERVO_STIFFNESS, TORQUE_LIMITS, strict=True)):
        root.actuator.add(
            "position",
            name=f"q{i}",
            joint=f"q{i}",
            kp=kp,
            kv=SERVO_TIME * kp,
            forcerange=(-torque, torque),
        )


def _add_stick(root: mjcf.RootElement) -> None:
    """Add the stick along the flange's z axis; the blade's face normal is the x axis of the blade's site."""
    link7 = root.find("body", "link7")
    # Rotated by 180 degrees about the flange's axis, so that a hit straight ahead has axis 7 in mid-range.
    stick = link7.add("body", name="stick", quat=(0, 0, 0, 1), gravcomp=1)
    stick.add(
        "geom",
        name="shaft",
        type="capsule",
        fromto=(0, 0, 0, 0, 0, STICK_LENGTH - BLADE_HALF_SIZE[2]),
        size=(STICK_RADIUS,),
        mass=STICK_MASS,
        contype=0,
        conaffinity=0,
        rgba=(0.12, 0.12, 0.13, 1),
    )
    blade = stick.add("body", name="blade", pos=(0, 0, STICK_LENGTH - BLADE_HALF_SIZE[2]), gravcomp=1)
    blade.add(
        "geom",
        name="blade",
        type="box",
        size=BLADE_HALF_SIZE,
        mass=BLADE_MASS,
        contype=0,
        conaffinity=0,
        rgba=(0.96, 0.96, 0.90, 1),
    )
    blade.add("site", name="blade", size=(0.004,), rgba=(0, 0, 0, 0))


def _add_board(root: mjcf.RootElement, settings: HockeySettings) -> None:
    root.worldbody.add(
        "geom",
        name="board",
        type="plane",
        size=(settings.board_m[0], settings.board_m[1], 0.1),
        contype=0,
        conaffinity=0,
        rgba=(0, 0, 0, 0),
    )


def _add_puck(root: mjcf.RootElement, puck: Puck, start: Sequence[float]) -> None:
    """Add the puck, which moves in x, y, z and yaw: it may hop but cannot tip.

    With a free joint the single contact point between box and cylinder moves along the puck's height from
    step to step, which tips the puck at random and makes rest points chaotic.
    """
    body = root.worldbody.add("body", name="puck", pos=(start[0], start[1], puck.height / 2))
    for axis, direction in (("x", (1, 0, 0)), ("y", (0, 1, 0)), ("z", (0, 0, 1))):
        body.add("joint", name=f"puck_{axis}", type="slide", axis=direction)
    body.add("joint", name="puck_yaw", type="hinge", axis=(0, 0, 1))
    body.add(
        "geom",
        name="puck",
        type="cylinder",
        size=(puck.radius, puck.height / 2),
        mass=puck.mass,
        contype=0,
        conaffinity=0,
        rgba=puck.rgba,
    )


def _add_contacts(root: mjcf.RootElement) -> None:
    # Friction of a pair is (tangent 1, tangent 2, torsional, rolling, rolling); tangent 1 of a
    # horizontal contact is world y. The values here are placeholders, which each condition replaces.
    root.contact.add(
        "pair",
        name="puck_board",
        geom1="board",
        geom2="puck",
        condim=4,
        friction=(0.5, 0.5, 0.01, 0.01, 0.01),
        solref=(0.005, 1.0),
    )
    root.contact.add(
        "pair",
        name="puck_blade",
        geom1="blade",
        geom2="puck",
        condim=3,
        friction=(0.3, 0.3, 0.01, 0.01, 0.01),
        solref=(0.01, 0.4),
    )


def _add_pictures(root: mjcf.RootElement, settings: HockeySettings) -> None:
    """Add the ceiling camera, an overview camera, lights, and the visible whiteboard."""
    centre = (settings.start_m[0] + settings.board_m[0] / 2 - 0.4, 0.0)
    root.worldbody.add("camera", name="ceiling", pos=(*centre, 3.7), xyaxes=(0, -1, 0, 1, 0, 0), fovy=50)
    root.worldbody.add(
        "camera",
        name="overview",
        pos=(1.85, -1.75, 1.15),
        xyaxes=(0.83, 0.56, 0, -0.24, 0.36, 0.90),
        fovy=36,
    )
    root.worldbody.add(
        "light",
        pos=(1.0, -1.0, 3.0),
        dir=(-0.1, 0.3, -1),
        castshadow="true",
        diffuse=(0.7, 0.7, 0.7),
    )
    sky = {"rgb1": (1, 1, 1), "rgb2": (0.86, 0.89, 0.93), "width": 64, "height": 64}
    root.asset.add("texture", type="skybox", builtin="gradient", **sky)
    root.worldbody.add(
        "geom",
        name="whiteboard",
        type="box",
        pos=(*centre, -0.011),
        size=(settings.board_m[0] / 2, settings.board_m[1] / 2, 0.01),
        contype=0,
        conaffinity=0,
        mass=0,
        rgba=(0.94, 0.95, 0.97, 1),
    )
