"""Reference simulation: FetchSlide's own step loop, patched where it fails with recent versions of MuJoCo."""

from types import ModuleType
from typing import Any

import mujoco
import numpy as np

from slapshot.arrays import Array
from slapshot.domains.fetchslide.model import OBJECT, OBJECT_JOINT, TABLE
from slapshot.rollouts.hits import Hits
from slapshot.scenes.scene import Scene
from slapshot.trajectories.swings import Swings

LOOP = "environment"  # name of this loop in tables of measurements
AT_REST = 2e-3  # m/s and rad/s
LONGEST = 250  # steps after the last command


def plain_rests(scene: Scene, swings: Swings, hits: Hits) -> Array:
    """(n, 2) rest points in m; the environment uses its own scene, from which `scene` was built."""
    return environment_rests(swings, hits)


exact_rests = plain_rests  # the environment itself is the reference for errors


def environment_rests(swings: Swings, hits: Hits, seed: int = 0) -> Array:
    """(n, 2) rest points in m of the environment's puck; after a swing's commands, zeros are sent."""
    environment = make_environment()
    model, data = environment.model, environment.data
    puck, moving = model.joint(OBJECT_JOINT).qposadr[0], model.joint(OBJECT_JOINT).dofadr[0]
    rests = np.empty((len(hits.swings), 2))
    for i, swing in enumerate(hits.swings):
        environment.reset(seed=seed)
        for name in (OBJECT, TABLE):
            model.geom(name).friction[:] = [
                hits.conditions[f"friction_{k}"][i] for k in ("x", "torsional", "rolling")
            ]
        data.qpos[puck : puck + 2] = swings.starts[swing] + hits.start_errors[i]
        mujoco.mj_forward(model, data)
        for command in swings.targets[swing]:
            environment.step(np.append(command, 0.0))
        for _ in range(LONGEST):
            if np.abs(data.qvel[moving : moving + 6]).max() < AT_REST:
                break
            environment.step(np.zeros(4))
        rests[i] = data.qpos[puck : puck + 2]
    return rests


def make_environment() -> Any:
    """A MujocoFetchSlideEnv whose four joint helpers work on MuJoCo 3.12 and later."""
    from gymnasium_robotics.envs.fetch.slide import MujocoFetchSlideEnv
    from gymnasium_robotics.utils import mujoco_utils

    _mend(mujoco_utils)
    return MujocoFetchSlideEnv()


def _mend(helpers: ModuleType) -> None:
    """Patch helpers that compare MuJoCo's enumeration with an array, which recent versions reject."""

    def places(model: mujoco.MjModel, name: str, velocity: bool) -> slice:
        joint = model.joint(name)
        free = joint.type[0] == int(mujoco.mjtJoint.mjJNT_FREE)
        begin = (joint.dofadr if velocity else joint.qposadr)[0]
        return slice(begin, begin + ((6 if velocity else 7) if free else 1))

    def set_qpos(model, data, name, value):  # type: ignore[no-untyped-def]
        data.qpos[places(model, name, False)] = value

    def set_qvel(model, data, name, value):  # type: ignore[no-untyped-def]
        data.qvel[places(model, name, True)] = value

    def get_qpos(model, data, name):  # type: ignore[no-untyped-def]
        return data.qpos[places(model, name, False)].copy()

    def get_qvel(model, data, name):  # type: ignore[no-untyped-def]
        return data.qvel[places(model, name, True)].copy()

    mended = {
        "set_joint_qpos": set_qpos,
        "set_joint_qvel": set_qvel,
        "get_joint_qpos": get_qpos,
        "get_joint_qvel": get_qvel,
    }
    for name, helper in mended.items():
        setattr(helpers, name, helper)
