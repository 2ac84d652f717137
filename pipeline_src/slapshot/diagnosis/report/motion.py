"""How a rig moves in held-out windows: as recorded, and as models predict it."""

from dataclasses import dataclass, replace

import mujoco
import numpy as np
from numpy.typing import NDArray

from slapshot.diagnosis.filter import smooth
from slapshot.diagnosis.fit import Fitter
from slapshot.diagnosis.held_out import first_path
from slapshot.diagnosis.report.outcome import Outcome
from slapshot.diagnosis.rig import Rig
from slapshot.diagnosis.segments import Segments

Array = NDArray[np.float64]

_ROUNDS = 5


@dataclass(frozen=True)
class Motion:
    """Positions in W windows of n nodes, of which the second half is predicted.

    Attributes:
        rig: whose model has the positions.
        qpos: (W, n, nq).
        seen: (W, n, ny) what the model reads there.
    """

    rig: Rig
    qpos: Array
    seen: Array


def predicted_motion(outcome: Outcome, arm: str, windows: Segments) -> Motion:
    """The motion that a model estimates in the first half of each window and predicts in the second."""
    step, prediction = outcome.step(arm), outcome.arms[arm]
    problem, half = step.problem, windows.shape[1] // 2
    masked = windows.y.copy()
    masked[:, half:] = np.nan
    fitter = Fitter(problem.fitter.simulator, replace(windows, y=masked), problem.torque)
    noise = replace(step.examination.noise, weight=np.ones_like(masked))
    covariances = noise.covariances(windows.interval)
    path = first_path(problem, outcome.search.nominal.problem, windows)
    hypothesis, theta = prediction.hypothesis, prediction.theta
    for _ in range(_ROUNDS):
        system = fitter.linearise(hypothesis, theta, path).system.without_columns()
        delta, _ = smooth(system, covariances)
        path = fitter.simulator.tangent.add(path, delta)
    seen = fitter.linearise(hypothesis, theta, path).predicted
    return Motion(problem.rig, path[..., : problem.rig.model.nq], seen)


def recorded_motion(of: Motion, recorded: Array) -> Motion:
    """The motion as recorded: what is observed where it was recorded, all else as a model has it.

    A joint is moved by how far the recorded reading lies from that of the model, so that a model whose joints
    are split, or whose readings are off, has its links where they were.

    Args:
        of: motion of the model.
        recorded: (W, n, ny); NaN where nothing was.
    """
    qpos, model = of.qpos.copy(), of.rig.model
    off = np.apply_along_axis(_bridged, 1, recorded - of.seen)
    turns: dict[int, dict[int, int]] = {}  # first index of a quaternion -> its component -> column
    for column, observation in enumerate(of.rig.observations):
        if observation.quantity != "position":
            continue
        if observation.dof is not None:
            qpos[..., model.jnt_qposadr[model.dof_jntid[observation.dof]]] += off[..., column]
            continue
        target = _jointed(model, observation.address)
        if target is None:
            continue
        first, component, is_turn = target
        if is_turn:
            turns.setdefault(first, {})[component] = column
        else:
            qpos[..., first + component] += off[..., column]
    for first, columns in turns.items():
        if len(columns) == 4:
            read = [columns[k] for k in range(4)]
            # A quaternion and its negative are one rotation.
            side = np.sign(np.sum(np.nan_to_num(recorded[..., read]) * of.seen[..., read], -1, keepdims=True))
            away = np.apply_along_axis(_bridged, 1, side * recorded[..., read] - of.seen[..., read])
            turned = qpos[..., first : first + 4] + away
            qpos[..., first : first + 4] = turned / np.linalg.norm(turned, axis=-1, keepdims=True)
    return Motion(of.rig, qpos, recorded)


def _jointed(model: mujoco.MjModel, address: int) -> tuple[int, int, bool] | None:
    """Index in qpos of the place or quaternion that a sensor reads, component, and whether it turns."""
    sensor = int(np.flatnonzero(model.sensor_adr <= address)[-1])
    kind, target = int(model.sensor_type[sensor]), int(model.sensor_objid[sensor])
    component = address - int(model.sensor_adr[sensor])
    sensors, joints = mujoco.mjtSensor, mujoco.mjtJoint
    if kind == sensors.mjSENS_BALLQUAT:
        return int(model.jnt_qposadr[target]), component, True
    bodies = (int(mujoco.mjtObj.mjOBJ_XBODY), int(mujoco.mjtObj.mjOBJ_BODY))
    if int(model.sensor_objtype[sensor]) not in bodies or model.body_jntnum[target] == 0:
        return None
    joint = int(model.body_jntadr[target])
    if model.jnt_type[joint] != joints.mjJNT_FREE:
        return None
    if kind == sensors.mjSENS_FRAMEPOS:
        return int(model.jnt_qposadr[joint]), component, False
    if kind == sensors.mjSENS_FRAMEQUAT:
        return int(model.jnt_qposadr[joint]) + 3, component, True
    return None


def _bridged(values: Array) -> Array:
    """Values with gaps bridged by straight lines; 0 without any."""
    there = np.isfinite(values)
    if not there.any():
        return np.zeros_like(values)
    places = np.arange(len(values))
    return np.interp(places, places[there], values[there])
