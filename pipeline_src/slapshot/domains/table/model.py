"""A box on a table as MJCF: what a recording needs whose tracks begin when something unknown has hit the box.

World frame: right-handed, z up, the table's surface is z = 0. Lengths in metres, masses in kilograms.

Only the slide is in this scene, so that of the box its size counts and of the rest the plane and gravity.
Who hit it is not modelled: what `SceneInfo` says of an arm is empty.
"""

import math

from dm_control import mjcf

from slapshot.arrays import GRAVITY
from slapshot.domains.table.settings import TableScene
from slapshot.scenes.scene import Scene, SceneInfo

CONTROL_PERIOD = 0.001  # s; nothing is commanded, but simulated tracks are sampled in whole periods


def build_scene(settings: TableScene) -> Scene:
    """The table scene for the `scene` block of a configuration.

    Later stages know an object by the radius of a disc. The box gets that of the disc whose footprint has
    the same polar second moment of area per area, r = sqrt((a^2 + b^2) / 6): a solid disc of that radius
    turns as easily as the box. Under even pressure its friction also holds a turn as well, to 1 % for a
    square and 3 % for edges of 1 : 2. How friction is spread is another matter: MuJoCo carries the box on
    its corners, 1.22 r from the middle, and brakes a mere turn harder than a disc on its rim would be; a
    slide without spin is the same. Nor can a disc say which way the edges lie.

    Args:
        settings: a condition draws a mass of its own, and the contact plane has no
            edge.
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
    """Radius in m of the disc that turns as easily as a rectangle with edges a and b in m.

    The polar second moments of area per area are r^2 / 2 and (a^2 + b^2) / 12.
    """
    return math.sqrt((a**2 + b**2) / 6)


def build_mjcf(settings: TableScene) -> mjcf.RootElement:
    """The whole scene as an MJCF tree that can still be changed."""
    root = mjcf.RootElement(model="table")
    root.option.timestep = settings.timestep_s
    root.option.cone = "elliptic"
    root.option.integrator = "implicitfast"
    root.option.gravity = (0.0, 0.0, -GRAVITY)
    no_contact = {"contype": 0, "conaffinity": 0}
    table = (*settings.table_m, 0.1)
    root.worldbody.add("geom", name="table", type="plane", size=table, rgba=(0, 0, 0, 0), **no_contact)
    # A scene's layout looks a striker's site up by its name, so there is one, with nothing to it.
    root.worldbody.add("site", name="no_striker", size=(0.004,), rgba=(0, 0, 0, 0))
    _add_box(root, settings)
    # Values of friction are placeholders of a condition's own; tangent 1 of the contact is world y.
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
    """The box moves in x, y, z and yaw: it may hop, it does not tip."""
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
    """A camera above, a light, and the table that one sees."""
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
