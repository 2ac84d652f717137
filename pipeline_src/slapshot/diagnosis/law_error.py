"""Error of the model's own laws: each is known to some share only, as a smooth function of speed and load.

A servo, a motor, damping or friction that follows its law to ten per cent is no news. Such errors are random
effects of every model, with one size for all laws that is fitted by likelihood and bounded; what follows
place or time is no law error.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from slapshot.arrays import Array
from slapshot.diagnosis.filter import Linear
from slapshot.diagnosis.hypothesis import Hypothesis, actuator_force
from slapshot.diagnosis.linear import Look
from slapshot.diagnosis.segments import Segments
from slapshot.effects.joints.effect import (
    Joint,
    JointEffect,
    Parameter,
    Situation,
    State,
    on_joint,
    overrides,
)

# Smooth functions of speed and load are sums of bumps, in usual speeds and rms loads; one more is narrow.
_CENTRES, _WIDTH, _NARROW = np.linspace(-6.0, 6.0, 21), 0.6, 0.2
# Least share of the variance that a component has, and most components of a law. Coarse ones show whether
# laws err; where they do, a hundredth of their variance, left out, passes for something missing.
_COARSE, _FINE = (0.02, 8), (1e-5, 120)
_OWN = (1e-4, 40)  # of a law that a hypothesis adds, which may do far more than the noise
_WHOLE = 0.2  # size of a change of the whole law, over that of the errors in shape
LATE_S = (0.005, 0.01, 0.02)  # by which a law may follow its state late, as friction does after a reversal
# Of the usual speed: where a friction may be anything, and where it may be another than farther from rest.
REST, SLOW = 0.05, 0.2
_PART = 0.4  # size of an error near rest or in time, over that of the errors in shape
_FLAT = 1e-6  # of shapes, which are of size 1
BENDS = (1e-3, 4e-3)  # of the travel, by which a friction may bend before it slips
_PARTS = 8  # of an interval


class Shapes:
    """Principal components of the smooth functions of speed and load, along a motion and where a law acts.

    They have no part in common with a change of the whole law, which is an effect.

    Args:
        speed: (n,) in usual speeds.
        load: (n,) in rms loads.
        weight: (n,) squared law.
        kept: least share of the variance of a component, and most components.

    Attributes:
        share: (k,) standard deviation of each component of a function of unit size.
    """

    def __init__(self, speed: Array, load: Array, weight: Array, kept: tuple[float, int] = _COARSE) -> None:
        raw = _bumps(speed, load)
        total = max(float(weight.sum()), 1e-300)
        self._mean = weight @ raw / total
        centred = raw - self._mean
        variance, vectors = np.linalg.eigh((centred * weight[:, None]).T @ centred / total)
        whole = float(np.maximum(variance, 0).sum())
        least, most = kept
        own = np.flatnonzero((variance > least * whole) & (variance > _FLAT**2))[::-1][:most]
        self.share = np.sqrt(variance[own] / variance[own].sum()) if len(own) else np.zeros(0)
        self._vectors = vectors[:, own] / np.sqrt(variance[own])

    def __call__(self, speed: Array, load: Array) -> Array:
        """(n, k), of unit size where the law acts."""
        return (_bumps(speed, load) - self._mean) @ self._vectors


def _bumps(speed: Array, load: Array) -> Array:
    along = [np.exp(-(((x[:, None] - _CENTRES) / _WIDTH) ** 2)) for x in (speed, load)]
    both = (along[0][:, :, None] * along[1][:, None, :]).reshape(len(speed), -1)
    return np.concatenate([both, np.exp(-((speed / _NARROW) ** 2))[:, None]], axis=1)


class Law:
    """A law of a joint of the nominal model, with the shapes of its errors."""

    def __init__(self, joint: Joint, value: Callable[[State], Array], state: State, fine: bool) -> None:
        self.joint, self.value = joint, value
        self._torque = max(float(np.sqrt(np.mean(state.torque[:, joint.v] ** 2))), 1e-12)
        self._shapes = Shapes(*self._usual(state), value(state) ** 2, _FINE if fine else _COARSE)
        # What is wrong in shape is a little wrong as a whole.
        self.share = np.append(self._shapes.share, _WHOLE)
        self._last: list[tuple[State, Array]] = []

    def _usual(self, state: State) -> tuple[Array, Array]:
        v = self.joint.v
        return state.v[:, v] / self.joint.speed, state.torque[:, v] / self._torque

    def errors(self, state: State) -> Array:
        """The law times each shape, and the law, (n, k); remembered, as shapes are asked for one by one."""
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


def own_law_errors(
    system: Linear, hypothesis: Hypothesis, theta: Array, rig: Situation, state: State, interval: float
) -> Array:
    """Columns of the errors of the laws that a hypothesis adds: what they do, times the same shapes, or late.

    A friction may also be another near rest.

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
    for effect, joint, law in _added(system, hypothesis, theta, rig):
        weight = np.sum(law**2, axis=-1).reshape(-1)
        total = float(weight.sum())
        if total <= 0:
            continue
        torque = max(float(np.sqrt(np.mean(state.torque[:, joint.v] ** 2))), 1e-12)
        usual = state.v[:, joint.v] / joint.speed, state.torque[:, joint.v] / torque
        shapes = Shapes(*usual, weight, _OWN)
        errors = shapes(*usual).reshape(S, L, 1, -1)
        columns += [law * errors[..., k] * share for k, share in enumerate(shapes.share)]
        # Where a friction holds fast it does nothing, and a share of it would be nothing too.
        if effect.friction:
            friction = Friction.of(system, law, state, joint)
            near = friction.level * friction.near_rest(SLOW)
            columns.append(_sized(system.B[..., joint.v] * near[..., None], total))
        for nodes in sorted({max(1, round(late / interval)) for late in LATE_S}):
            columns.append(_sized(_late(law, nodes), total))
    columns = [column for column in columns if np.any(column)]
    return np.stack(columns, axis=-1) if columns else np.zeros((S, L, n, 0))


@dataclass(frozen=True)
class Friction:
    """What a friction that a hypothesis adds does in sliding.

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
        # The friction is what it does in the direction of a held force, by least squares.
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
        """(S, L) friction of a joint that slides as fast or slowly as it moves."""
        return np.where(self.speed > 0, self.forwards, self.backwards)

    def near_rest(self, slow: float) -> Array:
        """(S, L) a sign of the speed that is 0 away from rest, farther than a share of the usual speed."""
        there = self.speed / self.joint.speed
        return np.asarray(np.tanh(self.speed / self.joint.step_speed) * np.exp(-((there / slow) ** 2)))

    def before_slip(self, interval: float, bend: float) -> tuple[Array, Array]:
        """Means over the intervals of what lacks of a friction that turns over a distance, as bristles do.

        Args:
            interval: s from node to node.
            bend: rad or m, over which it turns.

        Returns:
            (S, L) of the friction, as much as it does in sliding, less as much as has turned, from the first
            node on; and the share (S, L) that is left of what it lacked there.
        """
        speed = self.speed
        following = np.concatenate([speed[:, 1:], speed[:, -1:]], axis=1)
        forwards, backwards = self.forwards[:, 0], -self.backwards[:, 0]

        def sliding(speed: Array) -> Array:
            return np.where(speed > 0, forwards, np.where(speed < 0, backwards, 0.0))

        bent, left = sliding(speed[:, 0]), np.ones(len(speed))
        lacks, share = np.zeros_like(speed), np.zeros_like(speed)
        # A reversal takes less than an interval, within which the speed changes evenly.
        for t in range(speed.shape[1]):
            for part in (np.arange(_PARTS) + 0.5) / _PARTS:
                there = (1 - part) * speed[:, t] + part * following[:, t]
                lacking = sliding(there) - bent
                lacks[:, t] += lacking / _PARTS
                share[:, t] += left / _PARTS
                decay = np.exp(-np.abs(there) * interval / _PARTS / bend)
                bent = sliding(there) - lacking * decay
                left = left * decay
        return lacks, share


def presliding(
    system: Linear, hypothesis: Hypothesis, theta: Array, rig: Situation, state: State, interval: float
) -> Array:
    """Columns of what frictions that a hypothesis adds do near rest and before they slip (Dahl 1968).

    A friction turns with the distance since the last reversal, not at once, and at rest may be more or less,
    whatever it does in motion: that is short, but leaves another speed after every reversal, which is seen
    long after. Where a segment begins near rest, nobody knows how far it has turned.

    Args:
        system: with the hypothesis' own columns first.
        hypothesis: whose effects are frictions or not.
        theta: their values.
        rig: scales.
        state: of all nodes, S * L.
        interval: s from node to node.

    Returns:
        (S, L, n, k), of each friction one near rest, for each bend one, and one for each segment that begins
        near rest, as large as it makes them.
    """
    S, L, n, _ = system.W.shape
    columns = []
    for effect, joint, law in _added(system, hypothesis, theta, rig):
        if not effect.friction:
            continue
        friction, force = Friction.of(system, law, state, joint), system.B[..., joint.v]
        if not np.any(friction.level):
            continue
        columns.append(force * (friction.level * friction.near_rest(REST))[..., None])
        begins = np.flatnonzero(np.abs(friction.speed[:, 0]) < SLOW * joint.speed)
        for bend in BENDS:
            lacks, share = friction.before_slip(interval, bend * joint.travel)
            columns.append(force * lacks[..., None])
            for s in begins:
                first = np.zeros_like(force)
                first[s] = force[s] * (friction.forwards[s] + friction.backwards[s]) / 2 * share[s][:, None]
                columns.append(first)
    return np.stack(columns, axis=-1) if columns else np.zeros((S, L, n, 0))


def knees(system: Linear, hypothesis: Hypothesis, theta: Array, x: Array, segments: Segments) -> Array:
    """Columns of what limits that a hypothesis adds do before they are reached.

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
    limits = [(effect, theta[part]) for effect, part in parts if overrides(effect, "knees")]
    if limits:
        force = actuator_force(model, x, segments.control()[:, :, 0].reshape(S * L, -1))
        for effect, values in limits:
            dof, lacking = effect.knees(model, force, values)
            columns.append(system.B[..., dof][..., None] * lacking.reshape(S, L, 1, -1))
    return np.concatenate(columns, axis=-1)


def _added(
    system: Linear, hypothesis: Hypothesis, theta: Array, rig: Situation
) -> Iterator[tuple[JointEffect, Joint, Array]]:
    """Empirical laws that a hypothesis adds to joints, with what they do, (S, L, n)."""
    joints = {joint.name: joint for joint in rig.joints}
    for effect, part in zip(hypothesis.effects, hypothesis.slices, strict=True):
        if effect.empirical and effect.part in joints:
            # Parameters of size alone: what they do is in proportion to them.
            sizes = [k for k in range(part.start, part.stop) if effect.parameters[k - part.start].start == 0]
            yield effect, joints[effect.part], system.W[..., sizes] @ theta[sizes]


def _sized(column: Array, total: float) -> Array:
    """A column of a part of a law's size; 0 where there is next to nothing of it."""
    size = np.sqrt(np.sum(column**2) / total)
    return _PART * column / size if size > 1e-9 else np.zeros_like(column)


def _late(law: Array, nodes: int) -> Array:
    """What a law does later, less what it does, (S, L, n): friction gives way before it slips."""
    later = np.concatenate([np.repeat(law[:, :1], nodes, axis=1), law[:, :-nodes]], axis=1)
    return later - law


def law_errors(rig: Situation, state: State, fine: bool = False) -> list[list[Look]]:
    """Looks at the errors of each law, in shares of its rms error.

    Args:
        rig: scales.
        state: along the motion.
        fine: whether laws err enough for all shapes to matter.
    """
    looks = []
    for joint in rig.joints:
        for value in _laws(rig, joint):
            if np.sqrt(np.mean(value(state) ** 2)) < 1e-6 * joint.torque:
                continue
            law = Law(joint, value, state, fine)
            looks.append(
                [Look(LawError(law, k), (0.01,), 0.01, float(share)) for k, share in enumerate(law.share)]
            )
    return looks


def _laws(rig: Situation, joint: Joint) -> Iterator[Callable[[State], Array]]:
    damping = float(rig.model.dof_damping[joint.v])
    friction = float(rig.model.dof_frictionloss[joint.v])
    if joint.actuators:
        yield lambda state: state.torque[:, joint.v]
    if damping:
        yield lambda state: -damping * state.v[:, joint.v]
    if friction:
        yield lambda state: -friction * np.tanh(state.v[:, joint.v] / joint.step_speed)
