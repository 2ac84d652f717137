"""Linearisation about a trajectory: transitions, observations, and one input column for every parameter.

The model is simulated from all nodes at once; derivatives are those of one step in the middle of each
interval. The column of a stateless force law is a product with the effect B of a held force, without
simulation.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from slapshot.arrays import Array
from slapshot.diagnosis.fit.filter import Linear
from slapshot.diagnosis.fit.operating_point import OperatingPoint
from slapshot.diagnosis.model.hypothesis import Hypothesis, Simulator, actuator_torque
from slapshot.diagnosis.model.rig import Rig
from slapshot.diagnosis.model.segments import Segments
from slapshot.effects.joints.effect import JointEffect, Observed, State, overrides


@dataclass(frozen=True)
class Perturbation:
    """A perturbation by an effect that is not in the hypothesis; its column is a finite difference.

    Attributes:
        effect: the effect; None for the error of the model's time step.
        values: of its parameters.
        probe: deviation of one of them from its start.
        scale: its prior standard deviation.
    """

    effect: JointEffect | None
    values: tuple[float, ...]
    probe: float
    scale: float


# Half the step halves the error of a first-order integrator: twice this difference removes it. Where a
# better integrator was put in place of the given one, twice the difference brings that one back.
STEP_ERROR = Perturbation(None, (), 1.0, 2.0)


def perturbations_of(effects: Sequence[JointEffect]) -> list[Perturbation]:
    """All perturbations of some effects."""
    perturbations = []
    for effect in effects:
        start = np.array([parameter.start for parameter in effect.parameters])
        for values in effect.probe_values:
            which = int(np.argmax(np.abs(np.array(values) - start)))
            probe = values[which] - start[which]
            perturbations.append(Perturbation(effect, values, float(probe), effect.parameters[which].scale))
    return perturbations


@dataclass(frozen=True)
class Linearised:
    """A linear system and further results along the trajectory.

    Attributes:
        system: with the columns of the hypothesis' own parameters first, then those of the perturbations.
        torque: (S, L, nv) actuator forces, means over the intervals.
        predicted: (S, L, ny) observations on the trajectory.
    """

    system: Linear
    torque: Array
    predicted: Array


def linearise(
    simulator: Simulator,
    hypothesis: Hypothesis,
    theta: Array,
    segments: Segments,
    trajectory: Array,
    perturbations: Sequence[Perturbation] = (),
    *,
    torque_scale: Array | None = None,
    jacobian: Linear | None = None,
) -> Linearised:
    """Linearise a hypothesis about a trajectory.

    Args:
        simulator: of the hypothesis' rig.
        hypothesis: effects that are present.
        theta: their values.
        segments: data.
        trajectory: (S, L, nq + nv + na).
        perturbations: further columns.
        torque_scale: (nv,) size of forces, for differences; 1 where it is not known.
        jacobian: of a trajectory nearby, whose A, B and C are taken, as they are most of the work; where it
            has columns, the first are those of this hypothesis, and are taken but for those of laws.
    """
    (S, L), tangent = segments.shape, simulator.tangent
    n, nv, dim, ny = S * L, tangent.nv, tangent.dim, segments.y.shape[2]
    scale = np.ones(nv) if torque_scale is None else np.maximum(torque_scale, 1e-9)
    point = OperatingPoint.at(simulator, hypothesis, theta, segments, trajectory, scale)
    x, base, y, torque = point.x, point.end, point.y, point.torque
    model, control, time, order = point.model, point.control, point.time, point.order
    middle, plain, advance = point.middle, point.reads_joints, point.advance
    if jacobian is None or jacobian.spread is None:
        A, B, C, spread, process = point.jacobian
    else:
        A, B, C, spread = (
            array.reshape(n, -1, k)
            for array, k in ((jacobian.A, dim), (jacobian.B, nv), (jacobian.C, dim), (jacobian.spread, dim))
        )
        process = None if jacobian.process is None else jacobian.process.reshape(n, -1, nv)
    halved = None if jacobian is None else jacobian.halved

    observed = _observed(segments, y)
    added = hypothesis.observe(observed, theta)
    predicted = observed.y + added
    following = np.concatenate([trajectory[:, 1:], trajectory[:, -1:]], axis=1).reshape(n, -1)
    defect = tangent.subtract(base, following).reshape(S, L, dim)
    # Beyond the end of an episode there are no data, and the defect must not grow.
    defect[:, :-1][~segments.inside[:, 1:]] = 0

    p = len(theta)
    W, psi = np.zeros((n, dim, p + len(perturbations))), np.zeros((n, ny, p + len(perturbations)))
    known = jacobian is not None and jacobian.W.shape[-1] >= p

    # At both ends of the intervals: a servo's force falls within an interval, since its command is held.
    loads = simulator.rig.load
    there = torque + actuator_torque(model, following, control[:, -1], loads)
    there = there - actuator_torque(model, x, control[:, 0], loads)
    ends = [
        State(at[:, : tangent.nq], at[:, tangent.nq : tangent.nq + nv], load, when, order)
        for at, load, when in ((x, torque, time), (following, there, time + segments.interval))
    ]

    read_forces = None
    if _reads_accelerations(hypothesis.rig):
        # What acts on a joint is read at once by a sensor of forces or accelerations.
        sizes = np.eye(nv) * scale
        read = [
            (advance(hypothesis, theta, model, x, control[:, :1], np.tile(one, (n, 1)))[1] - y) / one.sum()
            for one in sizes
        ]
        read_forces = np.stack(read, axis=-1)

    def law_column(k: int, effect: JointEffect, moved: Array, here: Array, step: float, late: float) -> None:
        """Late is the share of the interval's end in the mean force."""
        laws = [(effect.force(state, moved), effect.force(state, here)) for state in ends]
        first, last = (None if a is None or b is None else a - b for a, b in laws)
        if first is not None and last is not None:
            if read_forces is not None:
                psi[:, :, k] += np.einsum("ncv,nv->nc", read_forces, first) / step
            mean = (1 - late) * first + late * last
            for v in np.flatnonzero(mean.any(axis=0)):  # of most laws one joint
                W[:, :, k] += B[:, :, v] * (mean[:, v, None] / step)

    def column(k: int, h: Hypothesis, values: Array, step: float, changed_effect: JointEffect) -> None:
        edits, controls = (overrides(changed_effect, what) for what in ("edit", "control"))
        m, u = model, control
        if controls:
            u = h.control(segments, values).reshape(n, segments.substeps, -1)
        forces = overrides(changed_effect, "force")
        if edits or forces:
            m = h.compiled(values, segments.step)
        if changed_effect.friction and not controls:
            # Of a joint that slides on, as from one step; but joints stop and start within intervals.
            W[:, :, k] = middle.changed(h, values, m, spread) / step
            some = np.flatnonzero(middle.may_stop(m))
            if len(some):
                there, *_ = simulator.advance(h, values, m, x[some], u[some], time[some], order[some])
                W[some, :, k] = tangent.subtract(there, base[some]) / step
        elif k < p and (edits or controls or forces):
            # From the whole interval, since fitted values depend on these.
            W[:, :, k] = tangent.subtract(advance(h, values, m, x, u)[0], base) / step
        else:
            if edits or forces:
                W[:, :, k] = middle.changed(h, values, m, spread) / step
            if controls:
                W[:, :, k] += middle.control_response(u - control, A, spread) / step
        if (edits or controls) and not plain:
            psi[:, :, k] = (advance(h, values, m, x, u[:, :1])[1] - y) / step
        if overrides(changed_effect, "observe"):
            psi[:, :, k] += (h.observe(observed, values) - added) / step

    for effect, part in zip(hypothesis.effects, hypothesis.slices, strict=True):
        for k in range(part.start, part.stop):
            parameter = effect.parameters[k - part.start]
            step = 1e-3 * parameter.scale
            if theta[k] + step > parameter.high:
                step = -step
            values = theta.copy()
            values[k] += step
            if is_law(effect):
                # In a simulation a law is held over each step at its value from the step's beginning.
                late = (segments.substeps - 1) / (2 * segments.substeps)
                law_column(k, effect, values[part], theta[part], step, late)
            elif jacobian is not None and known:
                W[:, :, k] = jacobian.W[..., k].reshape(n, dim)
                psi[:, :, k] = jacobian.psi[..., k].reshape(n, ny)
            else:
                column(k, hypothesis, values, step, effect)
    for k, perturbation in enumerate(perturbations, start=p):
        if perturbation.effect is None:
            if halved is None:
                halved = point.halved.reshape(S, L, dim)
            W[:, :, k] = halved.reshape(n, dim)
        elif is_law(perturbation.effect):
            start = np.array([parameter.start for parameter in perturbation.effect.parameters])
            law_column(k, perturbation.effect, np.array(perturbation.values), start, perturbation.probe, 0.5)
        else:
            h = hypothesis.with_effect(perturbation.effect)
            column(
                k, h, np.concatenate([theta, perturbation.values]), perturbation.probe, perturbation.effect
            )
    residual = residuals(hypothesis.rig, segments, predicted.reshape(S, L, ny))
    shapes = (S, L)
    W.reshape(*shapes, dim, -1)[:, :-1][~segments.inside[:, 1:]] = 0
    system = Linear(
        A.reshape(*shapes, dim, dim), B.reshape(*shapes, dim, nv), defect, C.reshape(*shapes, ny, dim),
        residual, W.reshape(*shapes, dim, -1), psi.reshape(*shapes, ny, -1),
        spread.reshape(*shapes, dim, dim), halved,
        None if process is None else process.reshape(*shapes, dim, nv),
    )  # fmt: skip
    mean = (torque + there) / 2
    return Linearised(system, mean.reshape(*shapes, nv), predicted.reshape(*shapes, ny))


def _reads_accelerations(rig: Rig) -> bool:
    """Whether an observation depends on accelerations, as that of a force sensor does."""
    stage = rig.model.sensor_needstage[[rig.sensor_of(c) for c in range(len(rig.observations))]]
    return bool(np.any(stage == int(mujoco.mjtStage.mjSTAGE_ACC)))


def is_law(effect: JointEffect) -> bool:
    """Whether an effect is only a force law of the current state."""
    return overrides(effect, "force") and not any(
        overrides(effect, other) for other in ("edit", "control", "observe")
    )


def predicted_readings(hypothesis: Hypothesis, theta: Array, segments: Segments, y: Array) -> Array:
    """Readings (S, L, ny) by a hypothesis at the times of the samples, where sensors show y at the nodes."""
    observed = _observed(segments, y)
    read = observed.y + hypothesis.observe(observed, theta)
    return np.asarray(read.reshape(y.shape))


def _observed(segments: Segments, y: Array) -> Observed:
    """Readings with their derivatives at the times of the samples, which may lie beside their nodes.

    Args:
        segments: data.
        y: (..., ny) readings at all nodes.
    """
    y = y.reshape(*segments.shape, -1)
    rate = segments.rate(y)
    second_rate = segments.rate(rate)
    third_rate = segments.rate(second_rate)
    late, square = segments.shift, segments.shift_square
    y, rate, second_rate, third_rate = (
        values.reshape(-1, y.shape[-1])
        for values in (
            y + late * rate + square / 2 * second_rate,
            rate + late * second_rate + square / 2 * third_rate,
            second_rate + late * third_rate,
            third_rate,
        )
    )
    return Observed(y, rate, second_rate, np.repeat(segments.order, segments.shape[1]), third_rate)


def residuals(rig: Rig, segments: Segments, predicted: Array) -> Array:
    """Recorded less predicted, (S, L, ny); for quaternions with the nearer of both signs."""
    y = segments.y
    for columns in rig.quaternions:
        sign = np.where(np.nansum(y[..., columns] * predicted[..., columns], axis=-1) < 0, -1.0, 1.0)
        y = y.copy()
        y[..., columns] *= sign[..., None]
    return y - predicted
