"""One linear system about a path: transitions, observations, and one input column for every parameter.

Derivatives are differences of whole intervals of simulation, many nodes at once. A force law that no state of
its own belongs to is a product with the effect B of a held force, and needs no simulation.
"""

import copy
from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from mujoco import MjModel
from numpy.typing import NDArray

from slapshot.diagnosis.filter import Linear
from slapshot.diagnosis.hypothesis import Hypothesis, Simulator
from slapshot.diagnosis.rig import Rig
from slapshot.diagnosis.segments import Segments
from slapshot.effects.joints.effect import JointEffect, Observed, State, overrides

Array = NDArray[np.float64]

_POSITION_STEP, _VELOCITY_STEP = 1e-6, 1e-5
_FORCE_STEP = 1e-2  # share of the rms torque


@dataclass(frozen=True)
class Look:
    """A first look at an effect that is not in the hypothesis: its column is a difference.

    Attributes:
        effect: what is looked at; None for the error of the model's time step.
        values: of its parameters.
        probe: by how much one of them differs from its start.
        scale: prior standard deviation of that one.
    """

    effect: JointEffect | None
    values: tuple[float, ...]
    probe: float
    scale: float


# Half the step halves the error of a first-order integrator: twice this difference removes it.
STEP_ERROR = Look(None, (), 1.0, 2.0)


def looks_at(effects: Sequence[JointEffect]) -> list[Look]:
    """All first looks at some effects."""
    looks = []
    for effect in effects:
        start = np.array([parameter.start for parameter in effect.parameters])
        for values in effect.starts:
            which = int(np.argmax(np.abs(np.array(values) - start)))
            probe = values[which] - start[which]
            looks.append(Look(effect, values, float(probe), effect.parameters[which].scale))
    return looks


@dataclass(frozen=True)
class Linearised:
    """A linear system, and what else is known along the path.

    Attributes:
        system: with the columns of the hypothesis' own parameters first, then those of the looks.
        torque: (S, L, nv) actuator forces.
        predicted: (S, L, ny) observations on the path.
    """

    system: Linear
    torque: Array
    predicted: Array


def linearise(
    simulator: Simulator,
    hypothesis: Hypothesis,
    theta: Array,
    segments: Segments,
    path: Array,
    looks: Sequence[Look] = (),
    *,
    torque_scale: Array | None = None,
    jacobian: Linear | None = None,
) -> Linearised:
    """Linearise a hypothesis about a path.

    Args:
        simulator: of the hypothesis' rig.
        hypothesis: effects that are present.
        theta: their values.
        segments: data.
        path: (S, L, nq + nv + na).
        looks: further columns.
        torque_scale: (nv,) size of forces, for differences; 1 where it is not known.
        jacobian: whose A, B and C are taken, of a path nearby; they are most of the work.
    """
    (S, L), tangent = segments.shape, simulator.tangent
    n, nv, dim = S * L, tangent.nv, tangent.dim
    x = path.reshape(n, -1)
    time, order = segments.time.reshape(n), np.repeat(segments.order, L)
    model = hypothesis.compiled(theta, segments.step)
    control = hypothesis.control(segments, theta).reshape(n, segments.substeps, -1)
    ny = segments.y.shape[2]

    def advance(
        h: Hypothesis, values: Array, m: MjModel, states: Array, u: Array, extra: Array | None = None
    ) -> tuple[Array, Array, Array]:
        return simulator.advance(h, values, m, states, u, time, order, extra)

    def seen(y: Array) -> Observed:
        y = y.reshape(S, L, ny)
        rate = segments.rate(y)
        bend = segments.rate(rate)
        flat = (y.reshape(n, ny), rate.reshape(n, ny), bend.reshape(n, ny))
        return Observed(*flat, order)

    base, y, torque = advance(hypothesis, theta, model, x, control)
    # Differences need the model's integrator no more than derivatives need its last digits; only springs that
    # are stiff for the time step do.
    quicker = (lambda m: m) if hypothesis.rig.added_dofs else _quick
    quick = quicker(model)
    same = quick is model
    near = base if same else advance(hypothesis, theta, quick, x, control)[0]
    if jacobian is None:
        scale = np.ones(nv) if torque_scale is None else np.maximum(torque_scale, 1e-9)
        A, C = np.empty((n, dim, dim)), np.empty((n, ny, dim))
        for i in range(dim):
            step = _POSITION_STEP if i < nv else _VELOCITY_STEP
            delta = np.zeros(dim)
            delta[i] = step
            moved, changed, _ = advance(hypothesis, theta, quick, tangent.add(x, delta), control)
            A[:, :, i] = tangent.subtract(moved, near) / step
            C[:, :, i] = (changed - y) / step
        B = np.empty((n, dim, nv))
        for j in range(nv):
            force = np.zeros((n, nv))
            force[:, j] = _FORCE_STEP * scale[j]
            # By the model's own integrator: the size of a law is read off this.
            moved, _, _ = advance(hypothesis, theta, model, x, control, force)
            B[:, :, j] = tangent.subtract(moved, base) / (_FORCE_STEP * scale[j])
    else:
        A, B, C = (
            getattr(jacobian, name).reshape(n, -1, k) for name, k in (("A", dim), ("B", nv), ("C", dim))
        )

    observed = seen(y)
    added = hypothesis.observe(observed, theta)
    shift = segments.shift.reshape(n, ny)
    predicted = y + shift * observed.rate + shift**2 / 2 * observed.bend + added
    following = np.concatenate([path[:, 1:], path[:, -1:]], axis=1).reshape(n, -1)
    defect = tangent.subtract(base, following).reshape(S, L, dim)
    # Beyond the end of an episode nothing is known and nothing shall grow.
    defect[:, :-1][~segments.inside[:, 1:]] = 0

    p = len(theta)
    W, psi = np.zeros((n, dim, p + len(looks))), np.zeros((n, ny, p + len(looks)))

    state = State(x[:, : tangent.nq], x[:, tangent.nq : tangent.nq + nv], torque, time, order)

    def law_column(k: int, effect: JointEffect, moved: Array, here: Array, step: float) -> None:
        laws = effect.force(state, moved), effect.force(state, here)
        if laws[0] is not None and laws[1] is not None:
            law = (laws[0] - laws[1]).reshape(S, L, nv)
            held = _over_interval(law, segments.substeps).reshape(n, nv)
            W[:, :, k] = np.einsum("nij,nj->ni", B, held) / step

    def column(k: int, h: Hypothesis, values: Array, step: float, changed_effect: JointEffect) -> None:
        if overrides(changed_effect, "edit") or overrides(changed_effect, "control"):
            m = quicker(h.compiled(values, segments.step))
            u = control
            if overrides(changed_effect, "control"):
                u = h.control(segments, values).reshape(n, segments.substeps, -1)
            moved, other, _ = advance(h, values, m, x, u)
            W[:, :, k] = tangent.subtract(moved, near) / step
            difference = other - y
            if np.abs(difference).max(initial=0.0) > 0:
                psi[:, :, k] = difference / step
        elif overrides(changed_effect, "force"):
            moved, _, _ = advance(h, values, quick, x, control)
            W[:, :, k] = tangent.subtract(moved, near) / step
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
                law_column(k, effect, values[part], theta[part], step)
            else:
                column(k, hypothesis, values, step, effect)
    for k, look in enumerate(looks, start=p):
        if look.effect is None:
            finer = hypothesis.compiled(theta, segments.step / 2)
            moved, _, _ = advance(hypothesis, theta, finer, x, np.repeat(control, 2, axis=1))
            W[:, :, k] = tangent.subtract(moved, base)
        elif is_law(look.effect):
            start = np.array([parameter.start for parameter in look.effect.parameters])
            law_column(k, look.effect, np.array(look.values), start, look.probe)
        else:
            h = hypothesis.with_effect(look.effect)
            column(k, h, np.concatenate([theta, look.values]), look.probe, look.effect)
    residual = residuals(hypothesis.rig, segments, predicted.reshape(S, L, ny))
    shapes = (S, L)
    W.reshape(*shapes, dim, -1)[:, :-1][~segments.inside[:, 1:]] = 0
    system = Linear(
        A.reshape(*shapes, dim, dim), B.reshape(*shapes, dim, nv), defect, C.reshape(*shapes, ny, dim),
        residual, W.reshape(*shapes, dim, -1), psi.reshape(*shapes, ny, -1),
    )  # fmt: skip
    return Linearised(system, torque.reshape(*shapes, nv), predicted.reshape(*shapes, ny))


def is_law(effect: JointEffect) -> bool:
    """Whether an effect is a force of the present state and nothing else."""
    return overrides(effect, "force") and not any(
        overrides(effect, other) for other in ("edit", "control", "observe")
    )


def residuals(rig: Rig, segments: Segments, predicted: Array) -> Array:
    """Recorded less predicted, (S, L, ny); of a quaternion's two signs the nearer is taken."""
    y = segments.y
    for columns in rig.quaternions:
        sign = np.where(np.nansum(y[..., columns] * predicted[..., columns], axis=-1) < 0, -1.0, 1.0)
        y = y.copy()
        y[..., columns] *= sign[..., None]
    return y - predicted


def _quick(model: mujoco.MjModel) -> mujoco.MjModel:
    """The model with an integrator of one evaluation a step, where its own takes four."""
    if model.opt.integrator != int(mujoco.mjtIntegrator.mjINT_RK4):
        return model
    model = copy.copy(model)
    model.opt.integrator = int(mujoco.mjtIntegrator.mjINT_IMPLICITFAST)
    return model


def _over_interval(values: Array, steps: int) -> Array:
    """Mean of a law over an interval, from its values at the nodes, (S, L, nv).

    A law is held over each step at its value from the step's beginning.
    """
    following = np.concatenate([values[:, 1:], values[:, -1:]], axis=1)
    share = (steps - 1) / (2 * steps)
    return (1 - share) * values + share * following
