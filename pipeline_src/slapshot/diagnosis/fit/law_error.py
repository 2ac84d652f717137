"""Errors of the model's own laws: each law holds to some per cent, with an error smooth in speed and load.

A servo, a motor, damping or friction that follows its law to ten per cent is no finding. Such errors are
random effects of every model, with one common size that is fitted by likelihood and bounded; errors that
depend on position or time are not law errors.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from slapshot.arrays import Array
from slapshot.diagnosis.fit.filter import Linear
from slapshot.diagnosis.fit.linear import Perturbation
from slapshot.diagnosis.model.hypothesis import Hypothesis, actuator_force
from slapshot.diagnosis.model.segments import Segments
from slapshot.effects.joints.effect import (
    Joint,
    JointEffect,
    Parameter,
    RigMotion,
    State,
    on_joint,
    overrides,
)

# Smooth functions of speed and load are sums of radial basis functions in rms speeds and loads: centres and
# widths of two length scales, since errors of a law may vary slowly or fast; and a narrow one at rest.
_GRIDS = ((np.linspace(-6.0, 6.0, 21), 0.6), (np.linspace(-6.0, 6.0, 11), 1.8))
_NARROW = 0.2
# Minimum share of variance of a component, and maximum number of components of a law. A coarse set shows
# whether laws have errors; if so, a hundredth of their variance, when neglected, is mistaken for a missing
# effect.
_COARSE, _FINE = (0.02, 8), (1e-5, 120)
_NODES = 2000  # from which components are computed
_ADDED = (1e-4, 40)  # of an added law, whose effect may be far above the noise
GAIN_ERROR = 0.2  # gain error of a law, relative to its shape errors
LAGS_S = (0.005, 0.01, 0.02)  # lags of a law behind its state, as of friction after a reversal
# Relative to the rms speed: friction is arbitrary below the first, and may deviate below the second.
NEAR_REST, LOW_SPEED = 0.05, 0.2
_LESS_AT_REST = 0.3  # share by which a friction may be less than its law says near rest
_PART = 0.4  # error near rest or in time, relative to shape errors
_FLAT = 1e-6  # of shapes, which are of size 1


class Shapes:
    """Principal components of the smooth functions of speed and load, along a motion and where a law acts.

    They are orthogonal to a gain error of the law, which is an effect.

    Args:
        speed: (n,) in usual speeds.
        load: (n,) in rms loads.
        weight: (n,) squared law.
        kept: least share of the variance of a component, and most components.

    Attributes:
        share: (k,) standard deviation of each component of a function of unit size.
    """

    def __init__(self, speed: Array, load: Array, weight: Array, kept: tuple[float, int] = _COARSE) -> None:
        some = slice(None, None, max(1, len(speed) // _NODES))  # enough for covariances
        raw, weight = _bumps(speed[some], load[some]), weight[some]
        total = max(float(weight.sum()), 1e-300)
        self._mean = weight @ raw / total
        centred = raw - self._mean
        each = weight @ centred**2 / total
        self._reached = np.flatnonzero(each > _FLAT**2 * each.max(initial=0.0))
        centred = centred[:, self._reached]
        variance, vectors = np.linalg.eigh((centred * weight[:, None]).T @ centred / total)
        whole = float(np.maximum(variance, 0).sum())
        least, most = kept
        own = np.flatnonzero((variance > least * whole) & (variance > _FLAT**2))[::-1][:most]
        self.share = np.sqrt(variance[own] / variance[own].sum()) if len(own) else np.zeros(0)
        self._vectors = vectors[:, own] / np.sqrt(variance[own])

    def __call__(self, speed: Array, load: Array) -> Array:
        """(n, k), of unit size where the law acts."""
        reached = _bumps(speed, load)[:, self._reached]
        return np.asarray((reached - self._mean[self._reached]) @ self._vectors)


def _bumps(speed: Array, load: Array) -> Array:
    parts = [np.exp(-((speed / _NARROW) ** 2))[:, None]]
    for centres, width in _GRIDS:
        # The sum has unit variance everywhere.
        size = (centres[1] - centres[0]) / (width * np.sqrt(np.pi / 2))
        along = [np.exp(-(((x[:, None] - centres) / width) ** 2)) for x in (speed, load)]
        parts.append(size * (along[0][:, :, None] * along[1][:, None, :]).reshape(len(speed), -1))
    return np.concatenate(parts, axis=1)


class Law:
    """A law of a joint of the nominal model, with the shapes of its errors."""

    def __init__(self, joint: Joint, value: Callable[[State], Array], state: State, fine: bool) -> None:
        self.joint, self.value = joint, value
        self._torque = max(float(np.sqrt(np.mean(state.torque[:, joint.v] ** 2))), 1e-12)
        self._shapes = Shapes(*self._usual(state), value(state) ** 2, _FINE if fine else _COARSE)
        # A shape error comes with a small gain error.
        self.share = np.append(self._shapes.share, GAIN_ERROR)
        self._last: list[tuple[State, Array]] = []

    def _usual(self, state: State) -> tuple[Array, Array]:
        v = self.joint.v
        return state.v[:, v] / self.joint.speed, state.torque[:, v] / self._torque

    def errors(self, state: State) -> Array:
        """The law times each shape, and the law itself, (n, k); cached, as shapes are requested singly."""
        for known, errors in self._last:
            if known is state:
                return errors
        shapes = self._shapes(*self._usual(state))
        whole = np.concatenate([shapes, np.ones((len(shapes), 1))], axis=1)
        self._last = [*self._last[-1:], (state, self.value(state)[:, None] * whole)]
        return self._last[-1][1]


class LawError(JointEffect):
    """A smooth change of one law of one joint."""

    name = "law_error"
    physics = "A law of the nominal model holds to some per cent only."
    source = "Kennedy, O'Hagan (2001), Journal of the Royal Statistical Society B 63(3)"
    phrase = "error of a law at {part}"

    def __init__(self, law: Law, shape: int) -> None:
        super().__init__(law.joint.name, (Parameter("share", "1", 1.0, probe=0.01),))
        self._law, self._shape = law, shape

    def force(self, state: State, values: Array) -> Array:
        """The law times the shape."""
        change = values[0] * self._law.errors(state)[:, self._shape]
        return on_joint(self._law.joint, change, state.v.shape[1])


def added_law_errors(
    system: Linear, hypothesis: Hypothesis, theta: Array, rig: RigMotion, state: State, interval: float
) -> Array:
    """Columns for errors of the laws that a hypothesis adds: their action times the shapes, or delayed.

    For friction also a deviation near rest; those of free bodies, as of drag, vary with speed alone. Lags and
    delays of commands may differ for a rise and a fall, or be of a higher order; for other laws the effect
    says how they may deviate.

    Args:
        system: with the hypothesis' own columns first.
        hypothesis: whose effects are laws or not.
        theta: their values.
        rig: scales.
        state: of all nodes, S * L.
        interval: s from node to node.

    Returns:
        (S, L, n, k), in shares of the common size.
    """
    S, L, n, _ = system.W.shape
    columns = []
    joints = {joint.name: joint for joint in rig.joints}
    bodies = {rig.model.body(body).name: v for body, v in rig.free_bodies}
    for effect, law in _added(system, hypothesis, theta):
        joint, v = joints.get(effect.on_joint), bodies.get(effect.part)
        weight = np.sum(law**2, axis=-1).reshape(-1)
        total = float(weight.sum())
        if total <= 0:
            continue
        if joint is not None:
            torque = max(float(np.sqrt(np.mean(state.torque[:, joint.v] ** 2))), 1e-12)
            usual = state.v[:, joint.v] / joint.speed, state.torque[:, joint.v] / torque
        elif v is not None:
            speed = np.linalg.norm(state.v[:, v : v + 3], axis=1)
            usual = speed / max(rig.speed, 1e-6), np.zeros(len(speed))
        else:
            continue
        shapes = Shapes(*usual, weight, _ADDED)
        errors = shapes(*usual).reshape(S, L, 1, -1)
        columns += [law * errors[..., k] * share for k, share in enumerate(shapes.share)]
        if joint is None:
            continue
        # In stiction the column of a friction vanishes, and so would any multiple of it.
        if effect.friction:
            friction = Friction.of(system, law, state, joint)
            near = friction.level * friction.near_rest(LOW_SPEED)
            columns.append(_normalised(system.B[..., joint.v] * near[..., None], total))
        columns += _delayed(law, total, interval)
    for effect, part in zip(hypothesis.effects, hypothesis.slices, strict=True):
        if overrides(effect, "control"):
            law = _action(system, effect, theta, part)
            total = float(np.sum(law**2))
            if total > 0:
                columns += [*_delayed(law, total, interval), _normalised(_rectified(system, law), total)]
        forces = effect.deviations(state, theta[part])
        if forces is not None:
            columns += list(np.moveaxis(system.B @ forces.reshape(S, L, -1, forces.shape[-1]), -1, 0))
    columns = [column for column in columns if np.any(column)]
    return np.stack(columns, axis=-1) if columns else np.zeros((S, L, n, 0))


@dataclass(frozen=True)
class Friction:
    """Sliding friction of an added friction effect.

    Attributes:
        joint: where.
        speed: (S, L) of the joint.
        forwards, backwards: (S, 1) typical friction of a segment in either direction.
    """

    joint: Joint
    speed: Array
    forwards: Array
    backwards: Array

    @classmethod
    def of(cls, system: Linear, law: Array, state: State, joint: Joint) -> "Friction":
        """Of the columns (S, L, n) that a law makes."""
        # The friction is its projection on the column of a held force, by least squares.
        force = system.B[..., joint.v]
        size = np.abs(np.sum(law * force, axis=-1)) / np.maximum(np.sum(force**2, axis=-1), 1e-300)
        speed = state.v[:, joint.v].reshape(size.shape)
        levels = []
        for sign in (1, -1):
            slides = sign * speed > joint.step_speed
            usual = float(np.median(size[slides])) if slides.any() else 0.0
            own = [
                np.median(row[moves]) if moves.any() else usual
                for row, moves in zip(size, slides, strict=True)
            ]
            levels.append(np.array(own)[:, None])
        return cls(joint, speed, *levels)

    @property
    def level(self) -> Array:
        """(S, L) sliding friction for the sign of the speed."""
        return np.where(self.speed > 0, self.forwards, self.backwards)

    def near_rest(self, slow: float) -> Array:
        """(S, L) sign of the speed, windowed to low speeds (a share of the rms speed)."""
        return np.asarray(np.tanh(self.speed / self.joint.step_speed) * self.window(slow))

    def window(self, slow: float) -> Array:
        """(S, L) 1 at rest, falling to 0 above low speeds (a share of the rms speed)."""
        return np.asarray(np.exp(-((self.speed / self.joint.speed / slow) ** 2)))


def friction_at_rest(
    system: Linear, hypothesis: Hypothesis, theta: Array, rig: RigMotion, state: State
) -> Array | None:
    """Variance of the force by which added frictions may differ from their laws near rest.

    There friction is whatever holds the joint, or builds up over a distance (Dahl 1968): a law says only how
    large it is at most. With a law that errs by little the joint would move on where it stands, and times at
    rest would outweigh all others, though they say little about forces. So what force lacks there to hold
    the joint, up to the friction itself, has the size that it has: a process force with heavy tails,
    reweighted in each round. What would move a joint that friction holds is a push, but for a share.

    Args:
        system: with the hypothesis' own columns first.
        hypothesis: whose effects are frictions or not.
        theta: their values.
        rig: scales.
        state: of all nodes, S * L.

    Returns:
        (S, L, nv) in N² m² or N²; None without frictions.
    """
    joints = {joint.name: joint for joint in rig.joints}
    added = _added(system, hypothesis, theta)
    frictions = [(joints[effect.part], law) for effect, law in added if effect.friction]
    if not frictions:
        return None
    act = system.process_force
    square = np.einsum("stni,stnj->stij", act, act)
    scale = np.sqrt(np.maximum(np.einsum("stii->sti", square), 1e-300))
    square = square / (scale[..., None] * scale[..., None, :]) + _FLAT * np.eye(act.shape[-1])
    along = np.einsum("stni,stn->sti", act, system.d) / scale
    lacks = np.abs(np.linalg.solve(square, along[..., None])[..., 0]) / scale
    variance = np.zeros_like(lacks)
    nv = act.shape[-1]
    for joint, law in frictions:
        near = Friction.of(system, law, state, joint)
        following = np.concatenate([near.speed[:, 1:], near.speed[:, -1:]], axis=1)
        holds = np.abs(following + system.d[..., nv + joint.v]) > np.abs(following)
        most = np.minimum(lacks[..., joint.v], np.where(holds, 1.0, _LESS_AT_REST) * near.level)
        variance[..., joint.v] += (most * near.window(NEAR_REST)) ** 2
    return variance


def soft_limit(system: Linear, hypothesis: Hypothesis, theta: Array, x: Array, segments: Segments) -> Array:
    """Columns for the soft onset of limits that a hypothesis adds.

    Args:
        system: with the hypothesis' own columns first.
        hypothesis: whose effects are limits or not.
        theta: their values.
        x: (S * L, nq + nv + na) states of all nodes.
        segments: whose controls drive them.

    Returns:
        (S, L, n, k), of each limit one for each sharpness, as large as it makes them.
    """
    S, L, n, _ = system.W.shape
    columns, model = [np.zeros((S, L, n, 0))], hypothesis.rig.model
    parts = zip(hypothesis.effects, hypothesis.slices, strict=True)
    limits = [(effect, theta[part]) for effect, part in parts if overrides(effect, "soft_limit")]
    if limits:
        force = actuator_force(model, x, segments.control()[:, :, 0].reshape(S * L, -1))
        for effect, values in limits:
            dof, deficit_now = effect.soft_limit(model, force, values)
            columns.append(system.B[..., dof][..., None] * deficit_now.reshape(S, L, 1, -1))
    return np.concatenate(columns, axis=-1)


def _added(system: Linear, hypothesis: Hypothesis, theta: Array) -> Iterator[tuple[JointEffect, Array]]:
    """Empirical laws that a hypothesis adds, with what they do, (S, L, n)."""
    for effect, part in zip(hypothesis.effects, hypothesis.slices, strict=True):
        if effect.empirical:
            yield effect, _action(system, effect, theta, part)


def _action(system: Linear, effect: JointEffect, theta: Array, part: slice) -> Array:
    """What an effect does, (S, L, n), from its sizes alone, to which it is proportional."""
    sizes = [k for k in range(part.start, part.stop) if effect.parameters[k - part.start].start == 0]
    return np.asarray(system.W[..., sizes] @ theta[sizes])


def _normalised(column: Array, total: float) -> Array:
    """A column scaled to a share of a law's size; 0 where it is negligible."""
    size = np.sqrt(np.sum(column**2) / total)
    return _PART * column / size if size > 1e-9 else np.zeros_like(column)


def _delayed(law: Array, total: float, interval: float) -> list[Array]:
    """Columns (S, L, n) for a law that follows its state late."""
    nodes = sorted({max(1, round(late / interval)) for late in LAGS_S})
    return [_normalised(_lagged_difference(law, count), total) for count in nodes]


def _rectified(system: Linear, law: Array) -> Array:
    """What a law does (S, L, n), with the size of its forces in place of the forces."""
    size = np.sqrt(np.maximum(np.sum(system.B**2, axis=2), 1e-300))
    unit = system.B / size[:, :, None]
    square = unit.swapaxes(2, 3) @ unit + _FLAT * np.eye(unit.shape[-1])
    force = np.linalg.solve(square, unit.swapaxes(2, 3) @ law[..., None])
    return np.asarray((unit @ np.abs(force))[..., 0])


def _lagged_difference(law: Array, nodes: int) -> Array:
    """The delayed law less the law, (S, L, n)."""
    later = np.concatenate([np.repeat(law[:, :1], nodes, axis=1), law[:, :-nodes]], axis=1)
    return later - law


def law_errors(rig: RigMotion, state: State, fine: bool = False) -> list[list[Perturbation]]:
    """Perturbations for the errors of each law, relative to its rms error.

    Args:
        rig: scales.
        state: along the motion.
        fine: whether law errors are large enough to need all shapes.
    """
    perturbations = []
    for joint in rig.joints:
        for value in _laws(rig, joint):
            if np.sqrt(np.mean(value(state) ** 2)) < 1e-6 * joint.torque:
                continue
            law = Law(joint, value, state, fine)
            perturbations.append(
                [
                    Perturbation(LawError(law, k), (0.01,), 0.01, float(share))
                    for k, share in enumerate(law.share)
                ]
            )
    return perturbations


def _laws(rig: RigMotion, joint: Joint) -> Iterator[Callable[[State], Array]]:
    damping = float(rig.model.dof_damping[joint.v])
    friction = float(rig.model.dof_frictionloss[joint.v])
    if joint.actuators:
        yield lambda state: state.torque[:, joint.v]
    if damping:
        yield lambda state: -damping * state.v[:, joint.v]
    if friction:
        yield lambda state: -friction * np.tanh(state.v[:, joint.v] / joint.step_speed)
