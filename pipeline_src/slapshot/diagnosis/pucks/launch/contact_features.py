"""Where and how the striker's face meets the object in the nominal scene."""

import mujoco
import numpy as np

from slapshot.arrays import Array
from slapshot.scenes.scene import Scene


def approach_of(scene: Scene, joints: Array, speeds: Array, starts: Array) -> Array:
    """(n, 2): see `NominalLaunches.approach`.

    Args:
        scene: nominal.
        joints: (n, j) rad, of the arm at the contact.
        speeds: (n, j) rad/s.
        starts: (n, 2) m, where objects lie.
    """
    model, info = scene.compile(), scene.info
    data = mujoco.MjData(model)
    angles = [model.joint(name).qposadr[0] for name in info.joints]
    rates = [model.joint(name).dofadr[0] for name in info.joints]
    site = model.site(info.striker_site).id
    found, jacobian, turning = np.empty((len(joints), 2)), np.empty((3, model.nv)), np.empty((3, model.nv))
    for i, (q, dq, start) in enumerate(zip(joints, speeds, starts, strict=True)):
        data.qpos[angles] = q
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_jacSite(model, data, jacobian, turning, site)
        normal = data.site_xmat[site].reshape(3, 3)[:2, 0]
        normal = normal / max(float(np.linalg.norm(normal)), 1e-9)
        along = np.array([-normal[1], normal[0]])
        offset = float(along @ (start - data.site_xpos[site][:2]))
        velocity = jacobian[:2, rates] @ dq + (turning[2, rates] @ dq) * offset * -normal
        found[i] = offset, np.arctan2(along @ velocity, normal @ velocity)
    return found
