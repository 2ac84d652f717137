"""Reference simulation: steps the whole arm and the object from the first command to rest.

The accuracy and the speed of the collector are measured against it.
"""

from collections.abc import Callable
from functools import partial

import mujoco
import numpy as np
from dm_control import mujoco as dm_mujoco

from slapshot.arrays import Array
from slapshot.rollouts.hits import Hits
from slapshot.scenes.scene import Scene, set_condition
from slapshot.trajectories.swings import Swings

LOOP = "dm_control"  # name of the plain loop in tables of measurements
REFERENCE_STEP = 0.00025  # s
AT_REST = 2e-3  # m/s, threshold of speed, and of spin times radius
LONGEST = 10.0  # s


def plain_rests(scene: Scene, swings: Swings, hits: Hits) -> Array:
    """(n, 2) rest points in m, by a straightforward simulation loop; the reference for speed."""
    return dm_control_rests(scene, swings, hits)


def exact_rests(scene: Scene, swings: Swings, hits: Hits) -> Array:
    """(n, 2) rest points in m, the reference for errors."""
    return reference_rests(scene, swings, hits, REFERENCE_STEP)


def reference_rests(scene: Scene, swings: Swings, hits: Hits, timestep: float) -> Array:
    """(n, 2) rest points in m, by mj_step at `timestep` s."""
    rests = np.empty((len(hits.swings), 2))
    for i in range(len(rests)):
        model = scene.compile(timestep)
        set_condition(model, scene.layout, {k: float(v[i]) for k, v in hits.conditions.items()})
        data = mujoco.MjData(model)
        substeps = round(scene.info.control_period / timestep)

        rests[i] = _run(scene, swings, hits, i, data, partial(mujoco.mj_step, model, data, substeps))
    return rests


def dm_control_rests(scene: Scene, swings: Swings, hits: Hits) -> Array:
    """(n, 2) rest points in m, by a plain loop over dm_control's physics.step at the scene's step."""
    rests = np.empty((len(hits.swings), 2))
    physics = dm_mujoco.Physics.from_xml_string(scene.xml)
    substeps = round(scene.info.control_period / physics.timestep())
    for i in range(len(rests)):
        condition = {k: float(v[i]) for k, v in hits.conditions.items()}
        set_condition(physics.model.ptr, scene.layout, condition)
        physics.reset()
        rests[i] = _run(scene, swings, hits, i, physics.data.ptr, partial(physics.step, substeps))
    return rests


def _run(
    scene: Scene,
    swings: Swings,
    hits: Hits,
    i: int,
    data: mujoco.MjData,
    step: Callable[[], None],
) -> Array:
    """Execute one swing and wait for rest; returns the rest point (2,) in m."""
    layout, info = scene.layout, scene.info
    swing = hits.swings[i]
    targets = swings.targets[swing]
    start = np.array(info.start)
    # A swing begins at rest, where the servo targets are equal to the joint positions.
    data.qpos[layout.arm_q] = targets[0]
    data.qpos[layout.object_q[:2]] = hits.start_errors[i]
    for tick in range(round(LONGEST / info.control_period)):
        data.ctrl[: targets.shape[1]] = targets[min(tick, len(targets) - 1)]
        step()
        if tick > len(targets):
            vx, vy, _, spin = data.qvel[layout.object_v]
            if max(abs(vx), abs(vy), abs(spin) * info.object_radius) < AT_REST:
                break
    return data.qpos[layout.object_q[:2]] + start
