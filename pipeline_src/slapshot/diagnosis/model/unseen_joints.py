"""Positions of joints without encoder, from places, their own velocity, or the loops that they close."""

from collections.abc import Iterable
from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.optimize import minimize_scalar

from slapshot.arrays import Array
from slapshot.diagnosis.model.hypothesis import Simulator, actuator_torque
from slapshot.diagnosis.model.rig import Rig
from slapshot.diagnosis.model.segments import Segments
from slapshot.diagnosis.model.smoothed_readings import assign, smoothed
from slapshot.diagnosis.model.tangent import Tangent, angular_velocity

_DAMPING, _ROUNDS, _STEP, _LONGEST, _STARTS = 1e-3, 30, 1e-5, 0.5, 3  # of inverse kinematics; in rad or m
_SAME = 1e-9  # m, and of axes
_PLACES = (
    mujoco.mjtSensor.mjSENS_FRAMEPOS,
    mujoco.mjtSensor.mjSENS_ACTUATORPOS,
    mujoco.mjtSensor.mjSENS_TENDONPOS,
)
# First angles that are tried, at how many nodes, and the share of the usual error that one must be below.
_ANGLES, _NODES, _CLEARLY = 24, 60, 0.9


@dataclass(frozen=True)
class Point:
    """What a sensor of a site or body observes.

    Attributes:
        body: that it moves with, and that is fixed to no other.
        is_origin: whether its place is that of the body's frame.
        is_aligned: whether its axes are those of the body's frame.
    """

    body: int
    is_origin: bool
    is_aligned: bool


def observed_point(model: mujoco.MjModel, sensor: int) -> Point | None:
    """The point that a sensor observes; None for sensors of anything but sites and bodies."""
    kind, target = int(model.sensor_objtype[sensor]), int(model.sensor_objid[sensor])
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    match mujoco.mjtObj(kind):
        case mujoco.mjtObj.mjOBJ_XBODY:
            of, place, axes = target, data.xpos[target], data.xmat[target]
        case mujoco.mjtObj.mjOBJ_BODY:  # its centre of mass, and the axes of its inertia
            of, place, axes = target, data.xipos[target], data.ximat[target]
        case mujoco.mjtObj.mjOBJ_SITE:
            of, place, axes = int(model.site_bodyid[target]), data.site_xpos[target], data.site_xmat[target]
        case _:
            return None
    body = int(model.body_weldid[of])
    return Point(
        body,
        bool(np.abs(place - data.xpos[body]).max() < _SAME),
        bool(np.abs(axes - data.xmat[body]).max() < _SAME),
    )


def unseen_joints(rig: Rig, seen: set[int], places: list[int]) -> list[int]:
    """Degrees of freedom whose position is not observed.

    Those of hinges and slides all; of ball joints and free bodies those that move an observed place. A body
    of which one point is seen keeps its rotation.

    Args:
        rig: that is recorded.
        seen: degrees of freedom that are observed themselves.
        places: columns of observations that are no degree of freedom.
    """
    model, found = rig.model, list[int]()
    for j, kind in enumerate(model.jnt_type.tolist()):
        first = int(model.jnt_dofadr[j])
        match mujoco.mjtJoint(kind):
            case mujoco.mjtJoint.mjJNT_FREE if _moves(rig, j, places):
                several = len(_points(rig, j, range(len(rig.observations)))) > 1
                found += range(first, first + (6 if several else 3))
            case mujoco.mjtJoint.mjJNT_BALL if _moves(rig, j, places):
                found += range(first, first + 3)
            case mujoco.mjtJoint.mjJNT_HINGE | mujoco.mjtJoint.mjJNT_SLIDE:
                found.append(first)
    return [v for v in found if v not in seen]


def _moves(rig: Rig, joint: int, places: list[int]) -> bool:
    return bool(_points(rig, joint, places))


def _points(rig: Rig, joint: int, columns: Iterable[int]) -> set[tuple[int, int]]:
    """Kind and number of the sites and bodies whose places are observed and that a joint moves."""
    model, found = rig.model, set[tuple[int, int]]()
    for column in columns:
        sensor = rig.sensor_of(column)
        point = observed_point(model, sensor)
        if point is None or model.sensor_type[sensor] != int(mujoco.mjtSensor.mjSENS_FRAMEPOS):
            continue
        body = point.body
        while body and body != model.jnt_bodyid[joint]:
            body = int(model.body_parentid[body])
        if body:
            found.add((int(model.sensor_objtype[sensor]), int(model.sensor_objid[sensor])))
    return found


def integrate_velocity(rig: Rig, segments: Segments, x: Array, v: int) -> bool:
    """Let a joint follow the integral of its recorded velocity, from its initial position, if it has one."""
    own = [c for c, o in enumerate(rig.observations) if o.dof == v and o.quantity == "velocity"]
    if not own:
        return False
    nq, q = rig.model.nq, int(rig.model.jnt_qposadr[rig.model.dof_jntid[v]])
    for run in segments.runs():
        speed = smoothed(segments, run, own[:1])[0][:, 0:1].ravel()
        if len(speed):
            steps = segments.interval * (speed[1:] + speed[:-1]) / 2
            way = x[run[0], 0, q] + np.concatenate([[0.0], np.cumsum(steps)])
            x[run, :, q] = way[-1]
            assign(x, run, segments.inside[run], q, way)
            assign(x, run, segments.inside[run], nq + v, speed)
    return True


def find_first_angles(rig: Rig, segments: Segments, x: Array, v: int) -> None:
    """Turn a joint of which the velocity is known, episode by episode, so that its loads explain the motion.

    Of all angles at which it may have begun, that of least forces that no actuator, damping or weight makes.
    Where none is better, as of a wheel, it stays.
    """
    model, data = rig.model, mujoco.MjData(rig.model)
    nq, nv, q = model.nq, model.nv, int(model.jnt_qposadr[model.dof_jntid[v]])
    control, full = segments.control(), np.zeros((nv, nv))
    rates = segments.rate(x[..., nq : nq + nv])
    for run in segments.runs():
        nodes = np.argwhere(segments.inside[run])[1:-1]
        if not len(nodes):
            continue
        nodes = nodes[np.unique(np.linspace(0, len(nodes) - 1, _NODES).astype(int))]
        states = x[run][nodes[:, 0], nodes[:, 1]]
        rate = rates[run][nodes[:, 0], nodes[:, 1]]
        u = control[run][nodes[:, 0], nodes[:, 1], 0]

        def unexplained(angle: float, states: Array = states, rate: Array = rate, u: Array = u) -> float:
            turned = states.copy()
            turned[:, q] += angle
            driven, total = actuator_torque(model, turned, u, rig.load), 0.0
            for state, change, torque in zip(turned, rate, driven, strict=True):
                data.qpos[:], data.qvel[:] = state[:nq], state[nq : nq + nv]
                mujoco.mj_fwdPosition(model, data)
                mujoco.mj_fwdVelocity(model, data)
                mujoco.mj_fullM(model, data, full)
                left = full @ change + data.qfrc_bias - data.qfrc_passive - torque
                total += float(left[v] ** 2)
            return total

        angles = np.linspace(-np.pi, np.pi, _ANGLES, endpoint=False)
        errors = np.array([unexplained(angle) for angle in angles])
        if errors.min() > _CLEARLY * np.median(errors):
            continue
        width = 2 * np.pi / _ANGLES
        best = angles[int(np.argmin(errors))]
        found = minimize_scalar(unexplained, bounds=(best - width, best + width), method="bounded")
        x[run, :, q] += found.x


def is_place(rig: Rig, column: int) -> bool:
    """Whether an observation is a coordinate of a site or body, or the position behind a gear or tendon."""
    kind = mujoco.mjtSensor(rig.model.sensor_type[rig.sensor_of(column)])
    return rig.observations[column].quantity == "position" and kind in _PLACES


class Loops:
    """Equality constraints that hold whatever is commanded, as of linkages that close a loop.

    A weld to a mocap body is none: it drags a gripper.

    Args:
        model: compiled.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        self._model, self._data = model, mujoco.MjData(model)
        self._own = np.array([not _is_dragged(model, e) for e in range(model.neq)], bool)

    def __bool__(self) -> bool:
        return bool(np.any(self._own & (self._data.eq_active != 0)))

    def violations(self, states: Array) -> Array:
        """How far states (n, nq + nv + na) violate them, in m or rad, (n, rows)."""
        if not self:
            return np.zeros((len(states), 0))
        return np.array([self._violations(state[: self._model.nq]) for state in states])

    def _violations(self, qpos: Array) -> Array:
        data = self._data
        data.qpos[:] = qpos
        mujoco.mj_fwdPosition(self._model, data)
        rows = slice(data.ne)  # those of equalities come first
        return np.asarray(data.efc_pos[rows][self._own[data.efc_id[rows]]])


def _is_dragged(model: mujoco.MjModel, constraint: int) -> bool:
    kind = model.eq_objtype[constraint]
    ends = np.array([model.eq_obj1id[constraint], model.eq_obj2id[constraint]])
    if kind == int(mujoco.mjtObj.mjOBJ_SITE):
        ends = model.site_bodyid[ends]
    elif kind != int(mujoco.mjtObj.mjOBJ_BODY):
        return False
    return bool(np.any(model.body_mocapid[ends] >= 0))


def _is_straight(model: mujoco.MjModel, v: int, bent: bool) -> bool:
    """Whether readings are linear in a degree of freedom: no rotation that turns a place."""
    joint = int(model.dof_jntid[v])
    match mujoco.mjtJoint(model.jnt_type[joint]):
        case mujoco.mjtJoint.mjJNT_SLIDE:
            return True
        case mujoco.mjtJoint.mjJNT_FREE:
            return v - int(model.jnt_dofadr[joint]) < 3
        case mujoco.mjtJoint.mjJNT_HINGE:
            return not bent
    return False


def solve_positions(rig: Rig, segments: Segments, x: Array, unseen: list[int], places: list[int]) -> None:
    """Inverse kinematics by Levenberg and Marquardt's method, on all nodes at once.

    All nodes begin at the model's initial position, or at the same distance from it where that leads to no
    solution, so that of several all take the same. What neither places nor loops tell stays there.
    """
    (S, L), model = segments.shape, rig.model
    inside, nq = segments.inside, model.nq
    wanted = np.full((S, L, len(places)), np.nan)
    for run in segments.runs():
        for k, column in enumerate(places):
            smooth, _ = smoothed(segments, run, [column])
            if len(smooth):
                assign(wanted, run, inside[run], k, smooth[:, 0])
    at = np.argwhere(inside & np.isfinite(wanted).all(axis=2))
    if not len(at):
        return
    simulator, tangent, loops = Simulator(rig), Tangent(model), Loops(model)
    first, target = x[at[:, 0], at[:, 1]].copy(), wanted[at[:, 0], at[:, 1]]
    controls = segments.control()[at[:, 0], at[:, 1], :1]

    def miss(states: Array) -> Array:
        seen = target - simulator.run(model, states, controls)[1][:, places]
        return np.concatenate([seen, -loops.violations(states)], axis=1)

    def moved(states: Array, change: Array) -> Array:
        delta = np.zeros((len(states), tangent.dim))
        delta[:, unseen] = change
        return tangent.add(states, delta)

    bent = bool(loops) or any(
        model.sensor_type[rig.sensor_of(c)] == int(mujoco.mjtSensor.mjSENS_FRAMEPOS) for c in places
    )
    longest = np.array([np.inf if _is_straight(model, v, bent) else _LONGEST for v in unseen])

    def solved(states: Array) -> tuple[Array, float]:
        error, damping = miss(states), np.full(len(at), _DAMPING)
        for _ in range(_ROUNDS):
            steps = _STEP * np.eye(len(unseen))
            J = np.stack([(error - miss(moved(states, step))) / _STEP for step in steps], axis=-1)
            gram = np.einsum("npk,npl->nkl", J, J)
            size = np.einsum("nkk->n", gram)[:, None, None] / len(unseen) + 1e-12
            stiff = gram + damping[:, None, None] * size * np.eye(len(unseen))
            step = np.linalg.solve(stiff, np.einsum("npk,np->nk", J, error)[..., None])[..., 0]
            tried = moved(states, np.clip(step, -longest, longest))
            missed = miss(tried)
            better = np.sum(missed**2, axis=1) < np.sum(error**2, axis=1)
            states, error = np.where(better[:, None], tried, states), np.where(better[:, None], missed, error)
            damping = np.where(better, damping / 4, damping * 8)
            if np.abs(step).max() < _STEP:
                break
        return states, float(np.sum(error**2))

    # A stretched arm, as models often begin, gives no direction.
    bends = [np.zeros(len(unseen)), *np.random.default_rng(0).uniform(-1, 1, (_STARTS, len(unseen)))]
    ways = [solved(moved(first, bend)) for bend in bends]
    least = min(error for _, error in ways)
    states = next(states for states, error in ways if error <= 2 * least + 1e-12)
    found = x.copy()
    found[at[:, 0], at[:, 1]] = states
    for v in unseen:
        joint = int(model.dof_jntid[v])
        kind, axis = mujoco.mjtJoint(model.jnt_type[joint]), v - int(model.jnt_dofadr[joint])
        turning = kind == mujoco.mjtJoint.mjJNT_BALL or (kind == mujoco.mjtJoint.mjJNT_FREE and axis >= 3)
        if turning and axis % 3:
            continue  # all three at once
        q, width = int(model.jnt_qposadr[joint]) + axis, 4 if turning else 1
        for run in segments.runs():
            there = inside[run]
            way = found[run, :, q : q + width][there]
            if len(way) < 2:
                continue
            if kind == mujoco.mjtJoint.mjJNT_HINGE:
                way = np.unwrap(way, axis=0)
            if turning:
                way[1:] *= np.cumprod(np.where(np.sum(way[1:] * way[:-1], axis=1) < 0, -1.0, 1.0))[:, None]
            change: Array = np.gradient(way, segments.interval, axis=0)
            rate = angular_velocity(way, change) if turning else change
            x[run, :, q : q + width] = way[-1]
            for k in range(width):
                assign(x, run, there, q + k, way[:, k])
            for k in range(rate.shape[1]):
                assign(x, run, there, nq + v + k, rate[:, k])
