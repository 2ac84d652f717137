"""Bodies of a scene: geoms as static shapes, and poses of the moving bodies."""

from collections.abc import Iterator

import mujoco
import numpy as np
import rerun as rr

from slapshot.arrays import Array
from slapshot.scenes.scene import Scene

APPLICATION = "slapshot"
TIME = "sim_time"  # timeline: seconds from the hit's start
SOLID = rr.components.FillMode.Solid
ROOT = "scene"


def log_shapes(recording: rr.RecordingStream, scene: Scene) -> None:
    """Log every visible geom under scene/<body>, in that body's frame, except the object.

    Bodies that are welded together are one. The plane is at z = 0 for people, wherever the scene has it.
    """
    model = scene.compile()
    lowered = rr.Transform3D(translation=[0.0, 0.0, -scene.info.plane_height])
    recording.log(ROOT, lowered, static=True)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    for geom in range(model.ngeom):
        body = model.body_weldid[model.geom_bodyid[geom]]
        if body == scene.layout.object_body or model.geom_rgba[geom, 3] == 0:
            continue
        rotation = data.xmat[body].reshape(3, 3)
        position = rotation.T @ (data.geom_xpos[geom] - data.xpos[body])
        shape = shape_of(model, geom, position, rotation.T @ data.geom_xmat[geom].reshape(3, 3))
        if shape is not None:
            name = model.geom(geom).name or f"geom{geom}"
            recording.log([ROOT, model.body(body).name, name], shape, static=True)


def shape_of(
    model: mujoco.MjModel, geom: int, position: Array, rotation: Array, colour: Array | None = None
) -> rr.AsComponents | None:
    """A geom as Rerun draws it.

    Args:
        model: that has it.
        geom: its index.
        position: (3,) m.
        rotation: (3, 3) rotation matrix.
        colour: (4,) red, green, blue and opacity, 0 to 1; the geom's own without.

    Returns:
        Its shape; None for infinite geoms and non-solids.
    """
    kind, size = mujoco.mjtGeom(model.geom_type[geom]), model.geom_size[geom]
    colours = [model.geom_rgba[geom] if colour is None else colour]
    quaternions = [rotation_quaternion(rotation)]
    match kind:
        case mujoco.mjtGeom.mjGEOM_BOX:
            return rr.Boxes3D(
                half_sizes=[size],
                centers=[position],
                quaternions=quaternions,
                colors=colours,
                fill_mode=SOLID,
            )
        case mujoco.mjtGeom.mjGEOM_CYLINDER:
            return rr.Cylinders3D(
                lengths=[2 * size[1]],
                radii=[size[0]],
                centers=[position],
                quaternions=quaternions,
                colors=colours,
                fill_mode=SOLID,
            )
        case mujoco.mjtGeom.mjGEOM_CAPSULE:
            # Rerun's capsule begins at its origin, MuJoCo's has it in the middle.
            return rr.Capsules3D(
                lengths=[2 * size[1]],
                radii=[size[0]],
                translations=[position - size[1] * rotation[:, 2]],
                quaternions=quaternions,
                colors=colours,
                fill_mode=SOLID,
            )
        case mujoco.mjtGeom.mjGEOM_SPHERE | mujoco.mjtGeom.mjGEOM_ELLIPSOID:
            half = size if kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID else np.repeat(size[0], 3)
            return rr.Ellipsoids3D(
                half_sizes=[half],
                centers=[position],
                quaternions=quaternions,
                colors=colours,
                fill_mode=SOLID,
            )
        case mujoco.mjtGeom.mjGEOM_MESH:
            mesh = model.mesh(model.geom_dataid[geom])
            vertices = slice(mesh.vertadr[0], mesh.vertadr[0] + mesh.vertnum[0])
            faces = slice(mesh.faceadr[0], mesh.faceadr[0] + mesh.facenum[0])
            return rr.Mesh3D(
                vertex_positions=position + model.mesh_vert[vertices] @ rotation.T,
                triangle_indices=model.mesh_face[faces],
                albedo_factor=colours[0],
            )
    return None


def extent(scene: Scene) -> tuple[Array, Array]:
    """Bounding box (two corners (3,), m) of visible geoms fixed to the world: the board, a base."""
    model = scene.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    seen = (model.geom_rgba[:, 3] > 0) & (model.geom_type != mujoco.mjtGeom.mjGEOM_PLANE)
    fixed = np.flatnonzero(seen & (model.body_weldid[model.geom_bodyid] == 0))
    start = np.array([*scene.info.start, 0.0])  # included, so that an empty world has an extent
    rotations = data.geom_xmat[fixed].reshape(-1, 3, 3)
    middle = data.geom_xpos[fixed] + np.einsum("nij,nj->ni", rotations, model.geom_aabb[fixed, :3])
    half = np.einsum("nij,nj->ni", np.abs(rotations), model.geom_aabb[fixed, 3:])
    return np.vstack([middle - half, start]).min(0), np.vstack([middle + half, start]).max(0)


class Arm:
    """Forward kinematics of a scene's moving bodies, the object left out."""

    def __init__(self, scene: Scene) -> None:
        self._model = scene.compile()
        self._data = mujoco.MjData(self._model)
        self._joints = scene.layout.arm_q
        still = (0, scene.layout.object_body)
        self._bodies = [b for b in np.unique(self._model.body_weldid) if b not in still]

    def poses(self, joints: Array) -> Iterator[tuple[str, Array, Array]]:
        """Poses of the bodies at joint positions (k, joints) in rad.

        Yields:
            Name of a body, its positions (k, 3) in m and its quaternions (k, 4), x y z w.
        """
        positions = np.empty((len(joints), len(self._bodies), 3))
        rotations = np.empty((len(joints), len(self._bodies), 4))
        for k, position in enumerate(joints):
            self._data.qpos[self._joints] = position
            mujoco.mj_kinematics(self._model, self._data)
            positions[k], rotations[k] = self._data.xpos[self._bodies], self._data.xquat[self._bodies]
        for i, body in enumerate(self._bodies):
            yield self._model.body(body).name, positions[:, i], np.roll(rotations[:, i], -1, axis=1)


def rotation_quaternion(rotation: Array) -> Array:
    """(4,) x y z w of a rotation matrix (3, 3)."""
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(rotation).ravel())
    return np.roll(quaternion, -1)
