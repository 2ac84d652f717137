"""Process force of controls that act earlier or later than their stamps say.

A controller that is meant to be regular, but is stamped when a computer gets to it, changes its commands at
other times than the stamps say. Each change then has an impulse that the model lacks, by chance and not by
missing physics.
"""

import numpy as np

from slapshot.arrays import Array
from slapshot.diagnosis.fit.noise import FORCE_HOLD_S
from slapshot.diagnosis.model.hypothesis import actuator_torque
from slapshot.diagnosis.model.rig import Rig
from slapshot.diagnosis.model.segments import Segments


def control_errors(rig: Rig, segments: Segments, trajectory: Array, torque: Array) -> Array | None:
    """(S, L) process force over `torque`, as the sd of a force held for `FORCE_HOLD_S`; None for none.

    It is the same share for all degrees of freedom: the rms over those that controls with such stamps drive,
    by actuators of joints that have no state of their own.

    Args:
        rig: whose controls have stamps.
        segments: data.
        trajectory: (S, L, nx) along which controls act.
        torque: (nv,) N m or N, scale of forces.
    """
    error, model = segments.stamp_error, rig.model
    if error is None or not error[: model.nu].any():
        return None
    (S, L), after = segments.shape, segments.control()[:, :, -1, : model.nu]
    n, first = segments.substeps, after[:, 0].copy()
    for s in np.flatnonzero(segments.first > 0):
        first[s] = segments.controls[segments.episode[s]][segments.first[s] * n - 1, : model.nu]
    before = np.concatenate([first[:, None], after[:, :-1]], axis=1).reshape(S * L, -1)
    states, after = trajectory.reshape(S * L, -1), after.reshape(S * L, -1)
    held, impulse = actuator_torque(model, states, before, rig.load), np.zeros((S * L, model.nv))
    for k in np.flatnonzero(error[: model.nu]):
        changed = before.copy()
        changed[:, k] = after[:, k]
        impulse += ((actuator_torque(model, states, changed, rig.load) - held) * error[k]) ** 2
    driven = impulse.any(axis=0)
    if not driven.any():
        return None
    share = np.mean(impulse[:, driven] / torque[driven] ** 2, axis=1)
    return np.asarray(np.sqrt(share / (FORCE_HOLD_S * segments.interval)).reshape(S, L))
