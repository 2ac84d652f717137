"""A flexible striker: the scene's rigid blade divided into segments joined by springs.

The blade is a box that hangs from a stick. Its thinnest direction faces the object, its longest lies across
the direction of the hit, and along the third, its height, it is divided into N segments. The first is fixed
to the stick. Each further one hangs on the segment above by a hinge along the blade's length, so that the
free end bends backwards on impact, and optionally by a hinge along its height, so that an off-centre hit
twists it. N - 1 equal springs of stiffness (N - 1) k in series have a stiffness of k together.

The segment at the free end is the largest. It must face the whole height of the object: where the vertical
overlap of a segment and the object is less than the contact's penetration (3 mm), MuJoCo takes the overlap
for the penetration depth and pushes the object down instead of forward.
"""

import math
from collections.abc import Callable, Sequence

import mujoco
import numpy as np
from scipy.linalg import eigh

from slapshot.errors import InputError
from slapshot.lab.blade_truth import BladeTruth
from slapshot.scenes.scene import Scene

Edit = Callable[[mujoco.MjSpec, Scene], None]

FEWEST_SEGMENTS = 2
FREE_END = 0.6  # share of the height that the last segment takes; the others are equal
RESOLVED = 0.5  # rad: largest phase of a vibration per time step; smaller steps move rest points by 1 %
FINEST = 1e-5  # s; a blade that needs a shorter time step is refused
_PAIR_FIELDS = ("condim", "friction", "solref", "solreffriction", "solimp", "margin", "gap")


def compile_rig(
    scene: Scene, blade: BladeTruth | None, timestep: float, edits: Sequence[Edit] = ()
) -> mujoco.MjModel:
    """Compile the scene's model with a flexible blade and with edits, where they are given.

    Existing names are kept, and hinges `<geom>_bend_1` ... and `<geom>_twist_1` ... are added; addresses
    change.

    Args:
        scene: has one contact pair of object and striker; the striker's geom is a box.
        blade: its flexibility.
        timestep: s, upper bound of the integration step: with a flexible blade it is divided until it
            resolves the blade's fastest vibration.
        edits: further changes of the scene, applied after the blade is divided; the springs that they add
            are damped so strongly that any step is stable.

    Raises:
        InputError: the striker is not a box, there are too few segments, or they are too stiff.
    """
    if blade is None and not edits:
        return scene.compile(timestep)
    spec = mujoco.MjSpec.from_string(scene.xml)
    if blade is not None:
        _make_flexible(spec, scene, blade)
        fastest = _fastest(spec.compile())
        timestep /= math.ceil(timestep * fastest / RESOLVED)
    if timestep < FINEST:
        raise InputError(
            f"lab.blade: a step of {timestep:.1g} s would be needed; use fewer segments or "
            "less stiffness, or null for a rigid blade"
        )
    for edit in edits:
        edit(spec, scene)
    model = spec.compile()
    model.opt.timestep = timestep
    return model


def striker_pairs(model: mujoco.MjModel, scene: Scene) -> list[int]:
    """Ids of the contact pairs of the object with the striker or with its segments."""
    board = model.pair(scene.info.object_pair).id
    return [i for i in range(model.npair) if i != board]


def _make_flexible(spec: mujoco.MjSpec, scene: Scene, blade: BladeTruth) -> None:
    """Divide the striker into segments, each with the contact parameters of the striker."""
    pair = _named(spec.pairs, scene.info.striker_pair)
    first, second = spec.geom(pair.geomname1), spec.geom(pair.geomname2)
    geom = second if first.parent.name == scene.info.object_body else first
    _check(geom, blade)
    segments = _cut(geom, blade)
    for segment in segments:
        copy = spec.add_pair(name=f"{pair.name}_{segment}")
        for field in _PAIR_FIELDS:
            setattr(copy, field, getattr(pair, field))
        # The order of the two geoms determines the direction of the contact frame.
        copy.geomname1 = segment if geom is first else pair.geomname1
        copy.geomname2 = segment if geom is second else pair.geomname2


def _fastest(model: mujoco.MjModel) -> float:
    """Highest natural frequency in rad/s of the joints with springs, with all other joints fixed."""
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    inertia = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, inertia)
    stiffness = model.jnt_stiffness[model.dof_jntid]
    sprung = np.flatnonzero(stiffness)
    squares = eigh(np.diag(stiffness[sprung]), inertia[np.ix_(sprung, sprung)], eigvals_only=True)
    return float(np.sqrt(squares[-1]))


def _cut(geom: mujoco.MjsGeom, blade: BladeTruth) -> list[str]:
    """Shorten the geom to the first segment and attach the others; return the names of their geoms."""
    body = geom.parent
    size, mass, centre = np.array(geom.size), geom.mass, np.array(geom.pos)
    thin, up, across = np.argsort(size)
    # The free end is the one that points away from where the striker's body is attached.
    down = np.zeros(3)
    down[up] = -1.0 if body.pos[up] < 0 else 1.0
    height = 2 * size[up]
    shares = [(1 - FREE_END) / (blade.segments - 1)] * (blade.segments - 1) + [FREE_END]
    bend_inertia = mass * (height**2 + size[thin] ** 2) / 3  # about the upper edge
    twist_inertia = mass * (size[across] ** 2 + size[thin] ** 2) / 3  # about the middle

    edge = centre - down * height / 2  # upper edge of a segment, in its body's frame
    names = []
    for i, share in enumerate(shares):
        if i > 0:
            name = f"{geom.name}_{i}"
            names.append(name)
            body = body.add_body(name=name, pos=edge, gravcomp=geom.parent.gravcomp)
            _add_hinge(body, f"{geom.name}_bend_{i}", across, blade.stiffness, bend_inertia, blade)
            if blade.twist_stiffness is not None:
                hinge = f"{geom.name}_twist_{i}"
                _add_hinge(body, hinge, up, blade.twist_stiffness, twist_inertia, blade)
            part = body.add_geom(
                name=name,
                type=mujoco.mjtGeom.mjGEOM_BOX,
                contype=0,
                conaffinity=0,
                rgba=geom.rgba,
            )
            edge = np.zeros(3)
        else:
            part = geom
        part.size = size
        part.size[up] = share * height / 2
        part.pos = edge + down * share * height / 2
        part.mass = share * mass
        edge = edge + down * share * height
    return names


def _add_hinge(
    body: mujoco.MjsBody, name: str, axis: int, stiffness: float, inertia: float, blade: BladeTruth
) -> None:
    """Add a hinge with spring and damper; `stiffness` and `inertia` are those of the whole blade."""
    hinges = blade.segments - 1
    body.add_joint(
        name=name,
        type=mujoco.mjtJoint.mjJNT_HINGE,
        axis=np.eye(3)[axis],
        stiffness=hinges * stiffness,
        damping=hinges * 2 * blade.damping_ratio * math.sqrt(stiffness * inertia),
        limited=mujoco.mjtLimited.mjLIMITED_FALSE,
        armature=0.0,
    )


def _check(geom: mujoco.MjsGeom, blade: BladeTruth) -> None:
    if geom.type != mujoco.mjtGeom.mjGEOM_BOX or not np.allclose(np.abs(geom.quat), (1, 0, 0, 0)):
        raise InputError(
            f"lab.blade: geom {geom.name!r} of the scene is not a box along the axes of its body; "
            "only such a striker can be cut: set lab.blade to null"
        )
    if blade.segments < FEWEST_SEGMENTS:
        raise InputError(f"lab.blade.segments: {blade.segments} cannot bend; use at least {FEWEST_SEGMENTS}")


def _named(elements: list[mujoco.MjsPair], name: str) -> mujoco.MjsPair:
    return next(element for element in elements if element.name == name)
