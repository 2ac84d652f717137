"""Motion of a rig in held-out windows: recorded, and predicted by models."""

from dataclasses import dataclass, replace

import mujoco
import numpy as np
from numpy.typing import NDArray

from slapshot.arrays import Array
from slapshot.diagnosis.fit.filter import smooth
from slapshot.diagnosis.fit.fit import Fitter
from slapshot.diagnosis.held_out import initial_trajectory
from slapshot.diagnosis.model.rig import Rig
from slapshot.diagnosis.model.segments import Segments
from slapshot.diagnosis.report.outcome import Outcome

_ROUNDS = 5
_SHARE, _NO_FORCE = 0.01, 1e-6  # of the noise of readings; of the torque that moves each joint


@dataclass(frozen=True)
class Motion:
    """Positions in W windows of n nodes.

    Attributes:
        rig: whose model has the positions.
        qpos: (W, n, nq).
        seen: (W, n, ny) readings there: of the model, or recorded.
    """

    rig: Rig
    qpos: Array
    seen: Array


def predicted_half(windows: Segments) -> Segments:
    """The second halves of windows, which were predicted."""
    return windows.later(windows.shape[1] // 2)


def predicted_motion(outcome: Outcome, model_name: str, some: NDArray[np.intp]) -> Motion:
    """The motion whose readings a model predicted.

    Args:
        outcome: of the diagnosis.
        model_name: model.
        some: indices of the windows.
    """
    step, prediction = outcome.step(model_name), outcome.by_model[model_name]
    problem = step.problem
    halves = predicted_half(outcome.windows.select(some))
    halves = problem.in_steps(replace(halves, y=prediction.predictions.predicted[some]))
    fitter = Fitter(problem.fitter.simulator, halves, problem.torque)
    noise = step.scored.noise.elsewhere(np.zeros_like(halves.y), halves.order, None)
    # Predicted readings have negligible noise, and no process force acts.
    noise = replace(
        noise, white=_SHARE * noise.white, coloured=0 * noise.coloured, force=_NO_FORCE, jitter_s=0.0
    )
    covariances = noise.covariances(halves.interval)
    trajectory = initial_trajectory(problem, outcome.search.nominal.problem, halves)
    hypothesis, theta = prediction.hypothesis, prediction.theta
    for _ in range(_ROUNDS):
        system = fitter.linearise(hypothesis, theta, trajectory).system.without_columns()
        delta, *_ = smooth(system, covariances)
        trajectory = fitter.simulator.tangent.add(trajectory, delta)
    seen = fitter.linearise(hypothesis, theta, trajectory).predicted
    return Motion(problem.rig, trajectory[..., : problem.rig.model.nq], seen)


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
