"""A box on a table as MJCF, for recordings whose tracks begin after an unknown striker has hit the box.

World frame: right-handed, z up, the table's surface is z = 0. Lengths in metres, masses in kilograms.

The scene models the slide only: a box, a plane and gravity. There is no striker, so that the attributes of an
arm in `SceneInfo` are empty.
"""

import math

from dm_control import mjcf

from slapshot.arrays import GRAVITY
from slapshot.domains.table.settings import TableScene
from slapshot.scenes.scene import Scene, SceneInfo

CONTROL_PERIOD = 0.001  # s; there are no commands, but simulated tracks are sampled at multiples of it


def build_scene(settings: TableScene) -> Scene:
    """Build the table scene for the block `scene` of a configuration.

    Later stages describe an object by the radius of a disc. The box gets the radius of the disc whose
    footprint has the same polar second moment of area per area, r = sqrt((a^2 + b^2) / 6), so that a solid
    disc of that radius has the box's moment of inertia. Under uniform pressure its frictional torque is the
    same, too, to 1 % for a square and 3 % for edges of 1 : 2. The support differs: MuJoCo supports the box at
    its corners, 1.22 r from the centre, and decelerates a pure rotation more than that of a disc supported at
    its rim; a slide without spin is the same. A disc also has no orientation of edges.

    Args:
        settings: each condition draws its own mass, and the contact plane is infinite.
    """
    size = settings.size_m
    info = SceneInfo(
        joints=(),
        commands=0,
        object_body="box",
        object_joints=("box_x", "box_y", "box_z", "box_yaw"),
        object_radius=disc_radius(size[0], size[1]),
        object_height=size[2],
        object_pair="box_table",
        striker_pair="",
        striker_site="no_striker",
        striker_half_thickness=0.0,
        clearance_geoms=(),
        start=(settings.start_m[0], settings.start_m[1]),
        servo_time=0.0,
        torque_limits=(),
        speed_limits=(),
        control_period=CONTROL_PERIOD,
    )
    return Scene(xml=build_mjcf(settings).to_xml_string(), info=info)


def disc_radius(a: float, b: float) -> float:
    """Radius in m of the disc with the moment of inertia per mass of a rectangle with edges a and b in m.

    The polar second moments of area per area are r^2 / 2 and (a^2 + b^2) / 12.
    """
    return math.sqrt((a**2 + b**2) / 6)


def build_mjcf(settings: TableScene) -> mjcf.RootElement:
    """The whole scene as an editable MJCF tree."""
    root = mjcf.RootElement(model="table")
    root.option.timestep = settings.timestep_s
    root.option.cone = "elliptic"
    root.option.integrator = "implicitfast"
    root.option.gravity = (0.0, 0.0, -GRAVITY)
    no_contact = {"contype": 0, "conaffinity": 0}
    table = (*settings.table_m, 0.1)
    root.worldbody.add("geom", name="table", type="plane", size=table, rgba=(0, 0, 0, 0), **no_contact)
    # The layout of a scene needs a striker's site, so that there is an empty one.
    root.worldbody.add("site", name="no_striker", size=(0.004,), rgba=(0, 0, 0, 0))
    _add_box(root, settings)
    # Friction values are placeholders, which each condition replaces; tangent 1 of the contact is world y.
    root.contact.add(
        "pair",
        name="box_table",
        geom1="table",
        geom2="box",
        condim=4,
        friction=(0.5, 0.5, 0.01, 0.01, 0.01),
        solref=(0.005, 1.0),
    )
    _add_pictures(root, settings)
    return root


def _add_box(root: mjcf.RootElement, settings: TableScene) -> None:
    """Add the box, which moves in x, y, z and yaw: it may hop but cannot tip."""
    (a, b, height), (x, y) = settings.size_m, settings.start_m
    body = root.worldbody.add("body", name="box", pos=(x, y, height / 2))
    for axis, direction in (("x", (1, 0, 0)), ("y", (0, 1, 0)), ("z", (0, 0, 1))):
        body.add("joint", name=f"box_{axis}", type="slide", axis=direction)
    body.add("joint", name="box_yaw", type="hinge", axis=(0, 0, 1))
    body.add(
        "geom",
        name="box",
        type="box",
        size=(a / 2, b / 2, height / 2),
        mass=settings.mass_kg,
        contype=0,
        conaffinity=0,
        rgba=(0.72, 0.53, 0.33, 1.0),
    )


def _add_pictures(root: mjcf.RootElement, settings: TableScene) -> None:
    """Add a camera above, a light, and the visible table."""
    (x, y), (length, width) = settings.start_m, settings.table_m
    root.worldbody.add("camera", name="ceiling", pos=(x, y, 3.0), xyaxes=(0, -1, 0, 1, 0, 0), fovy=50)
    root.worldbody.add("light", pos=(x, y, 3.0), dir=(0, 0, -1), diffuse=(0.7, 0.7, 0.7))
    root.worldbody.add(
        "geom",
        name="tabletop",
        type="box",
        pos=(x, y, -0.011),
        size=(length / 2, width / 2, 0.01),
        contype=0,
        conaffinity=0,
        mass=0,
        rgba=(0.94, 0.95, 0.97, 1),
    )
