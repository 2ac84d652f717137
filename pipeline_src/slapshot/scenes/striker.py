"""The striker in an editable model of a scene: its contact pair, its shape and its orientation."""

from dataclasses import dataclass

import mujoco
import numpy as np

from slapshot.arrays import Array
from slapshot.errors import InputError
from slapshot.scenes.scene import SceneInfo

_LEAST_HANG = 0.1  # smallest share of the vector to the link that must be perpendicular to the face's normal


@dataclass(frozen=True, eq=False)
class Striker:
    """The striker's geom, in the frame of the body that it belongs to.

    Attributes:
        geom: in the spec.
        pos: (3,) m, its centre.
        quat: (4,) its orientation.
        size: (3,) m, in MuJoCo's convention for its type.
        height: m, half of its extent along `up`.
        site: (3,) m, the striker's site.
        normal: (3,) unit normal of the striking face.
        up: (3,) unit vector along that face, towards the moving link that carries the striker.
    """

    geom: mujoco.MjsGeom
    pos: Array
    quat: Array
    size: Array
    height: float
    site: Array
    normal: Array
    up: Array

    @classmethod
    def of(cls, spec: mujoco.MjSpec, info: SceneInfo) -> "Striker":
        """Find the striker in the model, with all joints at 0.

        Raises:
            InputError: there is no striker, or its face's normal points along its link, so that it has no
                upper edge.
        """
        model = spec.compile()
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        geom = striker_geom(spec, info)
        index = model.geom(geom.name).id
        body = model.geom_bodyid[index]
        site = model.site(info.striker_site).id
        to_body = data.xmat[body].reshape(3, 3).T
        normal = to_body @ data.site_xmat[site].reshape(3, 3)[:, 0]
        hang = to_body @ (data.xpos[model.body_weldid[body]] - data.geom_xpos[index])
        across = hang - (hang @ normal) * normal
        if np.linalg.norm(across) <= _LEAST_HANG * np.linalg.norm(hang):
            raise InputError(
                f"scene: striker {geom.name!r} points straight ahead from the link that carries it; which of "
                "its edges is the upper one cannot be told"
            )
        up = across / np.linalg.norm(across)
        frame = to_body @ data.geom_xmat[index].reshape(3, 3)
        return cls(
            geom=geom,
            pos=model.geom_pos[index].copy(),
            quat=model.geom_quat[index].copy(),
            size=model.geom_size[index].copy(),
            height=float(np.abs(frame.T @ up) @ model.geom_aabb[index, 3:]),
            site=to_body @ (data.site_xpos[site] - data.xpos[body]),
            normal=normal,
            up=up,
        )


def striker_pair(spec: mujoco.MjSpec, info: SceneInfo) -> mujoco.MjsPair:
    """The contact pair of striker and object.

    Raises:
        InputError: nothing strikes the object of this scene.
    """
    for pair in spec.pairs:
        if pair.name == info.striker_pair:
            return pair
    raise InputError(f"scene: no contact pair {info.striker_pair!r} of a striker and {info.object_body!r}")


def striker_geom(spec: mujoco.MjSpec, info: SceneInfo) -> mujoco.MjsGeom:
    """The geom of that pair that does not belong to the object."""
    pair = striker_pair(spec, info)
    first, second = spec.geom(pair.geomname1), spec.geom(pair.geomname2)
    return second if first.parent.name == info.object_body else first
