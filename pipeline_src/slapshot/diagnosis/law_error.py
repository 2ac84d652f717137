"""Error of the model's own laws: each is known to some share only, as a smooth function of speed and load.

A servo, a motor, damping or friction that follows its law to ten per cent is no news. Such errors are random
effects of every model, with one size for all laws that is fitted by likelihood and bounded; what follows
place or time is no law error.
"""

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from slapshot.diagnosis.filter import Linear
from slapshot.diagnosis.hypothesis import Hypothesis
from slapshot.diagnosis.linear import Look
from slapshot.effects.joints.effect import Joint, JointEffect, Parameter, Situation, State, on_joint

Array = NDArray[np.float64]

_SHAPES: tuple[Callable[[Array, Array], Array], ...] = (
    lambda s, load: np.exp(-((s / 0.05) ** 2)),
    lambda s, load: np.exp(-((s / 0.2) ** 2)),
    lambda s, load: np.exp(-(s**2)),
    lambda s, load: np.tanh(s),
    lambda s, load: np.tanh(s) * np.abs(np.tanh(s)),
    lambda s, load: np.tanh(load),
    lambda s, load: np.exp(-(load**2)),
)
LATE_S = (0.005, 0.01, 0.02)  # by which a law may follow its state late, as friction does after a reversal
_SLOW = (0.05, 0.2)  # of the usual speed, where a friction may be another than farther from rest
_FLAT = 1e-6  # of shapes, which are of size 1


class LawError(JointEffect):
    """A smooth change of one law of one joint."""

    name = "law_error"
    physics = "A law of the nominal model holds to some per cent only."
    source = "Kennedy, O'Hagan (2001), Journal of the Royal Statistical Society B 63(3)"
    phrase = "error of a law at {part}"

    def __init__(
        self, joint: Joint, law: Callable[[State], Array], shape: int, torque: float, state: State
    ) -> None:
        super().__init__(joint.name, (Parameter("share", "1", 1.0, probe=0.01),))
        self._joint, self._law, self._shape, self._torque = joint, law, _SHAPES[shape], torque
        weight = law(state) ** 2
        raw = self._raw(state)
        # Free of a change of the whole law, which is an effect, and of unit size.
        self._mean = float(np.sum(weight * raw) / max(np.sum(weight), 1e-300))
        spread = np.sum(weight * (raw - self._mean) ** 2) / max(np.sum(weight), 1e-300)
        self._size = float(np.sqrt(spread))

    @property
    def varies(self) -> bool:
        """Whether the shape differs along the motion at all; a constant is a change of the whole law."""
        return self._size > _FLAT

    def _raw(self, state: State) -> Array:
        j = self._joint
        return self._shape(state.v[:, j.v] / j.speed, state.torque[:, j.v] / self._torque)

    def force(self, state: State, values: Array) -> Array:
        """The law times the shape."""
        change = (self._raw(state) - self._mean) / self._size
        return on_joint(self._joint, values[0] * self._law(state) * change, state.v.shape[1])


def own_law_errors(
    system: Linear, hypothesis: Hypothesis, theta: Array, rig: Situation, state: State, interval: float
) -> tuple[Array, Array]:
    """Columns of the errors of the laws that a hypothesis adds: what they do, times the same shapes.

    Args:
        system: with the hypothesis' own columns first.
        hypothesis: whose effects are laws or not.
        theta: their values.
        rig: scales.
        state: of all nodes, S * L.
        interval: s from node to node.

    Returns:
        (S, L, n, k) and standard deviations (k,), in shares of the common size.
    """
    S, L, n, _ = system.W.shape
    columns = []
    joints = {joint.name: joint for joint in rig.joints}
    for effect, part in zip(hypothesis.effects, hypothesis.slices, strict=True):
        joint = joints.get(effect.part)
        if not effect.empirical or joint is None:
            continue
        # Parameters of size alone: what they do is in proportion to them.
        sizes = [k for k in range(part.start, part.stop) if effect.parameters[k - part.start].start == 0]
        law = system.W[..., sizes] @ theta[sizes]
        weight = np.sum(law**2, axis=-1).reshape(-1)
        total = float(weight.sum())
        if total <= 0:
            continue
        torque = max(float(np.sqrt(np.mean(state.torque[:, joint.v] ** 2))), 1e-12)
        for shape in _SHAPES:
            raw = shape(state.v[:, joint.v] / joint.speed, state.torque[:, joint.v] / torque)
            raw = raw - np.sum(weight * raw) / total
            size = np.sqrt(np.sum(weight * raw**2) / total)
            if size > 1e-9:
                columns.append(law * (raw / size).reshape(S, L, 1))
        # Where a friction holds fast it does nothing, and a share of it would be nothing too.
        speed = state.v[:, joint.v].reshape(S, L)
        for slow in _SLOW if effect.friction else ():
            near_rest = np.tanh(speed / joint.step_speed) * np.exp(-((speed / (slow * joint.speed)) ** 2))
            columns.append(_sized(system.B[..., joint.v] * near_rest[..., None], total))
        for nodes in sorted({max(1, round(late / interval)) for late in LATE_S}):
            columns.append(_sized(_late(law, nodes), total))
    columns = [column for column in columns if np.any(column)]
    W = np.stack(columns, axis=-1) if columns else np.zeros((S, L, n, 0))
    return W, np.full(len(columns), 1 / np.sqrt(len(_SHAPES) + len(_SLOW) + len(LATE_S)))


def _sized(column: Array, total: float) -> Array:
    """A column with the same sum of squares as a law; 0 where there is next to nothing of it."""
    size = np.sqrt(np.sum(column**2) / total)
    return column / size if size > 1e-9 else np.zeros_like(column)


def _late(law: Array, nodes: int) -> Array:
    """What a law does later, less what it does, (S, L, n): friction gives way before it slips."""
    later = np.concatenate([np.repeat(law[:, :1], nodes, axis=1), law[:, :-nodes]], axis=1)
    return later - law


def law_errors(rig: Situation, state: State) -> list[Look]:
    """Columns of all law errors, each in shares of the rms error of its law."""
    looks = []
    for joint in rig.joints:
        for law in _laws(rig, joint):
            if np.sqrt(np.mean(law(state) ** 2)) < 1e-6 * joint.torque:
                continue
            torque = max(float(np.sqrt(np.mean(state.torque[:, joint.v] ** 2))), 1e-12)
            for shape in range(len(_SHAPES)):
                effect = LawError(joint, law, shape, torque, state)
                if not effect.varies:
                    continue
                looks.append(Look(effect, (0.01,), 0.01, 1 / np.sqrt(len(_SHAPES))))
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
