"""By what a law of the swing errs that has one value for all joints: each joint is late by a time of its own.

Beside such a law these times stand in every fit as nuisance with a prior of their own: what they explain is
neither named nor counted as scatter from hit to hit. Their mean is what the law's shape errs by: a filter of
second order is one of first order and a delay.
"""

from collections.abc import Iterable, Mapping

import numpy as np

from slapshot.arrays import Array
from slapshot.effects.effect import ARM_JOINTS, Effect, Parameter

LATENESS = "joint_lateness"
LONGEST = 0.05  # s


class JointLateness(Effect):
    """Each joint of an arm of seven is late by a time of its own; it is never named."""

    name = LATENESS
    phase = "swing"
    follows = "time"
    parameters = tuple(
        Parameter(f"late_{j}", "s", -LONGEST, LONGEST, 0.003, "one joint's targets are late")
        for j in range(ARM_JOINTS)
    )
    physics = "No physics named: laws of servos that have one value for all joints\nerr by joint."
    source = (
        "Siciliano et al., Robotics: Modelling, Planning and Control, section 8.3 (decentralised control)"
    )

    def command(self, values: Mapping[str, float], targets: Array, period: float) -> Array:
        """Each joint's targets of a moment ago, linear between ticks."""
        ticks = np.arange(len(targets))
        late = lateness_of(values, targets.shape[1])
        moved = [
            np.interp(ticks - t / period, ticks, column) for t, column in zip(late, targets.T, strict=True)
        ]
        return np.stack(moved, axis=1)


def lateness_of(values: Mapping[str, float], joints: int) -> Array:
    """(joints,) s."""
    late = np.zeros(joints)
    late[:ARM_JOINTS] = [values[f"late_{j}"] for j in range(min(joints, ARM_JOINTS))]
    return late


def with_errors(effects: Mapping[str, Effect], names: Iterable[str]) -> list[str]:
    """Names of effects and of the error of their laws, where one of them errs by joint."""
    listed = list(names)
    errs = LATENESS in effects and LATENESS not in listed and any(effects[n].errs_by_joint for n in listed)
    return [*listed, LATENESS] if errs else listed


def error_note(effects: Mapping[str, Effect], values: Mapping[str, Mapping[str, float]], joints: int) -> str:
    """A line on what was fitted beside the laws of the swing."""
    laws = " and ".join(
        name.replace("_", " ") for name in values if name != LATENESS and effects[name].errs_by_joint
    )
    late = 1e3 * lateness_of(values[LATENESS], joints)
    return (
        f"beside {laws}, which has one value for all joints, each joint was fitted as late by its own time, "
        f"{late.min():.1f} to {late.max():.1f} ms"
    )


def swings_late(late: Array, speeds: Array) -> Array:
    """(j, v, n, m, j) rad, change of the joint angles where the first index's joint is late, to first order.

    Args:
        late: (v,) s.
        speeds: (n, m, j) rad/s of the nominal swing.
    """
    return -np.einsum("v,nmj,jc->cvnmj", late, speeds, np.eye(speeds.shape[-1]))


def launches_late(late: Array, by_joints: Array, speeds: Array, accelerations: Array) -> Array:
    """(j, v, n, 5) change of launches where one joint is late, to first order.

    Args:
        late: (v,) s.
        by_joints: (n, 5, 2 j) of launches by offset (rad) and rate (rad/s) of each joint at the contact.
        speeds: (n, j) rad/s of the nominal swing at the contact.
        accelerations: (n, j) rad/s^2.
    """
    joints = speeds.shape[1]
    of_one = by_joints[..., :joints] * speeds[:, None] + by_joints[..., joints:] * accelerations[:, None]
    return -np.einsum("v,nkj->jvnk", late, of_one)
