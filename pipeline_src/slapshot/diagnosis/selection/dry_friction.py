"""The level of a joint's dry friction, which several effects have, in one of them."""

import numpy as np

from slapshot.arrays import Array
from slapshot.diagnosis.model.hypothesis import Hypothesis
from slapshot.effects.joints.coulomb_friction import CoulombFriction
from slapshot.effects.joints.direction_friction import DirectionFriction
from slapshot.effects.joints.effect import JointEffect
from slapshot.effects.joints.stribeck_friction import StribeckFriction
from slapshot.effects.joints.torque_offset import TorqueOffset


def with_one_level(hypothesis: Hypothesis, theta: Array) -> tuple[Hypothesis, Array]:
    """The same model with each joint's dry friction at speed in one effect, where several share it.

    Coulomb friction is part of friction by direction, and of Stribeck friction; beside friction by direction
    Stribeck friction is but the excess near rest. A constant torque beside larger dry friction is friction by
    direction. Only sums of shared values could be told.

    Args:
        hypothesis: what was added to a model, and its free parameters, which stay.
        theta: its values.
    """
    values = {e.key: theta[own] for e, own in zip(hypothesis.effects, hypothesis.slices, strict=True)}
    effects = list(hypothesis.effects)
    for joint in {effect.part for effect in hypothesis.added}:
        own = [effect for effect in hypothesis.added if effect.part == joint]
        coulomb, direction, stribeck = (
            next((effect for effect in own if isinstance(effect, kind)), None)
            for kind in (CoulombFriction, DirectionFriction, StribeckFriction)
        )
        offset = next((effect for effect in own if isinstance(effect, TorqueOffset)), None)
        if offset is not None:
            torque, level = float(values[offset.key][0]), sum(values[e.key][0] for e in own if _has_level(e))
            both = direction or DirectionFriction(offset.joint, hypothesis.rig.model)
            sizes_of_both = values[both.key] if direction is not None else np.zeros(2)
            moved = sizes_of_both + np.array([-torque, torque])
            # What is free in the rig stays.
            taken = direction is None and both.key in values
            if (direction is not None or level) and not taken and both.describes(moved + level):
                values[both.key] = moved
                if direction is None:
                    effects[effects.index(offset)] = both
                else:
                    effects.remove(offset)
                direction = both
        holder = direction or stribeck
        if holder is None:
            continue
        sizes = slice(0, 2 if direction else 1)  # of the holder, in which the level is
        if coulomb is not None:
            values[holder.key] = _raised(values[holder.key], sizes, float(values[coulomb.key][0]))
            effects.remove(coulomb)
        if direction is not None and isinstance(stribeck, StribeckFriction) and stribeck.has_level:
            level, *rest = values[stribeck.key]
            values[direction.key] = _raised(values[direction.key], sizes, float(level))
            values[stribeck.key] = np.array(rest)
            effects[effects.index(stribeck)] = stribeck.near_rest
    if effects == list(hypothesis.effects):
        return hypothesis, theta
    merged = Hypothesis(hypothesis.rig, tuple(effects))
    return merged, merged.clipped(np.concatenate([values[effect.key] for effect in effects]))


def _has_level(effect: JointEffect) -> bool:
    """Whether the first value of an effect is a level of dry friction in both directions."""
    return isinstance(effect, CoulombFriction) or (isinstance(effect, StribeckFriction) and effect.has_level)


def _raised(values: Array, sizes: slice, by: float) -> Array:
    values = values.copy()
    values[sizes] += by
    return values
